"""How far contours are from the exact outline of a scene object."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]


def outline_errors(
    uv: Array, truth_uv: Array, truth_next: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp]]:
    """Signed distance of points from a densely sampled true outline.

    Args:
        uv: (n, 2) float64, px.
        truth_uv: (m, 2) float64, px, closed loops, object on the left as displayed.
        truth_next: (m,) the next row along its loop.

    Returns:
        error: (n,) float64, px, positive outside of the object.
        row: (n,) the nearest true sample.
    """
    row = cKDTree(truth_uv).query(uv)[1]
    previous = np.empty_like(truth_next)
    previous[truth_next] = np.arange(len(truth_next))
    best = np.full(len(uv), np.inf)
    for start in (row, previous[row]):
        a, b = truth_uv[start], truth_uv[truth_next[start]]
        along = b - a
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
        f = np.clip(((uv - a) * along).sum(axis=1) / length**2, 0, 1)
        gap = uv - a - f[:, None] * along
        side = np.sign(gap[:, 1] * along[:, 0] - gap[:, 0] * along[:, 1])
        distance = np.linalg.norm(gap, axis=1)
        best = np.where(distance < np.abs(best), side * distance, best)
    return best, row
