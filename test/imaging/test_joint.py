"""Masks of all views together, on rendered and on recorded turns."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from plaster import iou, views_in

from occ_recon_ros.imaging import ContourError
from occ_recon_ros.imaging.joint import JointSegmenter, Volume, joint_masks
from occ_recon_ros.imaging.joint.plane import plane_at
from occ_recon_ros.imaging.joint.space import pixel_of
from occ_recon_ros.imaging.padding import picture_area
from occ_recon_ros.scene import TurntableSettings, turntable_cameras


@pytest.mark.usefixtures("few_heights")
def test_a_recorded_turn_is_segmented_without_its_masks(toy):
    # Another one, before black cloth, is so by the command.
    frames = list(views_in(toy))
    found, masks = joint_masks((image, camera) for image, _, camera in frames)
    scores = [iou(m > 0, given) for m, (_, given, _) in zip(masks, frames, strict=True)]
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9
    assert found.method == "joint"


@pytest.mark.slow
def test_a_wrong_mask_among_given_ones_is_named_and_no_other(plaster):
    segmenter = JointSegmenter()
    for k, (image, true, camera) in enumerate(views_in(plaster)):
        given = np.uint8(255) * true
        segmenter.add(image, camera, np.roll(given, 75, axis=1) if k == 7 else given)
    found = segmenter.solve()
    assert found.method == "given"
    assert [k for k, view in enumerate(found.views) if view.bad] == [7]


def test_too_few_views_are_refused(plaster):
    frames = list(views_in(plaster))[::4]
    with pytest.raises(ContourError) as error:
        joint_masks((image, camera) for image, _, camera in frames)
    assert error.value.reason == "few_views"


@pytest.mark.usefixtures("coarse")
def test_nothing_to_be_seen_is_no_object(plaster):
    frames = list(views_in(plaster))[::2]
    black = [(np.zeros_like(image), camera) for image, _, camera in frames]
    with pytest.raises(ContourError) as error:
        joint_masks(black)
    assert error.value.reason == "no_object"


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_exposure_and_white_balance_that_wander_are_nothing_before_the_object(plaster):
    rng, views = np.random.default_rng(1), []
    for image, _, camera in views_in(plaster):
        gain = np.exp(rng.normal(0, 0.22) + rng.normal(0, 0.06, 3))
        views.append((np.clip(image * gain, 0, 255).astype(np.uint8), camera))
    found, _ = joint_masks(views)
    assert [view.why for view in found.views if view.bad] == []
    assert found.belief > 0.8


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_a_body_of_revolution_is_no_part_of_the_rig():
    # It looks the same in every image, as what stands behind it does.
    rig = TurntableSettings(frames=10, step=0.63, width=160, height=120, focal_px=200.0)
    y, x = np.mgrid[:120, :160]
    views, truth = [], []
    for k, camera in enumerate(turntable_cameras(rig)):
        u, v = camera.project(np.zeros((1, 3)))[0]
        radius = 0.08 * camera.K[0, 0] / np.linalg.norm(camera.centre)
        truth.append((x - u) ** 2 + (y - v) ** 2 < radius**2)
        image = np.dstack([np.where(truth[-1], level, 40.0 + y / 8) for level in (90, 130, 170)])
        image += np.random.default_rng(k).normal(0, 2, image.shape)
        views.append((np.clip(image, 0, 255).astype(np.uint8), camera))
    _, masks = joint_masks(views)
    assert min(iou(mask > 127, right) for mask, right in zip(masks, truth, strict=True)) > 0.9


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("guessed", [False, True])
def test_masks_that_lack_a_part_tell_what_stands_from_the_light_it_stands_in(guessed):
    # The ground is lit about the object alone, and of no colour that the border shows.
    rig = TurntableSettings(frames=10, step=0.63, width=160, height=120, focal_px=200.0)
    y, x = np.mgrid[:120, :160]
    segmenter, views = JointSegmenter(), []
    for k, camera in enumerate(turntable_cameras(rig)):

        def seen(centre, radius, camera=camera):
            u, v = camera.project(np.array([centre]))[0]
            px = radius * camera.K[0, 0] / np.linalg.norm(camera.centre - centre)
            return (x - u) ** 2 + (y - v) ** 2 < px**2

        image = np.full((120, 160, 3), [40.0, 80, 40])
        body = seen([0, 0, 0], 0.05) | seen([0.05, 0, 0.02], 0.03)
        image[seen([0, 0, -0.03], 0.14)] = 90, 200, 90
        image[body] = 60, 60, 190
        image += np.random.default_rng(k).normal(0, 3, image.shape)
        views.append((np.clip(image, 0, 255).astype(np.uint8), body))
        headless = body & (y > np.nonzero(body)[0].min() + 4)
        segmenter.add(views[-1][0], camera, guess=np.uint8(255) * headless if guessed else None)
    found = segmenter.solve()
    scores = [iou(found.mask(k, image) > 0, body) for k, (image, body) in enumerate(views)]
    assert (min(scores) > 0.98) if guessed else (max(scores) < 0.5)


@pytest.mark.parametrize("D", [np.zeros(0), np.array([-0.2, 0.1, 0.001, 0.002, 0.0])])
def test_a_plane_is_seen_where_its_points_are(D):
    camera = replace(turntable_cameras(TurntableSettings(frames=3))[1], D=D, distortion="plumb_bob")
    tilted = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    for half in (0.1, 5.0):  # beyond the camera too
        plane = plane_at(np.array([0.01, 0.02, -0.03]), tilted, half)
        expected, points = camera.project(plane.points(9)), plane.points(9)
        u, v = (c.ravel() for c in plane.in_image(camera, 9))
        before = np.isfinite(expected[:, 0])
        np.testing.assert_allclose(np.stack([u, v], 1)[before], expected[before], rtol=1e-9)
        assert (u[~before] < 0).all()
        index, inside = pixel_of(camera, points)
        np.testing.assert_array_equal(np.rint(expected[inside]) @ [1, camera.width], index[inside])
        assert not inside[~before].any()
    assert not before.all()


@pytest.mark.parametrize("quality", [None, 50])
def test_bars_are_no_part_of_the_picture(quality):
    noise = np.random.default_rng(0).integers(90, 130, (120, 160, 3), np.uint8)
    padded = cv2.copyMakeBorder(noise, 16, 32, 0, 24, cv2.BORDER_CONSTANT)
    if quality:
        code = cv2.imencode(".jpg", padded, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        padded = cv2.imdecode(code, cv2.IMREAD_COLOR)
    rows, columns = picture_area(padded)
    ends = np.array([rows.start, rows.stop, columns.start, columns.stop])
    assert np.abs(ends - [16, 136, 0, 160]).max() <= 8


def test_a_dark_backdrop_is_no_bar():
    dark = np.random.default_rng(0).integers(0, 8, (120, 160), np.uint8)
    dark[40:90, 50:120] = 180
    assert picture_area(dark) == (slice(0, 120), slice(0, 160))


def test_a_volume_holds_what_lies_within():
    points = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.6, 0], [0, 0, 0.9]])
    inside = {
        "box": [True, True, False, False],
        "cylinder": [True, True, False, True],
        "plane": [True, True, True, True],
    }
    for kind, expected in inside.items():
        size = np.array([1.0, 1.0, 2.0 if kind == "cylinder" else 1.0])
        assert Volume(kind, size=size).contains(points).tolist() == expected
    with pytest.raises(ValueError, match="volume_kind"):
        Volume("ball")
