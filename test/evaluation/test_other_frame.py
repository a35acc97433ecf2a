"""A mesh that a program turned, mirrored, moved or counts in millimetres is told to be so."""

import numpy as np
import pytest
import trimesh
from cast import cast
from scipy.spatial.transform import Rotation

from occ_recon_ros.evaluation.other_frame import in_another_frame
from occ_recon_ros.evaluation.raycast import RayCaster
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

OFFSET = np.array([0.02, -0.01, 0.03])


def body():
    """Without any symmetry: three limbs of other lengths."""
    sides = [((0.12, 0.02, 0.02), (0.05, 0, 0)), ((0.02, 0.07, 0.02), (0, 0.03, 0))]
    sides += [((0.03, 0.03, 0.1), (0, 0, 0.05)), ((0.02, 0.05, 0.03), (0.1, 0.03, 0.01))]
    boxes = [trimesh.creation.box(size).apply_translation(at) for size, at in sides]
    return trimesh.util.concatenate(boxes).apply_translation(OFFSET)


@pytest.fixture(scope="module")
def seen():
    return cast(body())


def told(change, seen):
    mesh = body()
    mesh.vertices = change(np.asarray(mesh.vertices))
    return in_another_frame(mesh, seen, iou=0.3)


def y_up(v):
    return v[:, [0, 2, 1]] * [1, 1, -1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (y_up, "if its axes x, y, z are x, z, -y of the poses"),
        (lambda v: 1000 * v, "if its unit is mm"),
        (lambda v: 100 * y_up(v), "x, z, -y of the poses, and its unit is cm"),
        (lambda v: v / 0.0254, "if its unit is inch"),
        (lambda v: y_up(v) / 0.37, "x, z, -y of the poses, and it is 0.37"),
        (lambda v: v * [1, -1, 1], "if its axes x, y, z are x, -y, z of the poses, which mirrors"),
    ],
)
def test_axes_and_units_are_told(seen, change, said):
    words = told(change, seen)
    assert words.startswith("it agrees (IoU 1.00 in the mean)")
    assert words.endswith(said) or said in words
    assert "moved" not in words


def test_a_mesh_that_was_moved_to_its_origin_is_told_where_it_belongs(seen):
    middle = body().bounds.mean(axis=0)
    words = told(lambda v: y_up(v - middle), seen)
    assert "are x, z, -y of the poses, and it is moved by (" in words
    moved = np.array(words.split("(")[-1].split(")")[0].split(","), float)
    np.testing.assert_allclose(moved, middle, atol=2e-4)


def test_a_mesh_that_was_moved_a_little_is_told_by_how_much(seen):
    words = told(lambda v: v - [0.015, 0.0, 0.008], seen)
    assert words.startswith("it agrees (IoU 1.00 in the mean) if it is moved by (")
    moved = np.array(words.split("(")[-1].split(")")[0].split(","), float)
    np.testing.assert_allclose(moved, [0.015, 0.0, 0.008], atol=2e-4)


def test_a_mesh_that_was_turned_about_the_axis_is_told_by_how_much(seen):
    back = Rotation.from_euler("z", -37, degrees=True)
    words = told(lambda v: 1000 * back.apply(v), seen)
    assert "if it is turned by " in words
    angle = float(words.split("turned by ")[1].split()[0])
    assert angle == pytest.approx(37, abs=0.3)
    assert words.endswith("1), and its unit is mm")


def test_a_mesh_far_from_its_origin_loses_nothing(seen):
    words = told(lambda v: v + np.array([5e5, 5e6, 100]), seen)
    assert words.startswith("it agrees (IoU 1.00 in the mean) if it is moved by (")


def test_a_thin_rod_in_millimetres_is_told():
    size = {"width": 640, "height": 480, "focal_px": 1000}
    cameras = turntable_cameras(TurntableSettings(frames=6, step=1.0, **size))
    rod = trimesh.creation.box((0.0012, 0.0012, 0.24)).apply_translation(OFFSET)
    caster = RayCaster(rod.triangles)
    seen = [(camera, caster.silhouette(camera)) for camera in cameras]
    words = in_another_frame(rod.apply_scale(1000), seen, iou=0.0)
    assert words.startswith("it agrees (IoU 1.00 in the mean) if ")
    assert "its unit is mm" in words


@pytest.mark.slow
def test_a_mesh_that_is_right_and_one_of_something_else_are_left(seen):
    assert in_another_frame(body(), seen, iou=1.0) == ""
    assert in_another_frame(trimesh.creation.icosphere(radius=0.06), seen, iou=0.3) == ""
    assert in_another_frame(body(), [], iou=0.3) == ""


@pytest.mark.parametrize("corner", [[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
def test_a_mesh_without_extent_and_too_few_views_are_left(seen, corner):
    flat = trimesh.Trimesh([[0, 0, 0], [0.05, 0, 0], corner], [[0, 1, 2]], process=False)
    assert in_another_frame(flat, seen[:2], iou=0.3) == ""
    assert in_another_frame(body(), seen[:1], iou=0.3) == ""
    assert in_another_frame(body(), [seen[0], seen[0]], iou=0.3) == ""
