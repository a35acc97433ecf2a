"""Meshes as files hold them."""

import numpy as np
import pytest
import trimesh

from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.meshes import joined, read_mesh


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply", "obj", "glb"])
def test_what_is_closed_is_closed_in_files_of_each_kind(tmp_path, kind):
    path = tmp_path / f"m.{kind.split('_')[0]}"
    trimesh.creation.icosphere(subdivisions=2, radius=0.05).export(path, file_type=kind)
    mesh = joined(read_mesh(path))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.05)


def test_what_is_open_stays_open_and_a_collapsed_triangle_opens_nothing(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    half = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 0] > 0])
    assert not joined(half).is_watertight
    more = trimesh.Trimesh(ball.vertices, [*ball.faces, (0, 0, ball.faces[0][1])], process=False)
    assert joined(more).is_watertight


@pytest.mark.parametrize(("value", "said"), [(np.nan, "not finite"), (1e30, "4 vertices up to 1e")])
def test_broken_vertices_are_refused_by_what_to_do(tmp_path, value, said):
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices = np.array(ball.vertices)
    vertices[5:9] = value
    trimesh.Trimesh(vertices, ball.faces, process=False).export(tmp_path / "m.ply")
    with pytest.raises(UserError, match=f"{said}.*write it again"):
        read_mesh(tmp_path / "m.ply")


@pytest.mark.parametrize("faces", ["f 1 2 2\nf 1 1 3", "f 1 2 4"])
def test_triangles_that_are_lines_are_refused(tmp_path, faces):
    path = tmp_path / "m.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\n{faces}\n")
    with pytest.raises(UserError, match="has no triangles with an area"):
        read_mesh(path)
