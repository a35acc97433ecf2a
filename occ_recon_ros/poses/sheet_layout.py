"""How the markers of a printed sheet stand, told from images without a camera or a board.

A marker's four corners are a frame of its own, in which its neighbours lie at whole numbers of
columns and rows; their numbers then tell how many markers a row has.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array, evenly

from .board import BoardSpec
from .detect import Detection

_LOOKED_AT = 12  # images
_FEWEST_VOTES = 12  # pairs of markers that must say it
_AGREED = 0.8  # share of the pairs that must say the same
_ON_AXIS = 0.25  # of the way to the nearest marker: how far off a row or column it may lie
_DIAGONAL = 0.6  # of the way along the one axis, least way along the other
_BESIDE = 0.3  # of that way: by how much a neighbour may lie off its place
_PLACED = 0.3  # of a marker's side, that a marker may lie off its place on the sheet
_RANSAC_PX = 3.0
_FEWEST_IMAGES = 3  # one marker may be misread
_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], np.float32)


@dataclass(frozen=True)
class SheetLayout:
    """How the markers of a sheet stand.

    Attributes:
        kind: charuco, whose markers stand in every other square, or aruco_grid.
        columns: squares of a charuco, markers of an aruco_grid, from left to right.
    """

    kind: str
    columns: int


def sheet_layout(seen: Sequence[Detection]) -> SheetLayout | None:
    """The layout that the markers in images agree on; None where they do not tell.

    Args:
        seen: what was found in each image; markers that were read once count.
    """
    offsets, steps, nearest = [np.zeros((0, 2))], [np.zeros(0, np.intp)], [np.zeros((0, 2))]
    for found in _some(seen, 2):
        off, step = _neighbours(found.marker_uv, found.marker_ids)
        way = np.linalg.norm(off, axis=2)
        way[np.diag_indices(len(way))] = np.inf
        first = np.take_along_axis(off, way.argmin(axis=1)[:, None, None], axis=1)[:, 0]
        nearest.append(first)
        # In the nearest neighbour's distances: a marker's own frame has its side as the unit.
        offsets.append((off / np.linalg.norm(first, axis=1)[:, None, None]).reshape(-1, 2))
        steps.append(step.ravel())
    near = np.abs(np.concatenate(nearest))
    if len(near) < _FEWEST_VOTES:
        return None
    kind = kind_of(near, _AGREED)
    if kind is None:
        return None
    below = (
        [0.0, 1.0] if kind == "aruco_grid" else [0.0, np.sqrt(2)]
    )  # two squares, as of one colour
    there = np.linalg.norm(np.concatenate(offsets) - below, axis=1) < _BESIDE
    votes = np.concatenate(steps)[there]
    if len(votes) < _FEWEST_VOTES:
        return None
    values, counts = np.unique(votes, return_counts=True)
    most = int(counts.argmax())
    if counts[most] < _AGREED * len(votes) or values[most] < 2:
        return None  # such as numbered down the columns
    return SheetLayout(kind, int(values[most]))


def kind_of(nearest: Array, agreed: float) -> str | None:
    """What markers are of whose nearest neighbours are so far away along the one axis and along the
    other, (m, 2), by a share of them; None where they do not agree."""
    ratio = nearest.min(axis=1) / np.maximum(nearest.max(axis=1), 1e-12)
    if np.mean(ratio < _ON_AXIS) >= agreed:
        return "aruco_grid"
    return "charuco" if np.mean(ratio > _DIAGONAL) >= agreed else None


def _neighbours(quads: Array, ids: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """(m, m, 2) the middle of each marker in the frame of each, in its sides, right and down;
    (m, m) by how much its number is larger."""
    frames = [cv2.getPerspectiveTransform(quad.astype(np.float32), _SQUARE) for quad in quads]
    H = np.asarray(frames, np.float64)
    middles = np.column_stack([quads.mean(axis=1), np.ones(len(quads))])
    at = np.einsum("kij,mj->kmi", H, middles)
    ahead = np.where(at[..., 2:] > 1e-6, at[..., 2:], np.nan)  # else beyond its horizon
    return np.nan_to_num(at[..., :2] / ahead, nan=1e6), ids[None, :] - ids[:, None]


def other_layout(board: BoardSpec, seen: Sequence[Detection]) -> str:
    """What board.yaml has wrong of how the markers stand, in words; "" where nothing is."""
    told = None if board.kind == "chessboard" else sheet_layout(seen)
    if told is None:
        return ""
    if told.kind != board.kind:
        stand = {
            "charuco": "in every other square",
            "aruco_grid": "in rows and columns without squares between them",
        }[told.kind]
        return (
            f"the markers in view stand {stand}, as of kind {told.kind}, board.yaml says "
            f"{board.kind}: correct kind there"
        )
    if told.columns != board.columns:
        return (
            f"the sheet in view has {told.columns} columns, board.yaml says {board.columns} x "
            f"{board.rows}: correct columns and rows there"
        )
    return _further_rows(board, seen)


def _further_rows(board: BoardSpec, seen: Sequence[Detection]) -> str:
    """Markers that stand where further rows of the sheet would have them."""
    some = _some(seen, 4)
    per_square = 1 if board.kind == "aruco_grid" else 2  # squares a marker
    names = np.unique(np.concatenate([found.other_ids for found in some] or [board.marker_ids]))
    rows = -(-per_square * (names - board.first_id + 1) // board.columns)  # that hold so many
    most = (len(board.aruco_dictionary.bytesList) - board.first_id) * per_square // board.columns
    within = (rows > board.rows) & (rows <= min(2 * board.rows, most))
    if not within.any():
        return ""
    taller = replace(board, rows=int(rows[within].max()))
    places = dict(zip(taller.marker_ids.tolist(), taller.sheet_markers, strict=True))
    votes: Counter[int] = Counter()
    for found in some:
        ours = np.concatenate([places[k] for k in found.marker_ids.tolist()])
        H, _ = cv2.findHomography(ours, found.marker_uv.reshape(-1, 2), cv2.RANSAC, _RANSAC_PX)
        for name, quad in zip(found.other_ids.tolist(), found.other_uv, strict=True):
            if H is not None and name > board.marker_ids.max() and name in places:
                at = cv2.perspectiveTransform(places[name][None], H)[0]
                off = np.linalg.norm(at - quad, axis=1).max()
                votes[name] += bool(off < _PLACED * np.linalg.norm(quad[1] - quad[0]))
    sure = sorted(name for name, count in votes.items() if count >= _FEWEST_IMAGES)
    if not sure:
        return ""
    which = (
        f"markers {sure[0]} to {sure[-1]} stand" if len(sure) > 1 else f"marker {sure[0]} stands"
    )
    least = int(rows[names == sure[-1]].max())
    return (
        f"{which} on the sheet too, below the {board.rows} rows that board.yaml says: correct rows "
        f"there, {least} or more"
    )


def _some(seen: Sequence[Detection], least: int) -> list[Detection]:
    """A few detections that have markers."""
    usable = [found for found in seen if len(found.marker_ids) >= least]
    if not usable:
        return []
    return [usable[k] for k in evenly(len(usable), _LOOKED_AT)]
