"""Sequences: general motion, the paper's sphere, hard images, what is seen edge-on."""

import numpy as np
import pytest
from scenes import (
    StressSettings,
    hand_held_cameras,
    looking_at,
    paper_sphere,
    seen_edge_on,
    stress_sequence,
)

from occ_recon_ros.scene import RenderSettings, TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.scene.catalogue import sphere


def test_a_camera_looks_where_it_is_told():
    camera = looking_at([0.5, -0.8, 0.3], [0.01, 0.02, 0.03], roll=0.2)
    np.testing.assert_allclose(camera.centre, [0.5, -0.8, 0.3], atol=1e-15)
    np.testing.assert_allclose(camera.project([0.01, 0.02, 0.03]), [[639.5, 479.5]], atol=1e-9)
    upright = looking_at([0.5, -0.8, 0.3], [0, 0, 0])
    below, above = upright.project([[0, 0, -0.1], [0, 0, 0.1]])
    assert above[0] == pytest.approx(below[0])
    assert above[1] < below[1]


def test_a_hand_held_camera_leaves_every_plane_and_keeps_the_object_in_view():
    cameras = hand_held_cameras()
    centres = np.array([camera.centre for camera in cameras])
    spread = np.linalg.svd(centres - centres.mean(0), compute_uv=False)
    assert spread[2] > 0.2
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert steps.max() / steps.min() > 1.2
    for camera in cameras:
        uv = make_object("gourd").exact_contours(camera).uv
        assert uv.min() > 0
        assert (uv.max(0) < [1280, 960]).all()
    # The same path, twice as dense.
    dense = np.array([camera.centre for camera in hand_held_cameras(72, np.deg2rad(5))])
    np.testing.assert_allclose(dense[::2], centres, atol=1e-12)


def test_the_papers_sphere_has_its_size_samples_and_noise():
    ball, cameras, contours = paper_sphere(np.deg2rad(5), seed=1)
    for camera, c in zip(cameras, contours, strict=True):
        assert np.linalg.norm(camera.centre) == pytest.approx(1.3)
        radius = 1600 * 0.2 / np.sqrt(1.3**2 - 0.2**2)
        assert len(c) == round(2 * np.pi * radius)
        moved = np.linalg.norm(c.uv - [639.5, 479.5], axis=1) - radius
        # Across the outline the mean square of two uniform coordinates is one pixel.
        assert moved.std() == pytest.approx(1.0, abs=0.06)
        assert np.abs(moved).max() < np.sqrt(6) + 1e-2
    turned = np.arccos(cameras[0].centre @ cameras[1].centre / 1.3**2)
    assert turned == pytest.approx(np.deg2rad(5))
    depth, k_t = ball.exact_depth(contours[1])
    np.testing.assert_allclose(k_t, 5.0, rtol=1e-9)
    # A ray that misses comes nearest to the sphere where it comes nearest to its centre.
    np.testing.assert_allclose(depth, -(contours[1].T @ contours[1].centre), rtol=1e-12)


def test_a_smoother_is_given_each_noisy_loop():
    given = []

    def half(uv):
        given.append(uv)
        return uv[::2], np.full(len(uv[::2]), 0.25)

    _, cameras, contours = paper_sphere(0.1, smooth=half)
    assert len(given) == 3
    np.testing.assert_array_equal(contours[0].uv, given[0][::2])
    scale = cameras[0].viewing_directions(contours[0].uv)
    np.testing.assert_allclose(scale, contours[0].T, atol=1e-15)


def test_hard_images_are_hard_where_they_say_and_only_there():
    vase, cameras = make_object("vase"), turntable_cameras()[::6]
    frames = list(stress_sequence(vase, cameras))
    good_lens = RenderSettings(blur_px=0.8)
    calm = list(stress_sequence(vase, cameras[:2], StressSettings(0, 0, 0, 0, 0), good_lens))
    assert all(frame.visible.all() for frame in calm)
    hidden = [1 - frame.visible.mean() for frame in frames]
    assert 0.07 < np.mean(hidden) < 0.2
    # The backdrop has the object's grey along about a tenth of the outline.
    same = [np.mean(np.abs(frame.contrast) < 1) for frame in frames]
    assert min(same) > 0.05
    assert max(same) < 0.13
    corner = np.array([frame.image[:50, :50].mean() for frame in frames])
    assert np.ptp(corner) > 0.15 * corner.mean()
    assert frames[0].image[:50, :50].std() == pytest.approx(10, rel=0.1)
    assert frames[0].image[:50, -50:].mean() < 0.85 * corner[0]


def test_the_image_steps_by_the_contrast_that_is_told():
    vase, cameras = make_object("vase"), turntable_cameras()[:3]
    for frame in stress_sequence(vase, cameras, lens=RenderSettings(blur_px=0.0)):
        c = frame.contours
        across = frame.camera.project(c.centre + c.T + 1e-3 * c.N) - frame.camera.project(
            c.centre + c.T
        )
        across = 3 * across / np.linalg.norm(across, axis=1, keepdims=True)
        values = []
        for uv in (c.uv + across, c.uv - across):
            column, row = np.rint(uv).astype(int).T
            values.append(frame.image[row, column].astype(float))
        assert np.median(np.abs(values[0] - values[1] - frame.contrast)) < 4


def test_a_turn_sees_the_belt_of_a_sphere_edge_on_and_not_its_caps():
    ball, s = sphere(0.1), TurntableSettings(elevation=0.5)
    points, normals = ball.surface_samples(60)
    seen = seen_edge_on(ball, points, turntable_cameras(s))
    # N.C = R for some azimuth of C.
    reach = np.cos(0.5) * np.hypot(normals[:, 0], normals[:, 1])
    margin = reach - np.abs(np.sin(0.5) * normals[:, 2] - 0.1)
    sure = np.abs(margin) > 0.02
    assert (seen[sure] == (margin[sure] > 0)).all()
    assert 0.1 < seen.mean() < 0.95


def test_the_inside_of_a_torus_is_hidden_where_no_outline_reaches():
    torus = make_object("torus")
    cameras = turntable_cameras()
    outside, inside = np.array([[0.095, 0, 0]]), np.array([[0.045, 0, 0]])
    assert seen_edge_on(torus, outside, cameras).all()
    # The ray along the inner equator is a saddle's: the solid is before and behind it.
    assert not seen_edge_on(torus, inside, cameras).any()


@pytest.mark.parametrize("name", ["gourd", "mug"])
def test_rim_points_of_the_views_are_seen_edge_on(name):
    scene_object, cameras = make_object(name), turntable_cameras()
    for camera in turntable_cameras(TurntableSettings(frames=5, step=0.31)):
        contours = scene_object.exact_contours(camera, spacing_px=7)
        depth, _ = scene_object.exact_depth(contours)
        points = contours.centre + depth[:, None] * contours.T
        regular = np.isfinite(contours.sigma)
        # Frontier points, whose tangent plane the camera only touches, may be missed.
        assert seen_edge_on(scene_object, points[regular], cameras).mean() > 0.97
