"""The printed board: what is on it, where its corners are, and its YAML file."""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

from .yaml_file import read_yaml

KINDS = ("charuco", "aruco_grid", "chessboard")
_MOST_M = 1.0  # of a length; longer ones are millimetres
_LENGTHS = {
    "charuco": ("square_m", "marker_m"),
    "aruco_grid": ("marker_m", "gap_m"),
    "chessboard": ("square_m",),
}


@dataclass(frozen=True)
class BoardSpec:
    """A flat printed pattern whose corners are known.

    The board frame (REP-103): origin in the middle of the pattern, x to the right and y up as
    the sheet is read, z out of the paper, towards whoever looks at it and into whatever stands
    on it. Metres.

    Attributes:
        kind: charuco (a chessboard with markers in its white squares), aruco_grid (markers in
            rows and columns) or chessboard.
        columns, rows: squares of charuco and chessboard, markers of aruco_grid.
        square_m: side of a square, metres; charuco and chessboard.
        marker_m: side of a marker, metres; charuco and aruco_grid.
        gap_m: free space between two markers, metres; aruco_grid.
        dictionary: OpenCV's name of the set of markers, such as DICT_5X5_100.
        first_id: the number of the first marker; the others count up, row by row.
        legacy: charuco as OpenCV drew it before 4.6: with an even number of rows it begins with
            a white square, and so with a marker, where it begins with a black one now.
        not_printed: numbers of markers whose places were left white, as those in a frame are.

    Raises:
        ValueError: an unknown kind or dictionary, a length that is missing, not above 0, or
            does not fit, or more markers than the dictionary has.
    """

    kind: str = "charuco"
    columns: int = 7
    rows: int = 10
    square_m: float = 0.025
    marker_m: float = 0.018
    gap_m: float = 0.0
    dictionary: str = "DICT_5X5_100"
    first_id: int = 0
    legacy: bool = False
    not_printed: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown kind of board '{self.kind}': use one of {', '.join(KINDS)}")
        least = 1 if self.kind == "aruco_grid" else 3
        for name in ("columns", "rows"):
            if not least <= getattr(self, name) <= 200:
                raise ValueError(f"{name} must be {least} to 200, got {getattr(self, name)}")
        for name in _LENGTHS[self.kind]:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name} must be a number of metres, got {value}")
            if value <= 0:
                raise ValueError(f"{name} must be above 0 m, got {value:g}")
            if value >= _MOST_M:
                raise ValueError(
                    f"{name} is in metres: {value:g} mm are {1e-3 * value:g}, got {value:g}"
                )
        if self.kind == "charuco" and self.marker_m >= self.square_m:
            raise ValueError(
                f"marker_m {self.marker_m:g} must be smaller than square_m {self.square_m:g}"
            )
        if self.kind == "chessboard":
            self._check_not_printed()
            return
        if not hasattr(cv2.aruco, self.dictionary) or not self.dictionary.startswith("DICT_"):
            raise ValueError(f"unknown dictionary '{self.dictionary}': use one of OpenCV's DICT_*")
        last = self.first_id + self._marker_count
        there = len(self.aruco_dictionary.bytesList)
        if self.first_id < 0 or last > there:
            raise ValueError(
                f"markers {self.first_id} to {last - 1} are asked for, {self.dictionary} has "
                f"0 to {there - 1}"
            )
        self._check_not_printed()

    def _check_not_printed(self) -> None:
        count = 0 if self.kind == "chessboard" else self._marker_count
        own = range(self.first_id, self.first_id + count)
        if strangers := sorted(set(self.not_printed) - set(own)):
            raise ValueError(f"not_printed names {strangers[0]}, which is no marker of the board")
        if self.not_printed and len(set(self.not_printed)) == count:
            raise ValueError("not_printed names all markers of the board")

    @property
    def _marker_count(self) -> int:
        squares = self.columns * self.rows
        return squares if self.kind == "aruco_grid" else squares // 2

    @property
    def why_no_pose(self) -> str:
        """Why no view of the board tells the pose of the camera, and what to do; "" where one does.

        A chessboard with an even or an odd number of squares both ways looks the same after half
        a turn. For the intrinsics of a camera that makes no difference.
        """
        if self.kind != "chessboard" or (self.columns + self.rows) % 2:
            return ""
        return (
            f"a chessboard of {self.columns}x{self.rows} squares looks the same upside down, so "
            "that it serves 'occ-recon calibrate intrinsics' but tells no pose: use a ChArUco "
            f"board ('occ-recon board' makes one), or a chessboard of {self.columns}x"
            f"{self.rows + 1} squares"
        )

    @property
    def aruco_dictionary(self) -> Any:
        """OpenCV's set of markers."""
        return marker_dictionary(self.dictionary)

    @cached_property
    def aruco_board(self) -> Any:
        """OpenCV's board of markers; None for a chessboard."""
        ids = np.arange(self.first_id, self.first_id + self._marker_count)
        size = (self.columns, self.rows)
        if self.kind == "charuco":
            charuco = cv2.aruco.CharucoBoard(
                size, self.square_m, self.marker_m, self.aruco_dictionary, ids
            )
            charuco.setLegacyPattern(self.legacy)
            return charuco
        if self.kind == "aruco_grid":
            return cv2.aruco.GridBoard(size, self.marker_m, self.gap_m, self.aruco_dictionary, ids)
        return None

    @property
    def pitch_m(self) -> float:
        """From one square, or marker of a grid, to the next, metres."""
        return self.marker_m + self.gap_m if self.kind == "aruco_grid" else self.square_m

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the pattern, metres."""
        gap = self.gap_m if self.kind == "aruco_grid" else 0.0
        return self.columns * self.pitch_m - gap, self.rows * self.pitch_m - gap

    def from_sheet(self, points: NDArray) -> Array:
        """Points (n, 2) or (n, 3) measured right and down from the pattern's top left corner
        (OpenCV's board frame), metres, in the board frame: (n, 3) float64."""
        width, height = self.size_m
        points = np.asarray(points, np.float64)
        return np.column_stack(
            [points[:, 0] - width / 2, height / 2 - points[:, 1], np.zeros(len(points))]
        )

    @cached_property
    def corners(self) -> Array:
        """(n, 3) float64, the corners that are measured, board frame, metres.

        charuco and chessboard: the inner corners of the squares, row by row. aruco_grid: the four
        corners of each marker, clockwise from its top left one.
        """
        if self.kind == "aruco_grid":
            return self.from_sheet(np.concatenate(self.aruco_board.getObjPoints()))
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return self.from_sheet(self.square_m * np.column_stack([x.ravel(), y.ravel()]))

    @cached_property
    def marker_ids(self) -> NDArray[np.intp]:
        """(m,) the numbers of the markers, row by row."""
        if self.aruco_board is None:
            return np.zeros(0, np.intp)
        return np.asarray(self.aruco_board.getIds(), np.intp).ravel()

    @cached_property
    def black(self) -> Array:
        """(k, 4) float64, what is printed black: left, top, right, bottom from the pattern's top
        left corner, right and down, metres."""
        patches = []
        for number, corners in zip(self.marker_ids, self.sheet_markers, strict=True):
            if number not in self.not_printed:
                patches.append(_marker_patches(self.aruco_dictionary, int(number), corners))
        if self.kind == "charuco":
            patches.append(self._squares(taken=self.sheet_markers.mean(axis=1)))
        elif self.kind == "chessboard":
            patches.append(self._squares(taken=np.zeros((0, 2))))
        return np.concatenate(patches)

    @property
    def sheet_markers(self) -> Array:
        """(m, 4, 2) float64, the corners of the markers, clockwise from the top left one, right and
        down from the pattern's top left corner, metres."""
        if self.aruco_board is None:
            return np.zeros((0, 4, 2))
        return np.asarray(self.aruco_board.getObjPoints(), np.float64)[:, :, :2]

    def _squares(self, taken: Array) -> Array:
        """The black squares of a chessboard: those without a marker."""
        x, y = (grid.ravel() for grid in np.meshgrid(np.arange(self.columns), np.arange(self.rows)))
        black = (x + y) % 2 == 0
        if len(taken):
            white = {tuple(cell) for cell in np.floor(taken / self.square_m).astype(int).tolist()}
            black = np.array([cell not in white for cell in zip(x, y, strict=True)])
        left, top = x[black] * self.square_m, y[black] * self.square_m
        return np.column_stack([left, top, left + self.square_m, top + self.square_m])

    @property
    def words(self) -> str:
        """The board in words."""
        size = f"{self.columns}x{self.rows}"
        if self.kind == "aruco_grid":
            return (
                f"ArUco grid {size}, markers {1e3 * self.marker_m:g} mm, gaps "
                f"{1e3 * self.gap_m:g} mm, {self.dictionary}"
            )
        if self.kind == "chessboard":
            return f"chessboard {size}, squares {1e3 * self.square_m:g} mm"
        return (
            f"ChArUco {size}, squares {1e3 * self.square_m:g} mm, markers "
            f"{1e3 * self.marker_m:g} mm, {self.dictionary}"
        )


def marker_dictionary(name: str) -> Any:
    """OpenCV's set of markers of this name."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _marker_patches(dictionary: Any, number: int, corners: Array) -> Array:
    """Black runs of cells of one marker, (k, 4) left, top, right, bottom."""
    cells = dictionary.markerSize + 2
    image = cv2.aruco.generateImageMarker(dictionary, number, cells)
    (left, top), side = corners[0], (corners[2] - corners[0])[0]
    runs = []
    for row, line in enumerate(image == 0):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        runs += [(start, row, stop, row + 1) for start, stop in edges.reshape(-1, 2)]
    patches: Array = np.asarray(runs, np.float64) * side / cells + [left, top, left, top]
    return patches


def board_to_yaml(board: BoardSpec) -> str:
    """The text of board.yaml."""
    values = asdict(board)
    unused = {"square_m", "marker_m", "gap_m"} - set(_LENGTHS[board.kind])
    unused |= {key for key in ("legacy", "not_printed") if not getattr(board, key)}
    if board.kind == "chessboard":
        unused |= {"dictionary", "first_id"}
    kept = {key: value for key, value in values.items() if key not in unused}
    width, height = board.size_m
    head = (
        f"# {board.words}: {1e3 * width:g} mm x {1e3 * height:g} mm. Lengths in metres.\n"
        "# Measure the printed sheet; if a length differs, write down here what it is.\n"
    )
    return head + str(yaml.safe_dump(kept, sort_keys=False))


def board_from_mapping(content: Any) -> BoardSpec:
    """A board from the content of board.yaml.

    Raises:
        ValueError: not a mapping, an unknown or missing key, a value of another type, or what
            BoardSpec refuses.
    """
    if not isinstance(content, Mapping):
        raise ValueError("it must hold kind, columns, rows and lengths in metres")
    types: dict[str, type] = {k: type(v) for k, v in asdict(BoardSpec()).items()}
    unknown = sorted(str(key) for key in content if key not in types)
    if unknown:
        raise ValueError(f"it has no use for '{unknown[0]}': it takes {', '.join(types)}")
    kind = content.get("kind", "charuco")
    needed = ["kind", "columns", "rows", *_LENGTHS.get(kind if isinstance(kind, str) else "", ())]
    needed += ["dictionary"] if kind != "chessboard" else []
    for key in needed:
        if key not in content:
            raise ValueError(f"it lacks '{key}'")
    values: dict[str, Any] = {}
    for key, value in content.items():
        wanted = types[key]
        if wanted is float and type(value) is int:
            value = float(value)
        if wanted is tuple and isinstance(value, list) and all(type(n) is int for n in value):
            value = tuple(value)
        if type(value) is not wanted:
            hint = _metres_hint(value) if wanted is float else ""
            raise ValueError(f"{key}: must be {_TYPE_WORDS[wanted]}, got {value!r:.40}{hint}")
        values[key] = value
    return BoardSpec(**values)


_TYPE_WORDS = {
    int: "a whole number",
    float: "a number of metres",
    str: "text",
    bool: "true or false",
    tuple: "a list of numbers of markers, such as [6, 7, 8]",
}


def _metres_hint(value: object) -> str:
    """What to write for a length that came as text; "" where it cannot be read as one."""
    found = re.fullmatch(r"\s*([-+.,\de]+?)\s*(mm|cm|m|)\s*", str(value), re.IGNORECASE)
    try:
        number = float(found[1].replace(",", ".")) if found else math.nan
    except ValueError:
        return ""
    if found is None or not isinstance(value, str) or not math.isfinite(number):
        return ""
    metres = number * {"mm": 1e-3, "cm": 1e-2}.get(found[2].lower(), 1.0)
    return f", which is text in YAML: write {metres:g}"


def read_board(path: Path, for_poses: bool = True) -> BoardSpec:
    """The board of a YAML file.

    Args:
        path: the file.
        for_poses: the board must tell the pose of a camera, not its intrinsics alone.

    Raises:
        ValueError: not there, not YAML, or no such board, with the path in the message.
    """
    if path.suffix.lower() == ".pdf":
        beside = path.with_suffix(".yaml").name
        raise ValueError(f"board {path} is the sheet to print: give {beside}, written beside it")
    content = read_yaml(path, "board", "board --out board.pdf")
    try:
        board = board_from_mapping(content)
    except ValueError as error:
        raise ValueError(f"board {path}: {error}") from None
    if for_poses and board.why_no_pose:
        raise ValueError(f"board {path}: {board.why_no_pose}")
    return board
