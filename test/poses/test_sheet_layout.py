"""A sheet that is not what board.yaml says is named, from the markers in its images."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from rendered import CHARUCO, GRID, photograph, view

from occ_recon_ros.poses import BoardDetector, BoardSpec, board_to_yaml, read_board
from occ_recon_ros.poses.detect import squares_in_view, why_unseen
from occ_recon_ros.poses.intrinsics import BoardView
from occ_recon_ros.poses.sequence import BoardSequence, distinct
from occ_recon_ros.poses.sheet_layout import other_layout, sheet_layout
from occ_recon_ros.poses.sheet_ratio import marker_ratio, wrong_markers
from occ_recon_ros.poses.sheet_zoom import two_zooms

OLDER = replace(CHARUCO, legacy=True)


@cache
def image_of(shown: BoardSpec, k: int):
    """One of the images of a turn, that nobody changes."""
    camera = view(k * 1.2, 0.7, 0.5, f=600.0, size=(640, 480))
    return photograph(shown, camera, samples=2, seed=k)


def looked_at(shown: BoardSpec, told: BoardSpec, count: int = 5) -> BoardSequence:
    """A turn of images of one board, given as another."""
    sequence = BoardSequence(told)
    for k in range(count):
        sequence.add(f"{k}.png", k, image_of(shown, k))
    return sequence


def test_the_older_charuco_layout_is_drawn_as_opencv_draws_it() -> None:
    px, (width, height) = 20, (7, 10)
    drawn = np.full((px * height, px * width), 255, np.uint8)
    for left, top, right, bottom in np.rint(OLDER.black / 0.025 * px).astype(int):
        drawn[top:bottom, left:right] = 0
    theirs = OLDER.aruco_board.generateImage((px * width, px * height))
    assert np.mean(drawn != (theirs > 127) * 255) < 0.03  # cells of a marker are 2.06 px wide
    assert theirs[px // 2, px // 2] != CHARUCO.aruco_board.generateImage((140, 200))[10, 10]


@pytest.mark.parametrize(("shown", "told"), [(OLDER, CHARUCO), (CHARUCO, OLDER)])
def test_the_other_charuco_layout_is_found_by_itself(shown: BoardSpec, told: BoardSpec) -> None:
    camera = view(0.3, 0.8)
    detector = BoardDetector(told)
    found = detector.find(photograph(shown, camera))
    assert len(found.index) > 40
    assert detector.board == shown
    assert np.abs(found.uv - camera.project(shown.corners[found.index])).max() < 0.3


def test_the_layout_that_was_found_is_kept(tmp_path) -> None:
    found = looked_at(OLDER, CHARUCO).solve(None)
    assert found.board == OLDER
    assert len(found.kept) == 5
    path = tmp_path / "board.yaml"
    path.write_text(board_to_yaml(OLDER))
    assert read_board(path) == OLDER
    assert "legacy" not in board_to_yaml(CHARUCO)


@pytest.mark.parametrize(
    ("shown", "told", "words"),
    [
        (GRID, replace(GRID, columns=7, rows=5), "the sheet in view has 5 columns"),
        (GRID, replace(GRID, columns=6), "has 5 columns, board.yaml says 6 x 7"),
        (GRID, replace(GRID, rows=6), "markers 30 to 34 stand on the sheet too"),
        (CHARUCO, replace(CHARUCO, rows=8), "correct rows there, 10 or more"),
        (CHARUCO, replace(CHARUCO, columns=8), "the sheet in view has 7 columns"),
        (GRID, BoardSpec(columns=5, rows=7, square_m=0.038, marker_m=0.03), "kind aruco_grid"),
        (CHARUCO, replace(GRID, columns=7, rows=5), "as of kind charuco"),
        (GRID, replace(GRID, gap_m=0.011), "measure 8.0 mm where board.yaml says 11 mm"),
        (GRID, replace(GRID, gap_m=0.016), "measure about 8 mm where board.yaml says 16 mm"),
        (GRID, replace(GRID, gap_m=0.002), "measure about 8 mm where board.yaml says 2 mm"),
    ],
)
def test_what_board_yaml_has_wrong_is_named(shown, told, words) -> None:
    with pytest.raises(ValueError, match=words):
        looked_at(shown, told).solve(None)


def test_markers_in_another_order_are_no_matter_of_gaps() -> None:
    camera = view(1.2, 0.7, 0.5, f=600.0, size=(640, 480))  # as of image_of(GRID, 1)
    found = looked_at(GRID, GRID, 2).shots[1].found
    assert wrong_markers(GRID, marker_ratio(GRID, camera, camera.pose, found)) == ""
    order = np.random.default_rng(2).permutation(GRID.columns * GRID.rows)
    found = replace(found, index=4 * order[found.index // 4] + found.index % 4)
    said = wrong_markers(GRID, marker_ratio(GRID, camera, camera.pose, found))
    assert said.startswith("the markers stand in another order on the sheet than in board.yaml")


def test_a_gap_is_not_blamed_for_the_calibration_of_another_camera() -> None:
    other = view(f=900.0, size=(640, 480))
    with pytest.raises(ValueError, match="or the calibration of the camera"):
        looked_at(GRID, GRID).solve(other)


@pytest.mark.parametrize("board", [CHARUCO, OLDER, GRID, replace(GRID, columns=1, rows=9)])
def test_a_right_layout_is_not_blamed(board: BoardSpec) -> None:
    sequence = looked_at(board, board)
    seen = [shot.found for shot in sequence.shots]
    told = sheet_layout(seen)
    assert told is None or (told.kind, told.columns) == (board.kind, board.columns)
    assert (told is None) == (board.columns == 1)
    assert other_layout(board, seen) == ""
    assert other_layout(board, []) == ""


def test_markers_with_a_rim_of_two_cells_are_named() -> None:
    sheet = CHARUCO.aruco_board.generateImage((560, 800), marginSize=40, borderBits=2)
    detector = BoardDetector(CHARUCO)
    assert detector.find(sheet).problem is not None
    assert "two cells wide" in why_unseen(detector, sheet)[1]


def test_a_charuco_board_is_not_taken_for_a_plain_chessboard() -> None:
    # Its markers are none of any dictionary, so that only its squares can be seen.
    sheet = CHARUCO.aruco_board.generateImage((560, 800), marginSize=40)
    for k in range(7 * 10):
        x, y = 40 + 69 * (k % 7), 40 + 72 * (k // 7)
        middle = sheet[y + 30 : y + 42, x + 28 : x + 40]
        if 0 < middle.mean() < 255:
            cv2.circle(sheet, (x + 34, y + 36), 12, 120, -1)
    assert squares_in_view(sheet) is not None
    assert why_unseen(BoardDetector(CHARUCO), sheet) is None


def seen_with(focal_px, tilt, count, seed=0, principal=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    for k in range(count):
        camera = view(0.7 * k, tilt, 0.5, f=focal_px)
        uv = camera.project(CHARUCO.corners) + np.array(principal) + rng.normal(0, 0.1, (54, 2))
        yield BoardView(f"{focal_px:g} {tilt:g} {k}", CHARUCO.corners, uv)


def test_two_settings_of_a_zoom_are_named() -> None:
    views = [*seen_with(900, 0.7, 8), *seen_with(1200, 0.7, 5)]
    words = two_zooms(views, (960, 720), 2.0)
    assert "zoom or focus was changed" in words
    assert "px in 8 images (900 0.7 0, 900 0.7 1, 900 0.7 2, 900 0.7 3, ...)" in words
    # Two of them are left out one by one.
    assert two_zooms([*seen_with(900, 0.7, 8), *seen_with(1200, 0.7, 2)], (960, 720), 2.0) == ""


def test_two_heights_of_a_camera_are_no_zoom() -> None:
    # With its principal point this far off, either height alone tells another focal length.
    views = [
        *seen_with(900, 0.5, 8, principal=(0.0, 110.0)),
        *seen_with(900, 1.2, 8, principal=(0.0, 110.0)),
    ]
    assert "zoom" in two_zooms(views, (960, 720), np.inf)
    assert two_zooms(views, (960, 720), 0.15) == ""


def test_copies_of_an_image_count_once() -> None:
    sequence = looked_at(CHARUCO, CHARUCO, 3)
    again = looked_at(CHARUCO, CHARUCO, 3)
    both = [*sequence.shots, *(replace(shot, name=f"copy {shot.name}") for shot in again.shots)]
    kept = distinct(both, sequence.size)
    assert [shot.name for shot in kept] == ["0.png", "1.png", "2.png"]
