"""What hides a printed board is found to a fraction of a pixel: the print behind it is known."""

import cv2
import numpy as np
import pytest
from rendered import CHARUCO, view
from scenes.standing import Standing, lying_pebble

from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.board_outline import outlines_before
from occ_recon_ros.scene.coverage import coverage
from occ_recon_ros.scene.render import silhouette_loops

GREY, BLUE = (120.0, 124.0, 130.0), (150.0, 95.0, 55.0)


def camera(k=0, n=12, **more):
    return view(2 * np.pi * k / n, 0.65, 0.4, 400.0, (400, 300), at=(0, 0, 0.015), **more)


def truth(scene, seen_by):
    loops = silhouette_loops(scene.body.silhouette(seen_by, 0.5))
    return coverage(loops, seen_by.width, seen_by.height)


@pytest.mark.parametrize("D", [(), (0.1, -0.2, 0.001, 0.0, 0.0)], ids=["straight", "distorted"])
def test_the_print_is_drawn_as_the_camera_sees_it(D) -> None:
    scene = Standing(lying_pebble(), CHARUCO, GREY, shadow=0.0, noise=0.0)
    seen_by = camera(1, D=D)
    image = scene.photograph(seen_by)
    picture, spread = BoardBackdrop(CHARUCO).picture(image, seen_by)
    free = (cv2.dilate(truth(scene, seen_by), np.ones((7, 7))) == 0) & np.isfinite(spread)
    off = np.abs(picture - image).max(axis=2)[free]
    # Between black and white lie 190 grey levels.
    assert free.sum() > 10_000
    assert np.sqrt(np.mean(off**2)) < 8
    assert np.mean(off < 4 * spread[free]) > 0.95


def test_of_an_image_without_the_board_nothing_is_known() -> None:
    away = view(0.3, 0.65, 0.4, 400.0, (400, 300), at=(3, 0, 0))
    image = np.full((300, 400, 3), 90, np.uint8)
    assert not np.isfinite(BoardBackdrop(CHARUCO).picture(image, away)[1]).any()


@pytest.mark.parametrize(("colour", "most_px"), [(GREY, 0.3), (BLUE, 0.2)], ids=["grey", "blue"])
def test_the_print_does_not_draw_the_outline_to_its_edges(colour, most_px) -> None:
    scene = Standing(lying_pebble(), CHARUCO, colour, shadow=0.3)
    seen_by = camera(2)
    image, covered = scene.photograph(seen_by), truth(scene, seen_by)
    rng = np.random.default_rng(0)
    wave = cv2.GaussianBlur(rng.normal(size=covered.shape), (0, 0), 5)
    rough = cv2.GaussianBlur(covered, (0, 0), 2) + 0.15 * wave / wave.std() > 0.5
    known = BoardBackdrop(CHARUCO).picture(image, seen_by)
    loops = outlines_before(image, *known, rough.astype(np.uint8) * np.uint8(255))
    found = coverage(loops, seen_by.width, seen_by.height)
    length = sum(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum() for p in loops)
    # Area between the outlines over their length: their mean distance.
    assert np.abs(rough - covered).sum() / length > 0.7
    assert np.abs(found - covered).sum() / length < most_px
