"""Contours of rendered and of real images against the truth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from discs import camera_for, coverage, ellipse_error, photograph

from occ_recon_ros.geometry.lens import folded_share, have_ray
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker, draw_contours


def contours_of(image, mask=None, **settings):
    tracker = ContourTracker(ContourSettings(**settings))
    return tracker.process(image, camera_for(image), 7, "turntable", mask)


def ring(shape=(300, 300), outer=110.0, inner=45.0):
    centre = np.array([150.3, 148.6])
    return (
        coverage(shape, centre, np.array([outer, outer]), 0.0)
        - coverage(shape, centre, np.array([inner, inner]), 0.0),
        centre,
    )


@pytest.mark.parametrize("radius", [20.0, 50.0, 140.0])
@pytest.mark.parametrize("blur", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(("inside", "outside"), [(60, 160), (200, 40)])
def test_a_disc_keeps_its_radius(radius, blur, inside, outside):
    size = int(2 * radius + 60)
    centre = np.array([size / 2 + 0.31, size / 2 - 0.17])
    radii = np.array([radius, radius])
    share = coverage((size, size), centre, radii, 0.0)
    contours = contours_of(photograph(share, inside, outside, blur, noise=2.0))
    error = ellipse_error(contours.uv, centre, radii, 0.0)
    assert abs(error.mean()) < 0.02
    assert error.std() < 0.05


def test_an_ellipse_is_not_flattened():
    centre, radii = np.array([200.2, 150.7]), np.array([150.0, 60.0])
    share = coverage((300, 400), centre, radii, 0.3)
    contours = contours_of(photograph(share, noise=1.0))
    assert np.abs(ellipse_error(contours.uv, centre, radii, 0.3)).max() < 0.1


def test_sixteen_bits_are_not_cut_to_eight():
    centre, radii = np.array([60.4, 60.1]), np.array([30.0, 30.0])
    share = coverage((120, 120), centre, radii, 0.0)
    image = (20000 + 600 * cv2.GaussianBlur(share, (0, 0), 1.0)).astype(np.uint16)
    contours = contours_of(image)
    assert np.abs(ellipse_error(contours.uv, centre, radii, 0.0)).max() < 0.03


def test_the_object_is_on_the_left_and_normals_point_out():
    share, centre = ring()
    contours = contours_of(photograph(share))
    assert len(contours.loop_starts) == 3
    for loop, out in ((0, 1.0), (1, -1.0)):
        rows = contours.loop == loop
        # Camera looks along z with x right and y down, so N shows outward in the image.
        away = contours.uv[rows] - centre
        assert (out * (contours.N[rows, :2] * away).sum(axis=1) > 0).all()
    # Displayed with y down, an outer loop that runs counter-clockwise has negative area.
    x, y = contours.uv[contours.loop == 0].T
    assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0


def test_samples_are_evenly_spaced():
    share, _ = ring()
    contours = contours_of(photograph(share, noise=3.0), spacing_px=1.5)
    step = np.linalg.norm(contours.uv[contours.next_row] - contours.uv, axis=1)
    assert step.min() > 1.3
    assert step.max() < 1.7


def test_specks_and_small_holes_are_left_out():
    share, _ = ring(inner=5.0)
    share[20:26, 20:26] = 1.0
    assert len(contours_of(photograph(share)).loop_starts) == 2


@pytest.mark.parametrize(("inner", "by_image"), [(7.3, 1), (9.0, 2)])
def test_an_image_alone_does_not_tell_a_small_hole_from_a_glint(inner, by_image):
    share, _ = ring(inner=inner)
    image = photograph(share)
    assert len(contours_of(image).loop_starts) == 1 + by_image
    mask = np.rint(255 * share).astype(np.uint8)
    assert len(contours_of(image, mask).loop_starts) == 3


@pytest.mark.parametrize("tracking", ["none", "snake"])
@pytest.mark.parametrize(
    ("centre", "radii", "gaps"),
    [
        ((150.0, 200.0), (90.0, 90.0), 1),
        ((20.3, 20.3), (60.0, 60.0), 1),
        ((150.3, 115.3), (200.0, 60.0), 2),
        ((60.3, 115.3), (90.0, 150.0), 1),
        ((63.2, 120.0), (60.0, 60.0), 0),
    ],
    ids=["below", "in a corner", "left and right", "on three sides", "nearly touching"],
)
def test_a_loop_cut_by_the_border_keeps_its_good_part(centre, radii, gaps, tracking):
    share = coverage((230, 300), np.array(centre), np.array(radii), 0.0)
    tracker = ContourTracker(ContourSettings(tracking=tracking))
    for i in range(2):
        image = photograph(share, noise=2.0, seed=i)
        contours = tracker.process(image, camera_for(image), i, "turntable")
    assert (~contours.linked).sum() == gaps
    assert contours.uv.min() > 2
    assert (contours.uv.max(axis=0) < [297, 227]).all()
    assert np.abs(ellipse_error(contours.uv, np.array(centre), np.array(radii), 0.0)).max() < 0.1


def test_colour_alone_is_enough():
    centre, radii = np.array([100.4, 90.6]), np.array([60.0, 50.0])
    share = cv2.GaussianBlur(coverage((180, 200), centre, radii, 0.2), (0, 0), 1.0)[..., None]
    # Blue and orange of the same grey value.
    image = np.array([210, 90, 90]) * (1 - share) + np.array([30, 115, 120]) * share
    tracker = ContourTracker()
    image = np.round(image).astype(np.uint8)
    contours = tracker.process(image, camera_for(image), 0, "turntable")
    assert tracker.events() == ["segmentation: chroma"]
    assert tracker.events() == []
    assert np.abs(ellipse_error(contours.uv, centre, radii, 0.2)).max() < 0.05


def test_the_stairs_of_a_mask_do_not_survive():
    centre, radii = np.array([200.2, 150.7]), np.array([150.0, 90.0])
    share = coverage((300, 400), centre, radii, 0.3)
    mask = (share > 0.5).astype(np.uint8) * 255
    plain = np.full(mask.shape, 90, np.uint8)
    for image, refine in ((plain, "edge"), (photograph(share), "none")):
        contours = contours_of(image, mask, refine=refine)
        error = ellipse_error(contours.uv, centre, radii, 0.3)
        assert np.abs(error).max() < 0.4
        assert abs(error.mean()) < 0.03
        sigma = contours.sigma / contours.radians_per_pixel
        assert 0.5 < error.std() / np.sqrt(np.mean(sigma**2)) < 1.3


def test_a_mask_is_refined_on_the_image():
    centre, radii = np.array([200.2, 150.7]), np.array([150.0, 90.0])
    share = coverage((300, 400), centre, radii, 0.3)
    contours = contours_of(photograph(share), (share > 0.5).astype(np.uint8))
    assert np.abs(ellipse_error(contours.uv, centre, radii, 0.3)).max() < 0.05


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.full((50, 60), 80, np.uint8), "no_object"),
        (np.zeros((50, 60), np.float32), "image_type"),
        (np.zeros((50, 60, 4), np.uint8), "image_shape"),
    ],
)
def test_a_frame_without_contours_says_why_and_the_next_works(image, reason):
    tracker = ContourTracker()
    with pytest.raises(ContourError) as error:
        tracker.process(image, camera_for(image), 0, "turntable")
    assert error.value.reason == reason
    good = photograph(ring()[0])
    assert len(tracker.process(good, camera_for(good), 1, "turntable")) > 900


def test_a_mask_of_another_size_is_refused():
    image = photograph(ring()[0])
    with pytest.raises(ContourError, match="mask is") as error:
        contours_of(image, np.zeros((10, 10), np.uint8))
    assert error.value.reason == "mask_size"


def test_drawing_marks_loops_on_a_copy():
    image = photograph(ring()[0])
    before = image.copy()
    drawn = draw_contours(image, contours_of(image))
    assert drawn.shape == (300, 300, 3)
    assert (image == before).all()
    coloured = (drawn.max(axis=2) != drawn.min(axis=2)).sum()
    assert coloured > 900


def test_pixels_without_a_ray_give_no_samples():
    image = np.full((480, 640), 30, np.uint8)
    image[100:, 200:] = 200  # goes on in the corner, where the lens folds
    camera = replace(camera_for(image), D=np.array([0.131, -0.385, 0, 0]), distortion="plumb_bob")
    camera = replace(camera, K=np.array([[460.0, 0, 320], [0, 460, 240], [0, 0, 1]]))
    contours = ContourTracker(ContourSettings(border_px=0.0)).process(image, camera, 0, "turntable")
    assert 0 < folded_share(camera) < 0.1
    assert (contours.T @ contours.middle > 0.7 * np.linalg.norm(contours.middle)).all()
    assert have_ray(camera, contours.uv).all()
