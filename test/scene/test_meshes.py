"""Meshes as scene objects: outlines exact against ray casting, distances against spheres."""

import numpy as np
import pytest
import trimesh
from scenes import mesh_object
from scenes.mesh_part import MeshPart

from occ_recon_ros.scene import (
    SceneObject,
    TurntableSettings,
    coverage,
    make_object,
    turntable_cameras,
)
from occ_recon_ros.scene.closest import closest_on_triangles


def hits(mesh, origin, T):
    """Moeller and Trumbore's ray-triangle test, every ray with every triangle."""
    a, b, c = np.moveaxis(np.asarray(mesh.triangles), 1, 0)
    e1, e2, s = b - a, c - a, origin - a
    q = np.cross(s, e1)
    hit = np.zeros(len(T), bool)
    for k, direction in enumerate(T):
        p = np.cross(direction, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / (e1 * p).sum(1)
            u, v = (s * p).sum(1) * inverse, (q @ direction) * inverse
        hit[k] = ((u >= 0) & (v >= 0) & (u + v <= 1)).any()
    return hit


@pytest.mark.parametrize("frame", [0, 7, 12, 24, 31])
def test_the_outline_of_the_cow_parts_rays_that_hit_from_rays_that_miss(shared_data, frame):
    cow = mesh_object(shared_data / "meshes" / "spot.obj")
    camera = turntable_cameras(TurntableSettings(elevation=0.4))[frame]
    contours = cow.exact_contours(camera, spacing_px=0.5)
    loops = np.split(contours.uv, contours.loop_starts[1:-1])
    covered = coverage(loops, camera.width, camera.height)
    uv = np.random.default_rng(frame).integers([450, 280], [850, 700], (800, 2))
    hit = hits(cow.mesh(), camera.centre, camera.viewing_directions(uv))
    share = covered[uv[:, 1], uv[:, 0]]
    assert hit.sum() > 100
    # The outline is cut by samples, so pixels barely touched by it may differ.
    assert hit[share > 1 - 1e-3].all()
    assert not hit[share < 1e-3].any()


def test_a_fine_mesh_has_the_outline_of_the_solid_it_is_of():
    torus = make_object("torus")
    mesh = torus.mesh(400)
    part = MeshPart(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    camera = turntable_cameras(TurntableSettings(elevation=0.6))[2]
    shares = [
        coverage(np.split(c.uv, c.loop_starts[1:-1]), camera.width, camera.height)
        for c in (o.exact_contours(camera, 0.5) for o in (torus, SceneObject("mesh", (part,))))
    ]
    # A chord of the tube leaves out r (1 - cos(pi / n)) of its radius at most.
    assert np.abs(shares[0] - shares[1]).sum() < 1e-3 * shares[0].sum()
    assert shares[1].sum() < shares[0].sum()


def test_distances_to_a_mesh_are_exact_and_signed():
    box = trimesh.creation.box((0.2, 0.1, 0.06))
    part = MeshPart(np.asarray(box.vertices), np.asarray(box.faces))
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (3000, 3))
    q = np.abs(points) - [0.1, 0.05, 0.03]
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    expected = outside + np.minimum(q.max(1), 0)
    np.testing.assert_allclose(part.distance(points), expected, atol=1e-14)
    assert (part.inside(points) == (expected < 0)).all()


def test_the_closest_point_of_a_triangle_beats_any_other():
    rng = np.random.default_rng(0)
    triangles, points = rng.normal(size=(200, 3, 3)), 2 * rng.normal(size=(200, 3))
    weights = closest_on_triangles(points, triangles)
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(1), 1)
    best = np.linalg.norm(points - np.einsum("ni,nij->nj", weights, triangles), axis=1)
    other = rng.dirichlet(np.ones(3), 4000)
    distances = np.linalg.norm(points[:, None] - other @ triangles, axis=2).min(1)
    assert (best <= distances + 1e-12).all()
    assert (distances - best).max() < 0.1


def test_a_triangle_without_area_is_a_line():
    line = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    weights = closest_on_triangles(np.array([[1.5, 1.0, 0.0]]), line)
    np.testing.assert_allclose(weights @ line[0], [[1.5, 0, 0]], atol=1e-12)
    rng = np.random.default_rng(0)
    ends, points = rng.normal(size=(500, 2, 3)), rng.normal(size=(500, 3))
    lines = np.concatenate([ends, ends.mean(axis=1, keepdims=True)], axis=1)  # but for rounding
    found = np.einsum("ni,nij->nj", closest_on_triangles(points, lines), lines)
    along = np.linspace(0, 1, 400)[:, None, None]
    on_line = (1 - along) * ends[:, 0] + along * ends[:, 1]
    nearest = np.linalg.norm(points - on_line, axis=2).min(axis=0)
    assert (np.linalg.norm(points - found, axis=1) <= nearest + 1e-12).all()


def test_an_open_mesh_is_refused():
    box = trimesh.creation.box((1, 1, 1))
    with pytest.raises(ValueError, match="not closed"):
        MeshPart(np.asarray(box.vertices), np.asarray(box.faces)[:-1])
