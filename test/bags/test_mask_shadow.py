"""A soft shadow that mattes half cover is left out, where the images show no edge along it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.frames import Frame
from occ_recon_ros.bags.mask_files import read_mask
from occ_recon_ros.bags.mask_shadow import hold_shadows, without_shadow
from occ_recon_ros.scene import TurntableSettings, render, turntable_cameras
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.shapes import ball, limb
from occ_recon_ros.streams.alone import filled

SIZE = (480, 360)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder = tmp_path_factory.mktemp("turn")
    leaning = limb((0.05, 0.0, -0.06), (-0.03, 0.03, 0.07), 0.03)
    thing = SceneObject("two parts", (leaning, ball((0.03, 0.02, 0.02), (-0.06, -0.02, -0.04))))
    size = {"width": SIZE[0], "height": SIZE[1], "focal_px": 600}
    found = []
    for k, camera in enumerate(turntable_cameras(TurntableSettings(frames=6, step=1.0, **size))):
        loops = thing.exact_contours(camera)
        cv2.imwrite(str(folder / f"{k}.png"), render(thing, camera))
        cv2.imwrite(str(folder / f"m{k}.png"), filled(loops.by_loop(loops.uv), SIZE[::-1]))
        found.append(Frame(folder / f"{k}.png", folder / f"m{k}.png", k + 1, camera))
    return found


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
