"""The board: its corners, its file and its printed sheet."""

import numpy as np
import pypdfium2
import pytest
from rendered import CHARUCO, CHESS, GRID

from occ_recon_ros.poses import (
    BoardDetector,
    BoardSpec,
    board_from_mapping,
    board_to_yaml,
    read_board,
    sheet_pdf,
)

BOARDS = pytest.mark.parametrize("board", [CHARUCO, GRID, CHESS], ids=lambda b: b.kind)


def printed(pdf: bytes, dpi: float) -> np.ndarray:
    """The page as another program draws it, (h, w) uint8."""
    page = pypdfium2.PdfDocument(pdf)[0]
    image = page.render(scale=dpi / 72, grayscale=True).to_numpy()
    return np.ascontiguousarray(image.reshape(image.shape[:2]))


@BOARDS
def test_the_sheet_shows_the_corners_at_their_true_distances(board: BoardSpec) -> None:
    dpi = 300.0
    found = BoardDetector(board).find(printed(sheet_pdf(board), dpi))
    assert len(found.index) == len(board.corners)
    mm = found.uv / dpi * 25.4
    true = 1e3 * board.corners[found.index, :2] * [1, -1]
    error = (mm - mm.mean(axis=0)) - (true - true.mean(axis=0))
    assert np.abs(error).max() < 0.05  # half a pixel of 300 dpi


def test_the_scale_bar_measures_100_mm() -> None:
    dpi = 600.0
    image = printed(sheet_pdf(CHARUCO), dpi)
    rows = image[-int(8.3 * dpi / 25.4) : -int(7.7 * dpi / 25.4)]
    dark = np.flatnonzero((rows < 128).any(axis=0))
    assert (dark[-1] - dark[0]) / dpi * 25.4 == pytest.approx(100, abs=0.3)


@BOARDS
def test_a_board_comes_back_from_its_file(board: BoardSpec, tmp_path) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(board_to_yaml(board))
    assert np.array_equal(read_board(path).corners, board.corners)


def test_a_board_whose_middle_is_empty_comes_back_from_its_file(tmp_path) -> None:
    path = tmp_path / "board.yaml"
    frame = BoardSpec("aruco_grid", 3, 3, marker_m=0.03, gap_m=0.01, not_printed=(4,))
    path.write_text(board_to_yaml(frame))
    assert read_board(path) == frame
    whole = BoardSpec("aruco_grid", 3, 3, marker_m=0.03, gap_m=0.01)
    assert "not_printed" not in board_to_yaml(whole)
    middle = (np.abs(frame.black[:, :2] - 0.055) < 0.015).all(axis=1)
    assert not middle.any()
    assert len(frame.black) < len(whole.black)


def test_the_board_frame_is_in_the_middle_with_y_up() -> None:
    corners = CHARUCO.corners
    assert corners.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert corners[0] == pytest.approx([-0.0625, 0.1, 0])  # top left, 25 mm from two sides


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"kind": "circles"}, "unknown kind"),
        ({"columns": 2}, "columns must be"),
        ({"square_m": 0.0}, "square_m"),
        ({"marker_m": 18}, "is in metres: 18 mm are 0.018"),
        ({"marker_m": float("nan")}, "must be a number of metres, got nan"),
        ({"marker_m": "18 mm"}, "text in YAML: write 0.018"),
        ({"marker_m": "18e-3"}, "text in YAML: write 0.018"),
        ({"marker_m": "0,018"}, "text in YAML: write 0.018"),
        ({"marker_m": "some mm"}, "must be a number of metres, got 'some mm'$"),
        ({"legacy": "yes"}, "true or false"),
        ({"marker_m": 0.03}, "smaller than square_m"),
        ({"dictionary": "DICT_9X9"}, "unknown dictionary"),
        ({"dictionary": "DICT_4X4_50", "columns": 20}, "has 0 to 49"),
        ({"columns": 7.5}, "whole number"),
        ({"not_printed": 6}, "a list of numbers of markers"),
        ({"not_printed": [6, "7"]}, "a list of numbers of markers"),
        ({"not_printed": [6, 35]}, "35, which is no marker of the board"),
        ({"not_printed": list(range(35))}, "all markers"),
        ({"colums": 7}, "no use for 'colums'"),
    ],
)
def test_a_board_that_cannot_be_is_refused_in_words(change: dict, complaint: str) -> None:
    whole = {
        "kind": "charuco",
        "columns": 7,
        "rows": 10,
        "square_m": 0.025,
        "marker_m": 0.018,
        "dictionary": "DICT_5X5_100",
    }
    with pytest.raises(ValueError, match=complaint):
        board_from_mapping(whole | change)


@pytest.mark.parametrize("squares", [(9, 7), (8, 6), (8, 8)])
def test_a_chessboard_that_looks_the_same_upside_down_tells_no_pose(squares, tmp_path) -> None:
    # ROS's tutorials have 8x6 corners: 9x7 squares.
    board, path = BoardSpec("chessboard", *squares, square_m=0.02), tmp_path / "board.yaml"
    path.write_text(board_to_yaml(board))
    assert read_board(path, for_poses=False) == board
    size = "{}x{}".format(*squares)
    words = rf"board\.yaml: a chessboard of {size} squares looks the same upside down.*intrinsics"
    with pytest.raises(ValueError, match=words):
        read_board(path)
    assert not CHESS.why_no_pose


def test_a_board_too_large_for_the_paper_is_refused() -> None:
    with pytest.raises(ValueError, match="a4 has room"):
        sheet_pdf(BoardSpec(columns=20, rows=9))
    assert sheet_pdf(BoardSpec(columns=15, rows=10), "a3")


@pytest.mark.parametrize("text", ["", "[1, 2]", "kind: [", "kind: charuco"])
def test_a_file_that_is_no_board_is_refused(text: str, tmp_path) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"board\.yaml"):
        read_board(path)


def test_the_sheet_in_place_of_its_file_is_told(tmp_path) -> None:
    (tmp_path / "ap.pdf").write_bytes(b"%PDF-1.4")
    with pytest.raises(ValueError, match=r"ap\.pdf is the sheet to print: give ap\.yaml"):
        read_board(tmp_path / "ap.pdf")
