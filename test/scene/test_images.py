"""Rendered images: coverage, shading, blur, noise; and the turntable's poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ_recon_ros.scene import (
    RenderSettings,
    TurntableSettings,
    coverage,
    make_object,
    render,
    turntable_cameras,
)

SIZE = (64, 48)


def disc(u, v, radius, sides=4000):
    angle = -np.linspace(0, 2 * np.pi, sides, endpoint=False)
    # The radius of the polygon whose area is the disc's.
    radius *= np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    return np.column_stack([u + radius * np.cos(angle), v + radius * np.sin(angle)])


def area_left_of(x, y, radius):
    """Area of the disc about the origin in the quadrant below and left of (x, y)."""
    s = np.linspace(-radius, min(max(x, -radius), radius), 20001)
    half = np.sqrt(np.maximum(radius**2 - s**2, 0))
    height = np.clip(y + half, 0, 2 * half)
    return np.trapezoid(height, s)


@settings(max_examples=30, deadline=None)
@given(u=st.floats(20, 40), v=st.floats(15, 30), radius=st.floats(0.2, 14))
def test_the_area_of_a_disc_is_exact(u, v, radius):
    covered = coverage([disc(u, v, radius)], *SIZE)
    assert covered.sum() == pytest.approx(np.pi * radius**2, abs=1e-9)
    assert covered.min() >= 0
    assert covered.max() <= 1


@settings(max_examples=15, deadline=None)
@given(u=st.floats(500, 501), v=st.floats(480, 481), radius=st.floats(50, 400))
def test_the_centroid_of_a_disc_is_right(u, v, radius):
    covered = coverage([disc(u, v, radius, sides=20000)], 1000, 960)
    rows, columns = np.mgrid[:960, :1000]
    assert (covered * columns).sum() / covered.sum() == pytest.approx(u, abs=1e-3)
    assert (covered * rows).sum() / covered.sum() == pytest.approx(v, abs=1e-3)


def test_each_pixel_holds_the_area_of_disc_in_its_square():
    u, v, radius = 31.37, 22.81, 7.3
    covered = coverage([disc(u, v, radius)], *SIZE)
    for row, column in ((16, 29), (23, 38), (24, 24), (22, 31), (29, 33), (17, 35)):
        left, right = column - 0.5 - u, column + 0.5 - u
        top, bottom = row - 0.5 - v, row + 0.5 - v
        area = (
            area_left_of(right, bottom, radius)
            - area_left_of(left, bottom, radius)
            - area_left_of(right, top, radius)
            + area_left_of(left, top, radius)
        )
        assert covered[row, column] == pytest.approx(area, abs=1e-5)


def test_a_rectangle_covers_the_shares_of_its_pixels():
    square = np.array([[1.25, 1.0], [1.25, 3.75], [4.0, 3.75], [4.0, 1.0]])
    covered = coverage([square], 7, 6)
    across = np.array([0, 0.25, 1, 1, 0.5, 0, 0])
    down = np.array([0, 0.5, 1, 1, 0.25, 0])
    np.testing.assert_allclose(covered, down[:, None] * across, atol=1e-12)


def test_a_hole_is_taken_out_and_what_leaves_the_image_is_cut():
    outer, hole = disc(30, 24, 20), disc(30, 24, 8)[::-1]
    ring = coverage([outer, hole], *SIZE)
    np.testing.assert_allclose(
        ring, coverage([outer], *SIZE) - coverage([disc(30, 24, 8)], *SIZE), atol=1e-12
    )
    wide = coverage([disc(100, 100, 20), disc(160, 150, 30)], 260, 250)
    for du, dv in ((90, 95), (150, 140), (110, 90)):
        moved = [disc(100 - du, 100 - dv, 20), disc(160 - du, 150 - dv, 30)]
        expected = wide[dv : dv + 48, du : du + 64]
        np.testing.assert_allclose(coverage(moved, *SIZE), expected, atol=1e-9)
    assert not coverage([], *SIZE).any()


def test_the_edge_of_the_picture_is_the_edge_of_the_coverage():
    torus = make_object("torus")
    camera = turntable_cameras(TurntableSettings(elevation=0.6))[1]
    image = render(torus, camera, RenderSettings(blur_px=0)).astype(float)
    contours = torus.exact_contours(camera, spacing_px=0.5)
    loops = np.split(contours.uv, contours.loop_starts[1:-1])
    covered = coverage(loops, camera.width, camera.height)
    backdrop = np.median(image[covered == 0])
    assert np.ptp(image[covered == 0]) == 0
    full = image[covered == 1]
    assert full.max() < 0.6 * backdrop
    # An edge pixel mixes the backdrop with the object beside it, which varies little.
    assert full.std() < 0.12 * backdrop
    edge = (covered > 0) & (covered < 1)
    mixed = backdrop + covered[edge] * (np.median(full) - backdrop)
    assert np.abs(image[edge] - mixed).max() < 0.2 * backdrop
    # In total the picture darkens by what is covered.
    dark = (backdrop - image)[200:760].sum() / (backdrop - full.mean())
    assert dark == pytest.approx(covered.sum(), rel=2e-3)


def test_blur_and_motion_blur_keep_the_centre_and_the_sum():
    sphere, camera = make_object("sphere"), turntable_cameras()[0]
    sharp = render(sphere, camera, RenderSettings(blur_px=0)).astype(float)
    columns = np.arange(camera.width)
    for faults in (RenderSettings(blur_px=2), RenderSettings(motion_blur_px=3.4)):
        image = render(sphere, camera, faults).astype(float)
        dark_sharp, dark = sharp.max() - sharp, sharp.max() - image
        assert dark.sum() == pytest.approx(dark_sharp.sum(), rel=1e-3)
        centre = (dark * columns).sum() / dark.sum()
        assert centre == pytest.approx((dark_sharp * columns).sum() / dark_sharp.sum(), abs=0.02)


def test_noise_is_as_asked_repeats_with_its_seed_and_spares_the_truth():
    vase, camera = make_object("vase"), turntable_cameras()[0]
    clean = render(vase, camera).astype(float)
    noisy = render(vase, camera, RenderSettings(noise=4.0), seed=3)
    assert (noisy - clean)[:100].std() == pytest.approx(4.0, rel=0.05)
    assert (noisy == render(vase, camera, RenderSettings(noise=4.0), seed=3)).all()
    assert (noisy != render(vase, camera, RenderSettings(noise=4.0), seed=4)).any()
    jagged = render(vase, camera, RenderSettings(noise_px=1.0)).astype(float)
    assert (jagged[:100] == clean[:100]).all()
    assert np.abs(jagged - clean).max() > 20


def test_colour_images_are_bgr_and_unknown_encodings_are_refused():
    vase, camera = make_object("vase"), turntable_cameras()[0]
    image = render(vase, camera, RenderSettings(encoding="bgr8"))
    assert image.shape == (960, 1280, 3)
    assert image.dtype == np.uint8
    blue, green, red = image[480, 640].astype(int)
    assert blue > green > red
    with pytest.raises(ValueError, match="rgb555"):
        render(vase, camera, RenderSettings(encoding="rgb555"))


def test_the_table_turns_counter_clockwise_and_looks_at_the_axis():
    s = TurntableSettings(axis_offset_x=0.03, axis_offset_y=-0.02, axis_tilt=0.1)
    cameras = turntable_cameras(s)
    axis = np.array([np.sin(0.1), 0, np.cos(0.1)])
    foot = np.array([0.03, -0.02, 0])
    centres = np.array([camera.centre for camera in cameras]) - foot
    np.testing.assert_allclose(np.linalg.norm(centres, axis=1), 1.0)
    np.testing.assert_allclose(centres @ axis, np.sin(np.deg2rad(15)))
    for camera in cameras:
        np.testing.assert_allclose(camera.project(foot), [[639.5, 479.5]], atol=1e-9)
        # The axis is upright in the image, its top up.
        top = camera.project(foot + 0.1 * axis)[0]
        assert top[0] == pytest.approx(639.5, abs=1e-9)
        assert top[1] < 479.5
    # Clockwise from above for the camera is a negative turn about the axis.
    turn = np.cross(centres[:-1], centres[1:]) @ axis
    assert (turn < 0).all()
    assert np.arcsin(-turn / (np.cos(np.deg2rad(15)) ** 2)) == pytest.approx(np.deg2rad(10))
