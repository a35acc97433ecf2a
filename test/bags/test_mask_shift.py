"""Masks that are those of the images after or before are taken for these."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.frames import Frame
from occ_recon_ros.bags.mask_shift import masks_in_place
from occ_recon_ros.scene import TurntableSettings, render, turntable_cameras
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.shapes import ball, limb
from occ_recon_ros.streams.alone import filled

VIEWS = 9


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder = tmp_path_factory.mktemp("turn")
    leaning = limb((0.05, 0.0, -0.06), (-0.03, 0.03, 0.07), 0.02)
    thing = SceneObject("two parts", (leaning, ball((0.03, 0.02, 0.02), (-0.06, -0.02, -0.04))))
    size = {"width": 160, "height": 120, "focal_px": 200}
    cameras = turntable_cameras(TurntableSettings(frames=24, step=2 * np.pi / 24, **size))
    found = []
    for k, step in enumerate((0, 9, 4, 14, 2, 19, 7, 12, 21)):  # by hand
        camera = cameras[step]
        loops = thing.exact_contours(camera)
        mask = filled(loops.by_loop(loops.uv), (120, 160))
        cv2.imwrite(str(folder / f"{k}.png"), render(thing, camera))
        cv2.imwrite(str(folder / f"m{k}.png"), mask)
        found.append(Frame(folder / f"{k}.png", folder / f"m{k}.png", k + 1, camera))
    return found


def with_masks(frames, places):
    return [
        replace(frame, mask=None if place is None else frames[place].mask)
        for frame, place in zip(frames, places, strict=True)
    ]


@pytest.mark.parametrize(("by", "said"), [(1, "one place after"), (-2, "2 places before")])
def test_masks_of_other_images_are_given_to_these(frames, by, said):
    given = with_masks(frames, [(k + by) % VIEWS for k in range(VIEWS)])
    found, (remark,) = masks_in_place(given)
    assert found == frames
    assert f"the masks are of the images {said} theirs" in remark


def test_where_the_first_is_missing_its_image_has_none(frames):
    found, (remark,) = masks_in_place(with_masks(frames, [*range(1, VIEWS), None]))
    assert found[1:] == frames[1:]
    assert found[0].mask is None
    assert remark.endswith("; 1 images have none then")


def test_masks_of_two_images_that_fit_each_other_are_exchanged(frames):
    found, (remark,) = masks_in_place(with_masks(frames, [0, 1, 2, 3, 4, 5, 6, 8, 7]))
    assert found == frames
    assert remark.startswith("the masks of 7.png and 8.png fit each other's images")
    assert remark.endswith("they are exchanged")
    order = [0, 1, 2, 3, 4, 5, 6, 8, 7]
    called = [replace(frame, image=frames[k].image) for frame, k in zip(frames, order, strict=True)]
    found, (remark,) = masks_in_place(called)
    assert found == called
    assert "have each other's names" in remark


def test_right_masks_and_those_of_no_order_stay(frames):
    assert masks_in_place(frames) == (frames, [])
    mixed = with_masks(frames, [3, 1, 4, 0, 5, 8, 2, 6, 7])
    assert masks_in_place(mixed) == (mixed, [])


def test_where_masks_agree_in_these_poses_it_may_be_the_images(frames):
    called = [replace(f, image=frames[(k + 1) % VIEWS].image) for k, f in enumerate(frames)]
    found, (remark,) = masks_in_place(called)
    assert found == called
    assert "whether it is images that are called by other numbers" in remark
