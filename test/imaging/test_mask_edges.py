"""Masks that came, held against the edges of their images."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.imaging.joint.mask_edges import MaskEdges

SHAPE, RADIUS = (300, 400), 70
X, Y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))


def print_behind(rng):
    """Black on white, as of a sheet of markers."""
    cells = rng.integers(0, 2, (60, 80)).astype(np.float32)
    return cv2.resize(230 * cells + 10, SHAPE[::-1], interpolation=cv2.INTER_NEAREST)[..., None]


def wood_behind(rng):
    grain = cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 12, sigmaY=1.5)
    return np.array([70, 110, 150]) + 40 * (grain / grain.std())[..., None]


def cloth_behind(rng):
    return np.full((*SHAPE, 3), 12.0)


def doubts(behind, by_px):
    """Of masks of twelve views that are too large by so many px."""
    return looked_at(behind, [by_px] * 12).doubts()


def looked_at(behind, by_px):
    """The masks of views of a green ball, dark towards its rim, each too large by so many px. It is
    not where it was in the view before."""
    rng, found = np.random.default_rng(5), MaskEdges()
    for k, px in enumerate(by_px):
        centre = 150 + 6 * k
        away = np.hypot(X - centre, Y - 150)
        light = np.sqrt(np.clip(1 - (away / RADIUS) ** 2, 0.15, 1))[..., None]
        share = np.clip(RADIUS + 0.5 - away, 0, 1)[..., None]
        image = share * light * np.array([60, 190, 130]) + (1 - share) * behind(rng)
        image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0, 2, image.shape)
        mask = away <= RADIUS + px
        found.add(np.clip(image, 0, 255).astype(np.uint8), 255 * mask.astype(np.uint8))
    return found


@pytest.mark.parametrize("behind", [print_behind, wood_behind, cloth_behind])
def test_masks_beside_the_edge_of_an_object_are_told_before_any_backdrop(behind):
    # Edges of a print are as steep as that of the object, and everywhere: masks too large by 7 px
    # were called good, and small ones said to be those of the image before, and of that after.
    assert doubts(behind, 0) == []
    for by_px, side in ((6, "outside"), (-6, "inside")):
        (doubt,) = doubts(behind, by_px)
        assert side in doubt
        assert any(f"some {px} px" in doubt for px in (5, 6, 7))


@pytest.mark.parametrize(
    "behind",
    [print_behind, *(pytest.param(b, marks=pytest.mark.slow) for b in (wood_behind, cloth_behind))],
)
def test_those_of_some_views_are_told_from_the_others(behind):
    for px in (5, -5):
        rows, off_px = looked_at(behind, [0] * 7 + [px] * 5).off_in_some()
        assert rows.tolist() == [7, 8, 9, 10, 11]
        assert off_px == pytest.approx(px, abs=1.5)
    # One alone may be wrong otherwise, and what differs from view to view is noise of a hand.
    for by_px in ([0] * 12, [5] * 12, [0] * 10 + [5] * 2, [-5, 0, 0, 5] * 3):
        assert not len(looked_at(behind, by_px).off_in_some()[0])


@pytest.mark.parametrize("off_in", [(2,), (1, 2)])
@pytest.mark.parametrize("small_last", [False, True])
def test_of_images_of_two_sizes_masks_are_off_in_pixels_of_their_own(small_last, off_in):
    # In copies of one size they lie beside by half as much in the larger images.
    rng, found = np.random.default_rng(5), MaskEdges()
    views = [(1, 0)] * 6 + [(1, 8 if 1 in off_in else 0)] + [(2, 0)] + [(2, 8)] * 4
    for times, px in views[::-1] if small_last else views:
        shape = (100 * times * 3, 100 * times * 4)
        image, mask = (np.full((*shape, n), 60, np.uint8) for n in (3, 1))
        cv2.circle(image, (200 * times, 150 * times), 70 * times, (200, 180, 40), -1)
        mask = cv2.circle(0 * mask, (200 * times, 150 * times), 70 * times + px, 255, -1)[..., 0]
        noise = rng.normal(0, 2, image.shape).astype(np.float32)
        found.add(np.clip(image + noise, 0, 255).astype(np.uint8), mask)
    rows, off_px = found.off_in_some()
    assert len(rows) == sum(px > 0 for _, px in views)
    assert off_px == pytest.approx(8, abs=1.5)


@pytest.mark.parametrize(("by_px", "said"), [(0, []), (3, ["outside"]), (-3, ["inside"])])
def test_masks_beside_a_soft_edge_are_told_as_well(by_px, said):
    # Of images that are blurred as their masks are off, colours change along these, too: of the
    # most that they do beside it more than half.
    rng, found = np.random.default_rng(5), MaskEdges()
    for k in range(12):
        away = np.hypot(X - 150 - 6 * k, Y - 150)
        share = np.clip(RADIUS + 0.5 - away, 0, 1)[..., None]
        image = share * np.array([60, 190, 130]) + (1 - share) * np.array([150, 90, 60])
        image = cv2.GaussianBlur(image, (0, 0), 1.7) + rng.normal(0, 2, image.shape)
        mask = away <= RADIUS + by_px
        found.add(np.clip(image, 0, 255).astype(np.uint8), 255 * mask.astype(np.uint8))
    doubts = found.doubts()
    assert len(doubts) == len(said)
    assert all(side in doubts[0] for side in said)


@pytest.mark.parametrize("wrong", ["hull", "cut", "shadow"])
def test_masks_that_end_where_images_go_on_are_told(wrong):
    # All of them agree with each other: bodies with a quarter too much or too little were good.
    rng, right, spoilt = np.random.default_rng(5), MaskEdges(), MaskEdges()
    for k in range(12):
        x, y = 200 + 6 * k, 150
        away = np.minimum(np.hypot(X - x, Y - y + 50), np.hypot(X - x - 40, Y - y - 50))
        share = np.clip(40.5 - away, 0, 1)  # two balls
        below = np.hypot((X - x + 30) / 3, Y - y - 95) / 14  # on the ground
        dimmed = 1 - 0.3 * cv2.GaussianBlur((below < 1).astype(np.float32), (0, 0), 8)
        image = share * 190 + (1 - share) * 60 * dimmed + rng.normal(0, 2, SHAPE)
        image = np.clip(image, 0, 255).astype(np.uint8)
        mask = (away <= 40).astype(np.uint8)
        right.add(image, 255 * mask)
        if wrong == "hull":
            mask = cv2.fillConvexPoly(mask, cv2.convexHull(cv2.findNonZero(mask)), 1)
        elif wrong == "cut":
            mask[y + 50 :] = 0
        else:
            mask |= below < 1
        spoilt.add(image, 255 * mask)
    assert right.doubts() == []
    (doubt,) = spoilt.doubts()
    assert doubt.endswith(
        "of the outlines of the masks that came lie where their images show no edge"
    )


def test_an_image_without_an_edge_tells_nothing_of_its_mask():
    told, mask = MaskEdges(), np.zeros((240, 320), np.uint8)
    cv2.circle(mask, (160, 120), 70, 255, -1)
    told.add(np.full((240, 320, 3), 90, np.uint8), mask)
    assert told.off_px() == 0.0
