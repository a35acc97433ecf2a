"""Images that were taken otherwise than the others are named."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from occ_recon_ros.evaluation.image_quality import ImageQuality
from occ_recon_ros.imaging.edge_width import edge_width
from occ_recon_ros.report.result import _checked

NOISE = np.random.default_rng(0).normal(0, 2, (240, 320, 3))


def pair(k=0, exposure=1.0, blur=0.0):
    """An image of a dark disc on a light backdrop, and its mask."""
    mask = np.zeros((240, 320), np.uint8)
    cv2.circle(mask, (160 + k, 120), 60, 255, -1)
    image = np.where(mask[..., None] > 127, 60, 140) + np.zeros(3)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    if blur:
        image = cv2.blur(image, (round(blur), 1))
    return np.clip(exposure * image + NOISE, 0, 255).astype(np.uint8), mask


class Views(list):
    """Stands for the views of a bag."""

    def masked(self):
        return any(view.mask is not None for view in self)

    def images(self):
        return [{"name": f"{k}.jpg"} for k in range(len(self))]


def told(pairs):
    views = Views(SimpleNamespace(image=image, mask=mask) for image, mask in pairs)
    step = ImageQuality()
    assert step(views, lambda done, total: None).masks is None
    return step.report


def test_an_edge_is_as_wide_as_it_is_blurred():
    sharp, wide = (edge_width(*pair(blur=blur)) for blur in (0, 9))
    assert 1.5 < sharp < 3
    assert 6 < wide < 11
    grey = pair(blur=9)[0].mean(axis=2).astype(np.uint16) * 257
    assert edge_width(grey, pair()[1]) == pytest.approx(wide, rel=0.1)
    assert np.isnan(edge_width(np.full((240, 320), 90, np.uint8), pair()[1]))
    assert np.isnan(edge_width(pair()[0], np.zeros((240, 320), np.uint8)))


def test_images_that_moved_while_they_were_taken_are_named():
    report = told([pair(k, blur=9 * (k in (2, 7))) for k in range(9)])
    (note,) = report["notes"]
    assert note.startswith("2 of 9 images are blurred: along the outline an edge is")
    assert note.endswith(": 2.jpg, 7.jpg")
    words = _checked({"image_quality": report})
    assert words == "the blurred images (2.jpg, 7.jpg), K, D and poses"
    assert _checked({}) == "K, D and poses"


def test_images_of_two_exposures_are_told():
    report = told([pair(k, exposure=1 + 0.5 * (k > 5)) for k in range(9)])
    (note,) = report["notes"]
    assert "two exposures: 3 of 9 are 1.5 times as bright" in note
    assert note.endswith(": 6.jpg, 7.jpg, 8.jpg")


@pytest.mark.parametrize(
    "pairs",
    [
        [pair(k) for k in range(9)],
        [pair(k, blur=9) for k in range(9)],  # as the camera sees
        [pair(k, exposure=1.06**k) for k in range(9)],  # a light that changes slowly
        [pair(k, exposure=0.02) for k in range(5)],
        # A hand is before two, whose views were left out.
        [pair(k) for k in range(7)] + [(pair(exposure=1.3)[0], np.zeros((240, 320), np.uint8))] * 2,
        [(pair(k)[0], None) for k in range(5)],
        [(pair(k)[0], np.zeros((240, 320), np.uint8)) for k in range(5)],
    ],
)
def test_nothing_is_said_of_images_that_are_alike(pairs):
    assert told(pairs) == {}
