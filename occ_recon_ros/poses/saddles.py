"""Inner corners of a chessboard: made precise, and told from what only looks like one."""

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array, sampled

_LEAST_PX, _MOST_PX = 2.0, 12.0
_SYMMETRY = 0.9  # correlation with itself turned by half a turn


def refine_saddles(
    grey: NDArray, uv: Array, board_xy: Array, reach: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Sub-pixel places of inner corners.

    Around the corner of four squares an image is the same after half a turn; where an object
    covers one of them it is not.

    Args:
        grey: (h, w) uint8.
        uv: (n, 2) float64, pixels, good to some pixels.
        board_xy: (n, 2) float64, where the corners are on the board; neighbours are a square apart.
        reach: how far around a corner nothing is but its four squares, in squares.

    Returns:
        (n, 2) pixels, and (n,) bool: which look like the corner of four squares.
    """
    if len(uv) < 2:
        return uv, np.zeros(len(uv), bool)
    radius = reach * _square_px(uv, board_xy)
    window = int(np.clip(np.floor(radius), _LEAST_PX, _MOST_PX))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    inside = (uv > window + 1).all(axis=1) & (uv < np.array(grey.shape[::-1]) - window - 2).all(
        axis=1
    )
    better = uv.astype(np.float32)
    if inside.any():
        better[inside] = cv2.cornerSubPix(
            grey, np.ascontiguousarray(better[inside]), (window, window), (-1, -1), stop
        )
    refined = better.astype(np.float64)
    near = np.linalg.norm(refined - uv, axis=1) <= window
    return refined, inside & near & (_symmetry(grey, refined, window) > _SYMMETRY)


def _square_px(uv: Array, board_xy: Array) -> float:
    """Side of a square in pixels where it is small: a low quantile over neighbours."""
    apart = np.linalg.norm(board_xy[:, None] - board_xy[None], axis=2)
    side = apart[apart > 1e-9].min()
    i, j = np.nonzero((apart > 1e-9) & (apart < 1.01 * side))
    return float(np.quantile(np.linalg.norm(uv[i] - uv[j], axis=1), 0.1))


def _symmetry(grey: NDArray, uv: Array, window: int) -> Array:
    """(n,) correlation of the patch around each point with itself turned by half a turn."""
    d = np.arange(-window, window + 1, dtype=np.float32)
    dv, du = np.meshgrid(d, d, indexing="ij")
    patch = sampled(grey, uv[:, 0, None] + du.ravel(), uv[:, 1, None] + dv.ravel())
    patch = patch - patch.mean(axis=1, keepdims=True)
    power = np.maximum((patch**2).sum(axis=1), 1e-9)
    correlation: Array = (patch * patch[:, ::-1]).sum(axis=1) / power
    return correlation
