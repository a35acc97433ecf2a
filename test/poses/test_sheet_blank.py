"""Markers that are not printed are told from those that the object hides."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rendered import GRID, view
from scenes.standing import PAPER, Standing, lying_pebble

from occ_recon_ros.poses import BoardDetector
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.sheet_blank import MissingMarkers, in_words, missing_markers
from occ_recon_ros.scene import SceneObject
from occ_recon_ros.scene.shapes import ball

MIDDLE = tuple(5 * row + column for row in range(1, 6) for column in (1, 2, 3))
FRAME = replace(GRID, not_printed=MIDDLE)
BLUE, WHITE, BLACK = (150.0, 95.0, 55.0), tuple(PAPER), (30.0, 30.0, 30.0)


def plate():
    """Lies on nine of the markers."""
    return SceneObject("plate", (ball((0.06, 0.05, 0.012), (0.004, 0.002, 0.012)),))


@cache
def turn(board, body, colour, count=8):
    """Images of what stands on a board, their cameras, and the markers read in each."""
    scene, detector, views = Standing(body(), board, colour), BoardDetector(GRID), []
    for k in range(count):
        camera = view(2 * np.pi * k / count + 0.1, 0.7, 0.5, 420.0, (480, 360))
        image = scene.photograph(camera, k, 2)
        views.append((image, camera, detector.find(image).marker_ids))
    return views


def missing(views, told=GRID):
    return missing_markers(told, {int(k) for _, _, ids in views for k in ids}, views)


@pytest.mark.parametrize("colour", [BLUE, WHITE, BLACK], ids=["blue", "white", "black"])
def test_the_empty_middle_of_a_frame_is_found(colour) -> None:
    views = turn(FRAME, lying_pebble, colour)
    assert missing(views).blank == MIDDLE
    # Who wrote it into board.yaml is not told of it.
    assert missing(views, FRAME) == MissingMarkers()


@pytest.mark.parametrize("colour", [BLUE, WHITE, BLACK], ids=["blue", "white", "black"])
def test_markers_under_an_object_are_printed(colour) -> None:
    views = turn(GRID, plate, colour)
    read = {int(k) for _, _, ids in views for k in ids}
    assert len(set(GRID.marker_ids.tolist()) - read) > 6  # as white as paper it may be
    assert missing(views) == MissingMarkers()


def test_few_views_do_not_tell() -> None:
    assert missing(turn(FRAME, lying_pebble, BLUE)[:4]) == MissingMarkers()


def test_a_middle_that_is_no_paper_is_told_of_and_not_taken_for_white() -> None:
    width, height = 0.122, 0.198  # of the middle of the frame
    views = []
    for image, camera, ids in turn(FRAME, lying_pebble, BLUE):
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        rays = camera.viewing_directions(np.column_stack([u.ravel(), v.ravel()]))
        at = camera.centre - (camera.centre[2] / rays[:, 2])[:, None] * rays
        within = (np.abs(at[:, :2]) < 0.48 * np.array([width, height])).all(axis=1)
        wood = within.reshape(image.shape[:2]) & (image.min(axis=2) > 100)
        views.append((np.where(wood[..., None], np.uint8([80, 130, 170]), image), camera, ids))
    assert missing(views) == MissingMarkers((), MIDDLE)
    image, camera, _ = views[0]
    backdrop = BoardBackdrop(FRAME)
    spread = backdrop.picture(image, camera)[1]
    u, v = camera.project(np.array([[0.04, 0.08, 0.0]])).astype(int)[0]
    assert np.isinf(spread[v, u])
    assert np.isfinite(backdrop.picture(turn(FRAME, lying_pebble, BLUE)[0][0], camera)[1][v, u])


def test_the_frame_is_drawn_as_it_is_seen() -> None:
    image, camera, _ = turn(FRAME, lying_pebble, BLUE)[2]
    picture, spread = BoardBackdrop(FRAME).picture(image, camera)
    known = np.isfinite(spread)
    off = np.abs(picture - image).max(axis=2)
    hidden = known & (off > np.maximum(5 * spread, 20))
    # The pebble and its shadow; by the whole grid it is the middle of the sheet.
    assert 0.005 < hidden.sum() / known.sum() < 0.2
    whole, doubt = BoardBackdrop(GRID).picture(image, camera)
    wrong = np.isfinite(doubt) & (np.abs(whole - image).max(axis=2) > np.maximum(5 * doubt, 20))
    assert wrong.sum() > 1.5 * hidden.sum()


def test_numbers_are_said_in_runs() -> None:
    assert in_words((6, 7, 8, 11, 13, 12, 20)) == "6-8, 11-13, 20"
    assert in_words(()) == ""
