"""Plain chessboards: of any number of squares, behind any lens, and in place of another."""

import cv2
import numpy as np
import pytest
from rendered import CHARUCO, CHESS, photograph, view

from occ_recon_ros.poses import BoardDetector, BoardSpec, read_board
from occ_recon_ros.poses.board import board_to_yaml
from occ_recon_ros.poses.chessboard import find_chessboard
from occ_recon_ros.poses.sequence import BoardSequence

SMALL = view(0.3, 1.0, 0.5, f=450.0, size=(480, 360))


def all_around(count, f, size):
    return [view(2.2 * k, 0.75 + 0.12 * (k % 3), 0.28, f=f, size=size) for k in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("squares", [(9, 7), (8, 6), (8, 8)])
def test_the_camera_comes_of_a_chessboard_that_looks_the_same_upside_down(squares, tmp_path):
    board = BoardSpec("chessboard", *squares, square_m=0.02)
    path = tmp_path / "board.yaml"
    path.write_text(board_to_yaml(board))
    sequence = BoardSequence(read_board(path, for_poses=False))
    for k, camera in enumerate(all_around(7, 600.0, (640, 480))):
        sequence.add(f"{k}", k, photograph(board, camera, seed=k))
    found = sequence.calibrated(sequence.shots, board.corners, None)
    assert found.camera.K[0, 0] == pytest.approx(600, rel=5e-3)
    assert found.rms_px < 0.2


def test_a_chessboard_that_is_overlooked_at_once_is_sought_again():
    camera = view(0.2, 0.42, 0.4, f=450.0, size=(640, 480))
    image = photograph(CHESS, camera)
    assert not len(BoardDetector(CHESS).find(image).index)
    found = BoardDetector(CHESS, thorough=True).find(image)
    assert len(found.index) == len(CHESS.corners)
    off = found.uv - camera.project(CHESS.corners)
    assert np.sqrt(np.mean(off**2)) < 0.03


@pytest.mark.slow
def test_where_no_chessboard_is_none_is_found():
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (240, 320)).astype(np.uint8)
    blocks = cv2.resize(noise[:30, :40], (320, 240), interpolation=cv2.INTER_NEAREST)
    tiles = photograph(BoardSpec("chessboard", 8, 11, square_m=0.025), SMALL)
    for image in (noise, blocks, tiles, photograph(CHARUCO, SMALL)):
        assert not len(find_chessboard(image, CHESS.corners, CHESS.columns - 1, thorough=True))


@pytest.mark.slow
def test_what_most_images_show_in_place_of_the_board_is_named():
    told = BoardSpec("chessboard", 7, 10, square_m=0.025)
    shown = BoardSpec("chessboard", 8, 11, square_m=0.025)
    sequence = BoardSequence(told)
    for k, board in enumerate((CHARUCO, shown, shown)):
        camera = view(0.3 + 0.2 * k, 1.0, 0.5, f=450.0, size=(480, 360))
        sequence.add(f"{k}", k, photograph(board, camera))
    assert "a chessboard of 8 x 11 squares is in view" in sequence.diagnosis()


def test_some_images_without_a_board_are_kept_of_many():
    sequence = BoardSequence(CHARUCO)
    for k in range(101):
        sequence.add(f"{k}", k, np.full((8, 8), k, np.uint8))
    kept = [int(image[0, 0]) for image in sequence._puzzles]
    assert 4 <= len(kept) <= 8
    assert kept[0] == 0
    assert kept[-1] > 80
