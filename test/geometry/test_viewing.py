"""Image loops to viewing directions and outward normals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, contours_from_loops

CAMERA = Camera(
    K=np.array([[1600.0, 0, 640], [0, 1600, 480], [0, 0, 1]]),
    width=1280,
    height=960,
    R_camera_object=Rotation.from_rotvec([1.2, 0.4, -0.8]).as_matrix(),
    t_camera_object=np.array([0.0, 0.05, 1.0]),
)


def circle(radius, centre=(700.0, 400.0), n=600, counter_clockwise=True):
    """On the screen, with y down."""
    theta = np.linspace(0, 2 * np.pi, n, endpoint=False) * (1 if counter_clockwise else -1)
    return np.array(centre) + radius * np.column_stack([np.cos(theta), -np.sin(theta)])


def contours(*loops):
    sigma = [np.full(len(uv), 0.1) for uv in loops]
    return contours_from_loops(CAMERA, loops, range(len(loops)), sigma, 5, "object")


def test_normals_point_away_from_the_object_on_outlines_and_into_holes():
    outline, hole = circle(200), circle(80, n=300, counter_clockwise=False)
    found = contours(outline, hole)
    step = CAMERA.project(CAMERA.centre + found.T + 1e-6 * found.N) - found.uv
    away = found.uv - np.array([700.0, 400.0])
    sign = np.sign(np.einsum("nk,nk->n", step, away))
    assert (sign[:600] == 1).all()
    assert (sign[600:] == -1).all()


def test_normals_are_across_the_ray_and_the_contour():
    found = contours(circle(150))
    assert np.abs(np.einsum("nk,nk->n", found.N, found.T)).max() < 1e-12
    tangent = found.T[found.next_row] - found.T[found.previous_row]
    assert np.abs(np.einsum("nk,nk->n", found.N, tangent)).max() < 1e-12


def test_sigma_becomes_an_angle():
    found = contours(circle(100, centre=(640, 480)))
    np.testing.assert_allclose(found.sigma, 0.1 / 1600, rtol=0.02)
    assert found.radians_per_pixel == pytest.approx(1 / 1600, rel=0.01)


def test_where_all_rays_are_one_a_pixel_has_no_angle():
    found = contours(circle(100))
    one = replace(found, T=np.broadcast_to(found.T[:1], found.T.shape).copy())
    assert np.isnan(one.radians_per_pixel)


def test_samples_are_marked_where_a_pixel_is_no_angle_at_all():
    K = np.array([[1e20, 0, -1e20], [0, 1e20, -1e20], [0, 0, 1]])
    far = Camera(K, 1400, 800, np.eye(3), np.zeros(3))
    sigma = np.r_[np.inf, np.ones(7)]
    c = contours_from_loops(far, [circle(100.0, n=8)], [0], [sigma], 5, "object")
    assert np.isinf(c.sigma).all()
    np.testing.assert_allclose(np.linalg.norm(c.N, axis=1), 1)


def test_loops_are_closed_each_for_itself():
    found = contours(circle(200, n=50), circle(90, n=30))
    assert found.next_row[49] == 0
    assert found.next_row[79] == 50
    assert (found.previous_row[found.next_row] == np.arange(80)).all()
    assert found.linked.all()


def test_a_cut_loop_does_not_bend_across_its_gap():
    arc = circle(200, n=400)[:300]
    found = contours(arc)
    assert not found.linked[-1]
    assert found.linked[:-1].all()
    whole = contours(circle(200, n=400))
    np.testing.assert_allclose(found.N[[0, -1]], whole.N[[0, 299]], atol=0.01)


def test_too_short_loops_are_refused():
    with pytest.raises(ValueError, match="3 samples"):
        contours(circle(10, n=2))
