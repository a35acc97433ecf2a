"""Masks that came and hold more than the object, by what the others refute of them."""

import cv2
import numpy as np
import pytest

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.advice import PART, of_remark
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.evaluation.trimmed import trimmed
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.alone import Outlines

SIZE, VIEWS, SPOILT = (200, 160), 12, (1, 4, 5, 8, 11)  # too many to leave out
BALLS = ((0.0, 0.0, 0.0, 0.05), (0.03, 0.01, 0.045, 0.025))  # x, y, z, radius, metres


def camera(k):
    """On a circle about the object, a little above it."""
    a = 2 * np.pi * k / VIEWS
    centre = np.array([0.4 * np.cos(a), 0.4 * np.sin(a), 0.12])
    z = -centre / np.linalg.norm(centre)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    K = np.array([[300.0, 0, SIZE[0] / 2], [0, 300, SIZE[1] / 2], [0, 0, 1]])
    return Camera(K, *SIZE, R, -R @ centre)


def silhouette(seen, balls=BALLS):
    """(h, w) uint8 of two balls."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    T = seen.viewing_directions(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    away = [
        np.linalg.norm(np.cross(np.array(b[:3]) - seen.centre, T), axis=1) - b[3] for b in balls
    ]
    return 255 * (np.min(away, axis=0) < 0).reshape(u.shape).astype(np.uint8)


def with_table(mask):
    """From its middle on down, and to the sides."""
    mask = mask.copy()
    mask[95:135, 20:180] = 255
    return mask


def with_bite(mask):
    mask = mask.copy()
    mask[70:95, 60:105] = 0
    return mask


def beside(mask):
    return np.roll(mask, 20, axis=1)


def turn(spoil, spoilt=SPOILT):
    """Cameras, right masks, and masks that came."""
    cameras = [camera(k) for k in range(VIEWS)]
    truth = [silhouette(seen) for seen in cameras]
    return cameras, truth, [spoil(m) if k in spoilt else m for k, m in enumerate(truth)]


def image_of(truth, mask=None):
    """A dark fruit before dark; and something bright, where a mask holds more."""
    image = np.where(truth[..., None] > 0, (40, 60, 50), (48, 48, 48)).astype(np.uint8)
    if mask is not None:
        image[(mask > 0) & (truth == 0)] = 160, 150, 140
    return cv2.GaussianBlur(image, (0, 0), 0.7)


def iou(a, b):
    return np.count_nonzero((a > 127) & (b > 127)) / np.count_nonzero((a > 127) | (b > 127))


@pytest.mark.parametrize(("spoil", "which"), [(with_table, SPOILT), (with_bite, ()), (beside, ())])
def test_only_what_others_refute_is_cut_off(spoil, which):
    cameras, truth, masks = turn(spoil)
    seen = Outlines()
    for k, (own, mask) in enumerate(zip(cameras, masks, strict=True)):
        seen.add(image_of(truth[k]), own, k, mask)
    found = trimmed(masks, seen.contours, cameras)
    assert tuple(found) == which
    for k, own in found.items():
        assert own.share > 0.2
        assert iou(masks[k], truth[k]) < 0.8
        assert iou(own.mask, truth[k]) > 0.97


class Turn(list):
    changes = Changes()

    def images(self):
        return []

    def masked(self):
        return True

    def told_of_masks(self):
        return {}

    def cameras(self):
        return {view.stamp_ns: view.camera for view in self}

    def some(self, numbers):
        return [self[k] for k in numbers]


def test_masks_with_pieces_of_table_are_worth_more_than_images():
    # All were dropped where more than two in five held more than the object, and a dark fruit was
    # lost on its dark table.
    cameras, truth, masks = turn(with_table)
    rows = enumerate(zip(cameras, truth, masks, strict=True))
    views = Turn(View(k, own, image_of(right), mask) for k, (own, right, mask) in rows)
    step = Segmentation()
    found = step(views, lambda *_: None).masks
    assert min(iou(found[k], right) for k, right in enumerate(truth)) > 0.97
    assert step.report["way"] == "given"
    assert tuple(step.report["bad_views"]) == SPOILT
    assert all("of its mask: cut off" in why for why in step.report["bad_views"].values())


@pytest.mark.parametrize("spoilt", [SPOILT, (1, 3, 4, 5, 8, 11)])
def test_a_stand_in_some_masks_is_cut_off_and_doubted_though_it_has_edges(spoilt):
    # Masks that lie on edges were taken for right, all of them, and a right body called failed.
    cameras, truth, masks = turn(with_table, spoilt)
    rows = enumerate(zip(cameras, truth, masks, strict=True))
    views = Turn(View(k, own, image_of(right, mask), mask) for k, (own, right, mask) in rows)
    step = Segmentation()
    found = step(views, lambda *_: None).masks
    assert min(iou(found[k], right) for k, right in enumerate(truth)) > 0.97
    assert tuple(step.report["bad_views"]) == spoilt
    (doubt,) = step.report["warnings"]
    assert f"{len(spoilt)} of 12 masks hold what the others leave out" in doubt
    assert ("nobody can tell" in doubt) == (2 * len(spoilt) == VIEWS)
    assert of_remark(doubt, "") == PART


@pytest.mark.slow
def test_a_stand_stays_cut_off_where_an_image_gets_its_mask_from_all():
    # The masks that came were put back, whole, for a stand lies on edges; and nothing said a word.
    cameras, truth, masks = turn(with_table)
    rows = enumerate(zip(cameras, truth, masks, strict=True))
    views = Turn(
        View(k, own, image_of(right, mask), None if k == 0 else mask)
        for k, (own, right, mask) in rows
    )
    step = Segmentation()
    found = step(views, lambda *_: None).masks
    assert min(iou(found[k], truth[k]) for k in SPOILT) > 0.97
    assert {*SPOILT} <= {*step.report["bad_views"]}
    said = f"{len(SPOILT)} of 11 masks hold what the others leave out"
    assert any(said in doubt for doubt in step.report["warnings"])


def test_masks_of_the_fewer_that_lack_a_part_are_left_out():
    less = (1, 4, 5, 8, 11)
    cameras, truth, _ = turn(with_table)
    masks = list(truth)
    for k in less:
        masks[k] = silhouette(cameras[k], BALLS[:1])
    rows = enumerate(zip(cameras, truth, masks, strict=True))
    views = Turn(View(k, own, image_of(right), mask) for k, (own, right, mask) in rows)
    step = Segmentation()
    found = step(views, lambda *_: None).masks
    assert all(found[k].any() == (k not in less) for k in range(VIEWS))
    assert tuple(step.report["bad_views"]) == less
    assert all("left out" in why for why in step.report["bad_views"].values())
    (doubt,) = step.report["warnings"]
    assert "5 of 12 masks leave out what the others hold" in doubt
    assert of_remark(doubt, "") == PART
