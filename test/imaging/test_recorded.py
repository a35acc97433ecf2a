"""The recorded sequences: real images against the masks that came with them."""

import json

import cv2
import numpy as np
import pytest

from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging import ContourTracker


def frames(folder, step):
    described = json.loads((folder / "cameras.json").read_text())
    for frame in described["frames"][::step]:
        D = np.array(frame.get("D") or [])
        camera = Camera(
            np.array(frame["K"]),
            frame["width"],
            frame["height"],
            np.array(frame["R"]),
            np.array(frame["t"]),
            D,
            "plumb_bob" if len(D) else "none",
        )
        mask = cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE)
        yield cv2.imread(str(folder / frame["file"])), mask, camera


def filled(contours, shape):
    inside = np.zeros(shape, np.uint8)
    for loop in np.unique(contours.loop):
        one = np.zeros(shape, np.uint8)
        points = np.round(contours.uv[contours.loop == loop] * 16).astype(np.int32)
        cv2.fillPoly(one, [points], 1, shift=4)
        inside ^= one
    return inside > 0


def distance_from_edge(mask, uv):
    """Distance of points from the squares that the mask's pixels are, to an eighth of a px."""
    fine = 8
    x, y, width, height = cv2.boundingRect(mask)
    part = np.pad(mask[y : y + height, x : x + width], 8)
    part = cv2.resize(part, None, fx=fine, fy=fine, interpolation=cv2.INTER_NEAREST)
    outside = cv2.distanceTransform(255 - part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    inside = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    at = np.floor((uv - [x - 8, y - 8] + 0.5) * fine).astype(int)
    return (np.maximum(outside, inside)[at[:, 1], at[:, 0]] - 0.5) / fine


def test_the_dinosaur_is_found_by_its_colour(shared_data):
    tracker = ContourTracker()
    for i, (image, mask, camera) in enumerate(frames(shared_data / "oxford_dino", 4)):
        inside = filled(tracker.process(image, camera, i, "turntable"), mask.shape)
        given = mask > 0
        assert (inside & given).sum() / (inside | given).sum() > 0.95
    assert tracker.events()[0] == "segmentation: chroma"


@pytest.mark.parametrize("name", ["apple_aruco", "oxford_dino"])
def test_contours_keep_to_the_masks_given(shared_data, name):
    tracker = ContourTracker()
    for i, (image, mask, camera) in enumerate(frames(shared_data / name, 6)):
        contours = tracker.process(image, camera, i, "turntable", mask)
        away = distance_from_edge(mask, contours.uv)
        assert np.percentile(away, 99) < 1.4
        if name == "apple_aruco":
            assert away.max() < 1.5
