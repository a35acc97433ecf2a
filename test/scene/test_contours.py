"""Exact contours: on the surface, tangent to it, the outline of the solid and no more."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.geometry import Camera
from occ_recon_ros.scene import OBJECTS, TurntableSettings, coverage, make_object, turntable_cameras
from occ_recon_ros.scene.catalogue import sphere

HIGH = TurntableSettings(elevation=float(np.deg2rad(35)))
SMALL = TurntableSettings(width=640, height=480, focal_px=800)


def loops_of(contours):
    return np.split(contours.uv, contours.loop_starts[1:-1])


def area(uv):
    x, y = uv.T
    return 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()


@pytest.mark.parametrize("name", OBJECTS)
@pytest.mark.parametrize("elevation_deg", [4, 35, 70])
def test_rays_touch_the_surface_where_they_should(name, elevation_deg):
    scene_object = make_object(name)
    settings = replace(SMALL, elevation=float(np.deg2rad(elevation_deg)))
    for camera in turntable_cameras(settings)[3::20]:  # not face to face
        contours = scene_object.exact_contours(camera)
        depth, k_t = scene_object.exact_depth(contours)
        points = contours.centre + depth[:, None] * contours.T
        assert np.abs(scene_object.distance(points)).max() < 1e-12
        assert np.abs((contours.T * contours.N).sum(1)).max() < 1e-12
        np.testing.assert_allclose(np.linalg.norm(contours.T, axis=1), 1, atol=1e-14)
        # What is seen is convex along the ray.
        assert k_t.min() > -1e-6
        # The ray stays outside just before and behind the point.
        for along in (1e-3, -1e-3):
            near = points + along * contours.T
            regular = np.isfinite(contours.sigma)
            assert scene_object.distance(near)[regular].min() > -1e-12


@pytest.mark.parametrize("name", OBJECTS)
def test_the_object_is_on_the_left_and_the_normal_points_away(name):
    camera = turntable_cameras(HIGH)[5]
    contours = make_object(name).exact_contours(camera)
    t = contours.T[contours.next_row] - contours.T[contours.previous_row]
    normal = np.cross(contours.T, t)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    regular = np.isfinite(contours.sigma)
    assert (normal * contours.N).sum(1)[regular].min() > 0.99
    # Outer loops run counter-clockwise on the screen: a negative area with v down.
    areas = [area(uv) for uv in loops_of(contours)]
    assert areas[0] < 0
    assert all(a > 0 for a in areas[1:])


@pytest.mark.parametrize("name", OBJECTS)
@pytest.mark.parametrize("elevation_deg", [15, 35])
def test_the_outline_parts_rays_that_hit_from_rays_that_miss(name, elevation_deg):
    scene_object = make_object(name)
    camera = turntable_cameras(replace(SMALL, elevation=float(np.deg2rad(elevation_deg))))[7]
    contours = scene_object.exact_contours(camera, spacing_px=0.5)
    covered = coverage(loops_of(contours), camera.width, camera.height)
    uv = np.random.default_rng(0).integers([150, 100], [490, 380], (500, 2))
    T = camera.viewing_directions(uv)
    along = camera.centre + np.linspace(0.75, 1.25, 300)[:, None, None] * T
    hit = scene_object.inside(along.reshape(-1, 3)).reshape(300, -1).any(0)
    share = covered[uv[:, 1], uv[:, 0]]
    assert hit.sum() > 20
    # Rays through the centres of pixels that are not on the edge.
    assert hit[share > 1 - 1e-9].all()
    assert not hit[share < 1e-9].any()


def test_samples_are_evenly_spaced():
    for name in ("vase", "gourd", "wavy"):
        contours = make_object(name).exact_contours(turntable_cameras()[3], spacing_px=2.0)
        step = np.linalg.norm(contours.uv[contours.next_row] - contours.uv, axis=1)
        regular = np.isfinite(contours.sigma) & np.isfinite(contours.sigma[contours.next_row])
        assert np.abs(step[regular] - 2.0).max() < 0.02


def test_the_rim_of_a_torus_solves_its_trigonometric_equation():
    torus = make_object("torus")
    camera = turntable_cameras(HIGH)[0]
    contours = torus.exact_contours(camera)
    depth, _ = torus.exact_depth(contours)
    X = contours.centre + depth[:, None] * contours.T
    phi = np.arctan2(X[:, 1], X[:, 0])
    s = np.arctan2(X[:, 2], np.hypot(X[:, 0], X[:, 1]) - 0.07)
    C = camera.centre
    A = np.hypot(C[0], C[1]) * np.cos(phi - np.arctan2(C[1], C[0])) - 0.07
    np.testing.assert_allclose(A * np.cos(s) + C[2] * np.sin(s), 0.025, atol=1e-12)


def test_a_sphere_has_the_depth_and_curvature_of_the_tangent_cone():
    ball = sphere(0.2, (0.05, 0.02, -0.01))
    camera = turntable_cameras(TurntableSettings(distance=1.3))[4]
    contours = ball.exact_contours(camera)
    depth, k_t = ball.exact_depth(contours)
    distance = np.linalg.norm(camera.centre - [0.05, 0.02, -0.01])
    np.testing.assert_allclose(depth, np.sqrt(distance**2 - 0.04), rtol=1e-12)
    np.testing.assert_allclose(k_t, 5.0, rtol=1e-9)


def test_the_torus_shows_its_hole_with_corners_that_carry_no_surface():
    torus = make_object("torus")
    low = torus.exact_contours(turntable_cameras()[0])
    high = torus.exact_contours(turntable_cameras(HIGH)[0])
    assert len(low.loop_starts) == 2
    assert len(high.loop_starts) == 3
    assert np.isfinite(low.sigma).all()
    # Two corners in the hole, the far rim passing behind the near one.
    infinite = np.isinf(high.sigma)
    assert (high.loop[infinite] == 1).all()
    assert 4 <= infinite.sum() <= 8


def test_the_handle_of_the_mug_opens_and_closes_its_hole_twice_a_turn():
    mug = make_object("mug")
    holes = [len(mug.exact_contours(camera).loop_starts) - 2 for camera in turntable_cameras()]
    assert set(holes) == {0, 1}
    assert np.count_nonzero(np.diff([*holes, holes[0]])) == 4


def test_sigma_is_the_angle_of_the_declared_pixels():
    camera = turntable_cameras()[0]
    contours = make_object("sphere").exact_contours(camera, sigma_px=0.3)
    # On the sphere's centred circle across is radial: d(angle)/du = cos^2(angle) / f.
    angle = np.arcsin(0.1)
    np.testing.assert_allclose(contours.sigma, 0.3 * np.cos(angle) ** 2 / 1600, rtol=1e-5)


def test_noise_free_depth_is_found_for_rays_moved_off_the_rim():
    vase = make_object("vase")
    camera = turntable_cameras()[2]
    exact = vase.exact_contours(camera)
    truth, _ = vase.exact_depth(exact)
    shift = 1e-4 * np.random.default_rng(0).standard_normal(len(exact))
    T = exact.T + shift[:, None] * exact.N
    moved = type(exact)(**{**exact.__dict__, "T": T / np.linalg.norm(T, axis=1, keepdims=True)})
    depth, _ = vase.exact_depth(moved)
    assert np.abs(depth - truth).max() < 1e-3


def test_a_distorted_camera_sees_the_same_rim_elsewhere():
    vase = make_object("vase")
    straight = turntable_cameras()[3]
    bent = turntable_cameras(D=(-0.2, 0.05, 1e-3, -5e-4, 0.0), distortion="plumb_bob")[3]
    contours = vase.exact_contours(bent)
    depth, _ = vase.exact_depth(contours)
    points = contours.centre + depth[:, None] * contours.T
    assert np.abs(vase.distance(points)).max() < 1e-12
    np.testing.assert_allclose(bent.project(points), contours.uv, atol=1e-9)
    assert np.abs(straight.project(points) - contours.uv).max() > 0.3


def test_a_far_camera_with_a_long_lens_keeps_the_truth_exact():
    far = TurntableSettings(distance=200.0, focal_px=320000.0)
    for name in ("vase", "torus", "mug"):
        scene_object, camera = make_object(name), turntable_cameras(far)[1]
        contours = scene_object.exact_contours(camera)
        near = scene_object.exact_contours(turntable_cameras()[1])
        assert len(contours) == pytest.approx(len(near), rel=0.05)
        depth, _ = scene_object.exact_depth(contours)
        points = contours.centre + depth[:, None] * contours.T
        assert np.abs(scene_object.distance(points)).max() < 1e-11


def test_a_loop_that_leaves_the_image_keeps_its_part_inside():
    camera = turntable_cameras(TurntableSettings(width=300, height=960))[0]
    contours = make_object("sphere").exact_contours(camera)
    assert contours.uv[:, 0].min() >= -0.5
    assert contours.uv[:, 0].max() <= 299.5
    assert not contours.linked.all()


def test_the_object_must_be_before_the_camera():
    ball = make_object("sphere")
    K = np.array([[1600, 0, 640], [0, 1600, 480], [0, 0, 1.0]])
    inside = Camera(K, 1280, 960, np.eye(3), np.zeros(3))
    with pytest.raises(ValueError, match="inside the object"):
        ball.exact_contours(inside)
    beside = Camera(K, 1280, 960, np.eye(3), np.array([0, 0.5, 0.05]))
    with pytest.raises(ValueError, match="in front of the camera"):
        ball.exact_contours(beside)
