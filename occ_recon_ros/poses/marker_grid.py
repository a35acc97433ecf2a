"""How markers at known places of a plane were printed: the sheet whose numbers stand as theirs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

from .board import BoardSpec
from .sheet_layout import kind_of

_ALONG = 0.15  # of a marker's side, by which its own sides may lie or be otherwise than usual
_PLACED = 0.15  # pitches, by which a marker may lie off its place
_AGREED = 0.85  # of the markers, that must stand as in the sheet
_FEWEST = 4  # of them
_WIDEST = 60  # columns


@dataclass(frozen=True)
class MarkerGrid:
    """A sheet in a plane.

    Attributes:
        board: the print.
        middle: (2,) its middle, in the plane.
        angle: to what is right on it, radians.
        scale: lengths of the plane in one of the board's.
    """

    board: BoardSpec
    middle: Array
    angle: float
    scale: float


def grid_of(
    ids: NDArray[np.intp], quads: Array, dictionary: str, pitch_m: float
) -> MarkerGrid | None:
    """The sheet whose markers these are; None where they stand as in none.

    Args:
        ids: (m,) numbers.
        quads: (m, 4, 2) corners in the plane, x right and y up as the cameras look at it, clockwise
            from that which is the top left one of the marker.
        dictionary: OpenCV's name of the set of markers.
        pitch_m: that the board shall have.
    """
    right = 0.5 * (quads[:, 1] - quads[:, 0] + quads[:, 2] - quads[:, 3])
    side = float(np.median(np.linalg.norm(right, axis=1)))
    usual = np.median(right, axis=0)
    usual = side * usual / max(float(np.linalg.norm(usual)), 1e-12)
    alike = np.linalg.norm(right - usual, axis=1) < _ALONG * side
    if np.count_nonzero(alike) < max(_FEWEST, _AGREED * len(ids)):
        return None  # they are not all laid one way
    ids, quads = ids[alike], quads[alike]
    x = usual / side
    # Right and down, as on the sheet.
    to_sheet = np.array([[x[0], x[1]], [x[1], -x[0]]])  # its own inverse
    at = quads.mean(axis=1) @ to_sheet
    apart = np.abs(at[:, None] - at[None])
    far = np.linalg.norm(apart, axis=2) + np.where(np.eye(len(at)), np.inf, 0.0)
    kind = kind_of(apart[np.arange(len(at)), far.argmin(axis=1)], _AGREED)
    pitch = float(np.median(far.min(axis=1))) / (np.sqrt(2) if kind == "charuco" else 1.0)
    if kind is None or not side < pitch:
        return None
    best: tuple[tuple[float, int], BoardSpec, NDArray[np.bool_]] | None = None
    for board in _sheets(kind, ids, at / pitch, dictionary, pitch_m, pitch_m * side / pitch):
        own = (board.sheet_markers.mean(axis=1) / pitch_m)[ids - board.first_id]
        off = at / pitch - own
        there = np.linalg.norm(off - np.median(off, axis=0), axis=1) < _PLACED * 2
        agreed = float(there.mean()), -board.rows  # no rows more than are seen
        if best is None or agreed > best[0]:
            best = agreed, board, there
    if best is None or best[0][0] < _AGREED or np.count_nonzero(best[2]) < _FEWEST:
        return None
    _, board, there = best
    if not there.all():  # what was misread may not say how large the sheet is
        return grid_of(ids[there], quads[there], dictionary, pitch_m)
    own, seen = board.sheet_markers.mean(axis=1)[ids - board.first_id], at
    apart_own, apart_seen = own - own.mean(axis=0), seen - seen.mean(axis=0)
    scale = float((apart_own * apart_seen).sum() / (apart_own**2).sum())
    off = np.linalg.norm(apart_seen - scale * apart_own, axis=1)
    if np.mean(off < _PLACED * scale * pitch_m) < _AGREED:
        return None
    # The middle of the sheet, right and down, then in the plane.
    middle = seen.mean(axis=0) + scale * (0.5 * np.array(board.size_m) - own.mean(axis=0))
    return MarkerGrid(board, to_sheet @ middle, float(np.arctan2(x[1], x[0])), scale)


def _sheets(
    kind: str,
    ids: NDArray[np.intp],
    at: Array,
    dictionary: str,
    pitch_m: float,
    marker_m: float,
) -> Iterator[BoardSpec]:
    """Sheets that may have these numbers, the likeliest first: (m, 2) places in pitches."""
    columns = _columns(kind, ids, at)
    if columns is None:
        return
    # From the first number that was seen back to the beginning of its row, or of two of a charuco.
    firsts = [f for f in range(int(ids.min()), int(ids.min()) - columns, -1) if f >= 0]
    for first in sorted(firsts, key=lambda f: f > 0):
        for legacy in (False, True) if kind == "charuco" else (False,):
            squares = (int(ids.max()) - first + 1) * (1 if kind == "aruco_grid" else 2)
            rows = -(-squares // columns)
            if kind == "charuco":
                # As many as hold the last number; a white beginning has even rows.
                rows = max(3, rows + (legacy and rows % 2))
            try:
                yield BoardSpec(
                    kind,
                    columns,
                    rows,
                    square_m=pitch_m,
                    marker_m=marker_m,
                    gap_m=pitch_m - marker_m if kind == "aruco_grid" else 0.0,
                    dictionary=dictionary,
                    first_id=first,
                    legacy=legacy,
                )
            except ValueError:  # the set has no such numbers
                continue


def _columns(kind: str, ids: NDArray[np.intp], at: Array) -> int | None:
    """By how much numbers grow from a row to the next, or the one after it of a charuco; None where
    they do not do so as on a sheet."""
    step = np.rint(at[None] - at[:, None])
    grown = ids[None] - ids[:, None]
    per = 1 if kind == "aruco_grid" else 2
    below = (step[..., 1] > 0) & (step[..., 1] % per == 0) & (step[..., 0] % per == 0)
    told = (grown - step[..., 0] / per)[below] / (step[..., 1] / per)[below]
    whole = told[np.isclose(told, np.rint(told))].astype(np.intp)
    if not len(whole):
        return None
    values, counts = np.unique(whole, return_counts=True)
    most = int(values[counts.argmax()])
    return most if 1 <= most <= _WIDEST else None
