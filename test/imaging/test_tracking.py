"""What the tracker keeps from image to image: snakes, identities, the model of the rig."""

import cv2
import numpy as np
import pytest
from discs import camera_for, coverage, ellipse_error, photograph

from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.identity import Identities

SHAPE = (300, 400)
RADII = np.array([110.0, 80.0])


def disc(i):
    """An ellipse that drifts by 1.5 px an image: its share of each pixel, and its centre."""
    centre = np.array([180.3 + 1.5 * i, 150.2])
    return coverage(SHAPE, centre, RADII, 0.2), centre


def blob(centre, radii):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    r = np.hypot((x - centre[0]) / radii[0], (y - centre[1]) / radii[1])
    return 1 / (1 + np.exp(np.clip(10 * (r - 1), -50, 50)))


def follow(images, **settings):
    tracker = ContourTracker(ContourSettings(**settings))
    return tracker, [
        tracker.process(image, camera_for(image), i, "turntable") for i, image in enumerate(images)
    ]


def vanishing_edge():
    """Images in which the backdrop becomes as dark as the object beside a tenth of it."""
    images = []
    for i in range(8):
        share, centre = disc(i)
        hidden = blob((centre[0] + 112, centre[1]), (45, 30)) if i >= 2 else 0.0
        outside = 170 - 100 * hidden
        image = cv2.GaussianBlur(outside + (70 - outside) * share, (0, 0), 1.0)
        noise = np.random.default_rng(i).normal(0, 2, image.shape)
        images.append(np.round(image + noise).clip(0, 255).astype(np.uint8))
    return images


def test_a_snake_holds_the_outline_where_the_edge_vanishes():
    _, centre = disc(7)
    _, found = follow(vanishing_edge(), tracking="snake")
    error = ellipse_error(found[-1].uv, centre, RADII, 0.2)
    assert np.abs(error).max() < 2.0
    _, plain = follow(vanishing_edge())
    assert np.abs(ellipse_error(plain[-1].uv, centre, RADII, 0.2)).max() > 20.0


def test_where_the_snake_sees_no_edge_its_sigma_is_large():
    _, centre = disc(7)
    _, found = follow(vanishing_edge(), tracking="snake")
    last = found[-1]
    sigma = last.sigma / last.radians_per_pixel
    hidden = np.linalg.norm((last.uv - centre - [112, 0]) / [40, 25], axis=1) < 0.8
    assert hidden.sum() > 20
    assert sigma[hidden].min() > 0.9
    assert np.median(sigma[~hidden]) < 0.1


def test_a_change_of_exposure_does_not_shake_the_snake():
    images = [
        photograph(disc(i)[0], 60 * g, 160 * g, noise=2.0) for i, g in enumerate((1, 1.3, 0.7))
    ]
    tracker, found = follow(images, tracking="snake")
    assert tracker.events() == ["segmentation: threshold"]
    assert np.abs(ellipse_error(found[-1].uv, disc(2)[1], RADII, 0.2)).max() < 0.1


@pytest.mark.parametrize("tracking", ["none", "snake"])
def test_loops_keep_their_identity_until_they_close(tracking):
    images = []
    for i in range(6):
        share, centre = disc(i)
        if 2 <= i < 4:
            share = share - coverage(SHAPE, centre, np.array([20.0, 20.0]), 0.0)
        images.append(photograph(share, noise=2.0))
    tracker, found = follow(images, tracking=tracking)
    outer = {int(c.loop[0]) for c in found}
    assert len(outer) == 1
    assert [len(c.loop_starts) - 1 for c in found] == [1, 1, 2, 2, 1, 1]
    assert len({int(c.loop[-1]) for c in found[2:4]}) == 1
    said = " | ".join(tracker.events())
    assert "appeared: hole" in said
    assert "ended" in said


def test_a_new_object_elsewhere_is_segmented_anew():
    images = [photograph(disc(0)[0])] * 2
    images.append(photograph(coverage(SHAPE, np.array([330.0, 60.0]), np.array([40.0, 40.0]), 0.0)))
    tracker, found = follow(images, tracking="snake")
    assert any("segmented anew" in e for e in tracker.events())
    error = ellipse_error(found[-1].uv, np.array([330.0, 60.0]), np.array([40.0, 40.0]), 0.0)
    assert np.abs(error).max() < 0.1


def test_reset_forgets_the_loops_and_the_choice():
    tracker, _ = follow([photograph(disc(0)[0])], tracking="snake")
    tracker.events()
    tracker.reset()
    image = photograph(coverage(SHAPE, np.array([90.0, 60.0]), np.array([30.0, 30.0]), 0.0))
    contours = tracker.process(image, camera_for(image), 9, "turntable")
    assert tracker.events() == ["segmentation: threshold"]
    assert set(contours.loop) == {0}


def test_the_empty_rig_is_learnt_from_the_first_images():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rig = 120 + 60 * np.sin(x / 9.0) * np.sin(y / 7.0)
    tracker = ContourTracker(ContourSettings(segmentation="background", background_frames=2))
    for i in range(2):
        empty = np.round(rig).astype(np.uint8)
        with pytest.raises(ContourError) as error:
            tracker.process(empty, camera_for(empty), i, "turntable")
        assert error.value.reason == "background_frame"
    assert tracker.events() == ["segmentation: background"]
    share, centre = disc(0)
    image = np.round(cv2.GaussianBlur(rig * (1 - share) + 10 * share, (0, 0), 0.7)).astype(np.uint8)
    contours = tracker.process(image, camera_for(image), 3, "turntable")
    assert np.percentile(np.abs(ellipse_error(contours.uv, centre, RADII, 0.2)), 90) < 0.5


def test_the_empty_rig_comes_from_a_file(tmp_path):
    share, centre = disc(0)
    empty = np.full(SHAPE, 160, np.uint8)
    empty[:, :30] = 40  # a post beside the object
    cv2.imwrite(str(tmp_path / "empty.png"), empty)
    image = np.minimum(photograph(share, noise=2.0), empty)
    for segmentation in ("auto", "background"):
        settings = {"segmentation": segmentation, "background_image": str(tmp_path / "empty.png")}
        tracker, found = follow([image], **settings)
        assert tracker.events() == ["segmentation: background"]
        assert len(found[0].loop_starts) == 2
        assert np.abs(ellipse_error(found[0].uv, centre, RADII, 0.2)).max() < 0.1


def test_a_missing_picture_of_the_empty_rig_is_named():
    tracker = ContourTracker(ContourSettings(segmentation="background", background_image="no.png"))
    image = photograph(disc(0)[0])
    with pytest.raises(ContourError, match=r"no\.png") as error:
        tracker.process(image, camera_for(image), 0, "turntable")
    assert error.value.reason == "background_image"


def test_a_slanting_light_on_the_backdrop_is_evened_out():
    share, centre = disc(0)
    x = np.linspace(95, 240, SHAPE[1])
    image = np.round(cv2.GaussianBlur(x * (1 - share) + 60 * share, (0, 0), 1.0)).astype(np.uint8)
    contours = follow([image])[1][0]
    assert np.abs(ellipse_error(contours.uv, centre, RADII, 0.2)).max() < 0.1


def test_outside_of_the_region_of_interest_nothing_counts():
    share = disc(0)[0] + coverage(SHAPE, np.array([350.0, 40.0]), np.array([25.0, 25.0]), 0.0)
    contours = follow([photograph(share)], roi_x=40, roi_y=0, roi_width=270, roi_height=300)[1][0]
    assert len(contours.loop_starts) == 2
    assert contours.uv[:, 0].max() < 300
    with pytest.raises(ContourError) as error:
        follow([photograph(share)], roi_x=400)
    assert error.value.reason == "roi"


def test_corners_are_marked_and_smooth_bends_are_not():
    square = np.full(SHAPE, 160, np.uint8)
    square[80:220, 100:300] = 60
    contours = follow([cv2.GaussianBlur(square, (0, 0), 1.0)])[1][0]
    marked = contours.uv[~np.isfinite(contours.sigma)]
    corners = np.array([[99.5, 79.5], [299.5, 79.5], [299.5, 219.5], [99.5, 219.5]])
    away = np.linalg.norm(marked[:, None] - corners, axis=2).min(axis=1)
    assert away.max() < 8
    assert all((np.linalg.norm(marked - corner, axis=1) < 4).any() for corner in corners)
    bend = coverage(SHAPE, np.array([150.0, 150.0]), np.array([8.0, 8.0]), 0.0)
    assert np.isfinite(follow([photograph(bend)])[1][0].sigma).all()


def test_two_pixels_are_no_object():
    image = np.full((80, 80), 160, np.uint8)
    image[40, 40:42] = 40
    with pytest.raises(ContourError) as error:
        follow([image])
    assert error.value.reason == "no_object"


def test_identities_follow_loops_that_trade_places_in_the_list():
    angle = -np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    identities = Identities()
    names, said = identities.name([40 * ring, 30 * ring + 200])
    assert (names, said) == ([0, 1], [])
    names, said = identities.name([31 * ring + 203, 40 * ring + 2])
    assert (names, said) == ([1, 0], [])
    names, said = identities.name([40 * ring + 3, 12 * ring[::-1] + 5])
    assert names == [0, 2]
    assert said == ["loop 2 appeared: hole, 75 px around", "loop 1 ended"]
