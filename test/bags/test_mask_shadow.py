"""A soft shadow that mattes half cover is left out, where the images show no edge along it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from two_parts import frames_of_two_parts

from occ_recon_ros.bags.mask_files import read_mask
from occ_recon_ros.bags.mask_shadow import hold_shadows, without_shadow

SIZE = (480, 360)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    return frames_of_two_parts(tmp_path_factory.mktemp("turn"), SIZE, 600, 0.03)


def redrawn(frames, folder, change):
    found = []
    for frame in frames:
        path = folder / frame.mask.name
        mask = cv2.imread(str(frame.mask), 0)
        cv2.imwrite(str(path), cv2.GaussianBlur(change(mask), (0, 0), 1.0))
        found.append(replace(frame, mask=path))
    return found


def shadowed(mask, level=150):
    x, y, width, height = cv2.boundingRect(mask)
    shadow = np.zeros_like(mask)
    at = (x + width // 2 + 24, y + height - 6)
    cv2.ellipse(shadow, at, (width // 2 + 16, 28), 0, 0, 360, level, -1)
    return np.maximum(mask, cv2.GaussianBlur(shadow, (0, 0), 2))


def translucent(mask):
    _, y, _, height = cv2.boundingRect(mask)
    thin = mask.copy()
    thin[y + height // 2 :] = 0.6 * thin[y + height // 2 :]
    return thin


def agreement(mask, frame):
    inside, wanted = mask > 127, cv2.imread(str(frame.mask), 0) > 127
    return np.count_nonzero(inside & wanted) / np.count_nonzero(inside | wanted)


@pytest.mark.parametrize("level", [150, 190])
def test_a_shadow_that_is_half_covered_is_left_out(frames, tmp_path, level):
    given = redrawn(frames, tmp_path, lambda mask: shadowed(mask, level))
    assert hold_shadows(given)
    for frame, right in zip(given, frames, strict=True):
        mask = read_mask(frame.mask, SIZE, frame.image)
        assert agreement(mask, right) < 0.85
        assert agreement(without_shadow(mask), right) > 0.93


@pytest.mark.parametrize("change", [np.copy, translucent])
def test_soft_edges_and_parts_that_are_seen_through_stay(frames, tmp_path, change):
    assert not hold_shadows(redrawn(frames, tmp_path, change))


def test_masks_without_anything_like_that_are_not_touched(frames):
    assert not hold_shadows(frames)
    mask = read_mask(frames[0].mask)
    assert without_shadow(mask) is mask


def test_one_mask_of_many_is_no_reason(frames, tmp_path):
    given = redrawn(frames, tmp_path, shadowed)
    assert not hold_shadows([given[0], *frames[1:]])
