"""The corners of a printed board in an image, and what is amiss when they are not there."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

from .board import BoardSpec, marker_dictionary
from .chessboard import find_chessboard, squares_in_view
from .marker_edges import edge_blur, side_corners
from .saddles import refine_saddles

Image = NDArray[np.uint8]

_FEWEST_CORNERS = 4
_MANY_OUTSIDE = 0.5  # share of markers that are not on the board: it is another one
_DUPLICATES = 2  # one marker twice may be a reflection
_TELLING = 8  # markers that must have corners between them, and corners that tell a layout


@dataclass(frozen=True)
class Detection:
    """What was found of a board in one image.

    Attributes:
        index: (n,) which of the board's corners.
        uv: (n, 2) float64, where they are, pixels (as received, distorted).
        markers: how many of the board's markers were read.
        twice: how many of the board's markers were read in two places.
        marker_uv: (m, 4, 2) float64, corners of the markers that were read once, pixels.
        marker_ids: (m,) their numbers.
        other_uv, other_ids: the same of markers of the dictionary that are not on the board.
    """

    index: NDArray[np.intp]
    uv: Array
    markers: int
    twice: int
    marker_uv: Array
    marker_ids: NDArray[np.intp]
    other_uv: Array
    other_ids: NDArray[np.intp]

    @property
    def problem(self) -> tuple[str, str] | None:
        """Why no pose can be had: a short name and a sentence; None when one may be."""
        if self.twice >= _DUPLICATES:
            return "two_boards", (
                f"{self.twice} markers are seen twice: two boards are in view; cover one"
            )
        strangers = len(self.other_ids)
        if strangers > _MANY_OUTSIDE * (strangers + self.markers):
            return "wrong_board", (
                f"{strangers} of {strangers + self.markers} markers are not on the "
                "board: board.yaml describes another one"
            )
        if not self.markers and not len(self.index):
            return "no_board", "no board is in view"
        if len(self.index) < _FEWEST_CORNERS:
            return "few_corners", (
                f"only {len(self.index)} corners of the board are in view, "
                f"{_FEWEST_CORNERS} are needed"
            )
        return None


class BoardDetector:
    """Finds one board in image after image.

    A ChArUco board whose markers are there and its corners are not may have the other of OpenCV's
    two layouts: the first image that tells of one decides.

    Args:
        board: what to look for.
        thorough: as the attribute.

    Attributes:
        board: what is found; its ``legacy`` may be another than was given.
        thorough: look again for a chessboard that is not found at once, which takes its time.
    """

    def __init__(self, board: BoardSpec, thorough: bool = False) -> None:
        self.board, self.thorough = board, thorough
        if board.kind == "chessboard":
            return
        self._markers = cv2.aruco.ArucoDetector(board.aruco_dictionary, _parameters(board))
        if board.kind == "charuco":
            one = cv2.aruco.CharucoParameters()
            one.minMarkers = 1  # of the two beside a corner; the object hides many
            self._one = one
            self._charuco = cv2.aruco.CharucoDetector(board.aruco_board, one)
            self._layout_known = board.rows % 2 == 1  # both layouts are the same

    @property
    def _cells(self) -> int:
        """Cells along the side of a marker, the black rim among them."""
        return int(self.board.aruco_dictionary.markerSize) + 2

    @property
    def _reach(self) -> float:
        """Squares around a corner without a marker."""
        return 0.5 * (1 - self.board.marker_m / self.board.square_m)

    def blur_px(self, image: NDArray, detection: Detection) -> float:
        """How blurred the markers' sides are, 1 sigma in pixels; NaN without markers."""
        if not len(detection.marker_uv):
            return float("nan")
        return edge_blur(grey_image(image), detection.marker_uv, self._cells)

    def find(self, image: Image) -> Detection:
        """The board's corners to a fraction of a pixel.

        Args:
            image: (h, w) uint8, or (h, w, 3) BGR uint8.

        Raises:
            ValueError: pixels of another type or shape.
        """
        grey = grey_image(image)
        if self.board.kind == "chessboard":
            return self._chessboard(grey)
        ids, quads = read_markers(self._markers, grey)
        ours = np.isin(ids, self.board.marker_ids)
        names, counts = np.unique(ids[ours], return_counts=True)
        once = np.flatnonzero(np.isin(ids, names[counts == 1]))
        once = once[np.argsort(ids[once])]
        if self.board.kind == "charuco":
            index, uv = self._saddles(grey, quads[once], ids[once])
        else:
            uv = side_corners(grey, quads[once], self._cells).reshape(-1, 2)
            seen = np.isfinite(uv).all(axis=1)
            place = np.searchsorted(self.board.marker_ids, ids[once])
            index, uv = (4 * place[:, None] + np.arange(4)).ravel()[seen], uv[seen]
        return Detection(
            index=index,
            uv=uv,
            markers=len(names),
            twice=int(np.count_nonzero(counts > 1)),
            marker_uv=quads[once],
            marker_ids=ids[once],
            other_uv=quads[~ours],
            other_ids=ids[~ours],
        )

    def _saddles(
        self, grey: Image, quads: Array, ids: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], Array]:
        """The inner corners of a ChArUco board between the markers that were read."""
        index, uv = self._refined(self._charuco, grey, quads, ids)
        if not self._layout_known and len(ids) >= _TELLING:
            other = replace(self.board, legacy=not self.board.legacy)
            detector = cv2.aruco.CharucoDetector(other.aruco_board, self._one)
            others = self._refined(detector, grey, quads, ids)
            # OpenCV refuses nearly all corners of the wrong layout, but not always.
            if len(others[0]) >= max(len(index) + 1, _TELLING):
                self.board, self._charuco, (index, uv) = other, detector, others
        self._layout_known = self._layout_known or len(index) >= _TELLING
        return index, uv

    def _refined(
        self, charuco: Any, grey: Image, quads: Array, ids: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], Array]:
        """Which inner corners between markers are seen, (n,), and where, (n, 2) px."""
        index, uv = _between(charuco, grey, quads, ids)
        uv, good = refine_saddles(grey, uv, self.board.corners[index, :2], self._reach)
        return index[good], uv[good]

    def _chessboard(self, grey: Image) -> Detection:
        """The whole chessboard or nothing."""
        corners = self.board.corners
        uv = find_chessboard(grey, corners, self.board.columns - 1, self.thorough)
        none, nowhere = np.zeros(0, np.intp), np.zeros((0, 4, 2))
        return Detection(np.arange(len(uv)), uv, 0, 0, nowhere, none, nowhere, none)


def read_markers(detector: cv2.aruco.ArucoDetector, grey: Image) -> tuple[NDArray[np.intp], Array]:
    """Numbers (m,) of the markers in an image, and their corners (m, 4, 2) px."""
    corners, ids, _ = detector.detectMarkers(grey)
    names = np.zeros(0, np.intp) if ids is None else np.asarray(ids, np.intp).ravel()
    return names, np.asarray(corners, np.float64).reshape(-1, 4, 2)


def _between(
    charuco: Any, grey: Image, quads: Array, ids: NDArray[np.intp]
) -> tuple[NDArray[np.intp], Array]:
    """Which inner corners of a ChArUco board are between markers, (n,), and where, (n, 2) px."""
    if len(ids) < 2:
        return np.zeros(0, np.intp), np.zeros((0, 2))
    found, names, _, _ = charuco.detectBoard(
        grey,
        markerCorners=[quad[None].astype(np.float32) for quad in quads],
        markerIds=ids.astype(np.int32)[:, None],
    )
    if names is None or not len(names):
        return np.zeros(0, np.intp), np.zeros((0, 2))
    return np.asarray(names, np.intp).ravel(), np.asarray(found, np.float64).reshape(-1, 2)


def _parameters(board: BoardSpec) -> cv2.aruco.DetectorParameters:
    parameters = cv2.aruco.DetectorParameters()
    if board.kind == "aruco_grid":
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return parameters


def grey_image(image: NDArray) -> Image:
    """(h, w) uint8 of a grey or BGR image of 8 or 16 bits.

    Raises:
        ValueError: another type or shape.
    """
    if image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    if image.dtype != np.uint8 or image.ndim not in (2, 3):
        raise ValueError(f"images must be grey or BGR of 8 or 16 bits, got {image.dtype}")
    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    return image


def why_unseen(detector: BoardDetector, image: NDArray) -> tuple[str, str] | None:
    """Why a board is not found that may be there, a short name and a sentence; None where that
    cannot be told."""
    board = detector.board
    if is_mirrored(detector, image):
        return "mirrored_board", (
            "the board is mirrored: switch off mirroring in the camera, or print the sheet again "
            "from board.pdf"
        )
    grey = grey_image(image)
    if board.kind == "chessboard" and (squares := squares_in_view(grey, plain=True)):
        return _other_squares(board, squares)
    ours = board.kind if board.kind == "chessboard" else board.dictionary
    theirs = other_dictionary(grey)
    if theirs and theirs[:8] != ours[:8]:
        return "wrong_board", (
            f"the markers are of {theirs}, board.yaml says {ours}: correct board.yaml"
        )
    if board.kind != "chessboard" and _has_wide_border(board, grey):
        return "wrong_board", (
            "the black rim of the markers is two cells wide, markers with one cell are read: print "
            "a sheet of 'occ-recon board', or one with borderBits 1"
        )
    squares = None if theirs else squares_in_view(grey, board.kind != "chessboard")
    return None if squares is None else _other_squares(board, squares)


def _other_squares(board: BoardSpec, squares: tuple[int, int]) -> tuple[str, str] | None:
    """What to say of a chessboard with so many squares that is in view; None: it may be the one."""
    if board.columns < board.rows:
        squares = squares[::-1]
    seen = f"a chessboard of {squares[0]} x {squares[1]} squares is in view"
    if board.kind != "chessboard":
        return "wrong_board", f"{seen}, board.yaml says {board.kind}: correct board.yaml"
    if squares == (board.columns, board.rows):
        return None
    return "wrong_board", (
        f"{seen}, board.yaml says {board.columns} x {board.rows}: correct it there (squares count, "
        "not the corners between them), or show the whole board"
    )


def is_mirrored(detector: BoardDetector, image: NDArray) -> bool:
    """Whether the board is there in a mirror image only."""
    if detector.board.kind == "chessboard":
        return False  # it is its own mirror image
    found = detector.find(np.ascontiguousarray(grey_image(image)[:, ::-1]))
    return found.markers >= _FEWEST_CORNERS


def _has_wide_border(board: BoardSpec, image: NDArray) -> bool:
    """Whether the board's markers are there with a rim that is two cells wide."""
    parameters = _parameters(board)
    parameters.markerBorderBits = 2
    detector = cv2.aruco.ArucoDetector(board.aruco_dictionary, parameters)
    ids, _ = read_markers(detector, grey_image(image))
    return bool(np.isin(ids, board.marker_ids).sum() >= _FEWEST_CORNERS)


def other_dictionary(image: NDArray) -> str:
    """Name of the set of markers that most in the image are of; empty when there are none."""
    grey, best, name = grey_image(image), 3, ""
    for key in ("4X4_250", "5X5_250", "6X6_250", "7X7_250", "ARUCO_ORIGINAL", "APRILTAG_36h11"):
        known = cv2.aruco.ArucoDetector(marker_dictionary(f"DICT_{key}"))
        count = len(read_markers(known, grey)[0])
        if count > best:
            best, name = count, f"DICT_{key}"
    return name
