"""Whether the markers of a sheet are as large as board.yaml says, next to its squares or gaps."""

import numpy as np
from scipy.spatial.distance import pdist

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose

from .board import BoardSpec
from .detect import Detection

_RATIO_OFF = 0.04  # of the ratio of marker to square: another board
_GRID_RATIO_OFF = 0.02  # of marker to pitch: sides of a grid's markers are measured better
_RATIO_CLOSE = 0.08  # up to which the true one is known to a tenth of a millimetre or so
_APART = 1.5  # times the least distance of two markers over what it should be, that the most may be
_BLOOM_PX = 2.0  # by which a dark square may look smaller in a glaring light, or larger


def marker_ratio(board: BoardSpec, camera: Camera, pose: CameraPose, found: Detection) -> float:
    """Sides of the markers as seen on the plane of the board, over what they should be.

    In an ArUco grid the way from marker to marker is the scale. NaN for chessboards, where there is
    nothing to measure, and where too bright an image would do the same to the markers of a grid.
    """
    if board.kind == "aruco_grid":
        return _grid_ratio(board, camera, pose, found)
    if board.kind != "charuco" or not len(found.marker_uv):
        return float("nan")
    at = _on_board(camera, pose, found.marker_uv.reshape(-1, 2)).reshape(-1, 4, 3)
    sides = np.linalg.norm(np.roll(at, -1, axis=1) - at, axis=2)
    px = np.linalg.norm(np.roll(found.marker_uv, -1, axis=1) - found.marker_uv, axis=2)
    # Corners lie on the centres of the outermost dark pixels: a side is one pixel short.
    return float(np.median(sides * (1 + 1 / np.maximum(px, 1.0)))) / board.marker_m


def _on_board(camera: Camera, pose: CameraPose, uv: Array) -> Array:
    """(n, 3) metres, where the rays through pixels meet the plane of the board."""
    T = camera.at(pose).viewing_directions(uv)
    with np.errstate(divide="ignore"):
        at: Array = pose.centre - (pose.centre[2] / T[:, 2])[:, None] * T
    return at


def _grid_ratio(board: BoardSpec, camera: Camera, pose: CameraPose, found: Detection) -> float:
    """Sides of the markers of a grid over their distances, over what that should be; infinite where
    these are no grid as they should be."""
    at, should = np.full((2, len(board.corners), 3), np.nan)
    at[found.index] = _on_board(camera, pose, found.uv)
    should[found.index] = board.corners[found.index]
    quads, flat = at.reshape(-1, 4, 3), should.reshape(-1, 4, 3)
    whole = np.isfinite(quads).all(axis=(1, 2))
    if np.count_nonzero(whole) < 2:
        return float("nan")
    quads, flat = quads[whole], flat[whole]
    sides = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2)
    scales = pdist(quads.mean(axis=1)) / pdist(flat.mean(axis=1))
    if np.quantile(scales, 0.9) > _APART * np.quantile(scales, 0.1):
        return float("inf")
    scale = np.median(scales)
    ratio = float(np.median(sides) / scale) / board.marker_m
    uv = np.full((len(board.corners), 2), np.nan)
    uv[found.index] = found.uv
    uv = uv.reshape(-1, 4, 2)[whole]
    side_px = float(np.median(np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2)))
    told_apart = abs(ratio - 1) < _GRID_RATIO_OFF or abs(ratio - 1) * side_px > _BLOOM_PX
    return ratio if told_apart else float("nan")


def wrong_markers(board: BoardSpec, ratio: float) -> str:
    """What is wrong where markers are so many times as long as they should be; "" if nothing."""
    most = _GRID_RATIO_OFF if board.kind == "aruco_grid" else _RATIO_OFF
    if not abs(ratio - 1) > most:
        return ""
    if np.isinf(ratio):
        return (
            "the markers stand in another order on the sheet than in board.yaml, or their gaps "
            "differ across and along: compare columns, rows and first_id, or print a board with "
            "occ-recon board"
        )
    if board.kind == "aruco_grid":
        gap_mm = 1e3 * (board.pitch_m / ratio - board.marker_m)
        # So wrong a sheet spoils the poses that it is measured by.
        gap = f"{gap_mm:.1f}" if abs(ratio - 1) < _RATIO_CLOSE else f"about {gap_mm:.0f}"
        return (
            f"if the markers measure {1e3 * board.marker_m:g} mm, the gaps between them measure "
            f"{gap} mm where board.yaml says {1e3 * board.gap_m:g} mm: measure both on the sheet, "
            "correct board.yaml"
        )
    return (
        f"the markers measure {1e3 * ratio * board.marker_m:.1f} mm where board.yaml says "
        f"{1e3 * board.marker_m:g} mm: measure the sheet, correct board.yaml"
    )
