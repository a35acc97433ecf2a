"""The recorded sequences: real images against the masks that came with them."""

from itertools import islice

import numpy as np
import pytest
from recorded import from_mask, real_frames, region

from occ_recon_ros.imaging import ContourTracker


def frames(folder, step):
    return islice(real_frames(folder), 0, None, step)


def test_the_dinosaur_is_found_by_its_colour(shared_data):
    tracker = ContourTracker()
    for i, (image, mask, camera) in enumerate(frames(shared_data / "oxford_dino", 4)):
        inside = region(tracker.process(image, camera, i, "turntable"), mask.shape)
        given = mask > 0
        assert (inside & given).sum() / (inside | given).sum() > 0.95
    assert tracker.events()[0] == "segmentation: chroma"


@pytest.mark.parametrize("name", ["apple_aruco", "oxford_dino"])
def test_contours_keep_to_the_masks_given(shared_data, name):
    tracker = ContourTracker()
    for i, (image, mask, camera) in enumerate(frames(shared_data / name, 6)):
        contours = tracker.process(image, camera, i, "turntable", mask)
        away = from_mask(contours.uv, mask)
        assert np.percentile(away, 99) < 1.4
        if name == "apple_aruco":
            assert away.max() < 1.5
