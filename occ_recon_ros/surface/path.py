"""Where the camera has passed, so that it is known where it passes again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import Rim, Status

Array = NDArray[np.float64]

# Of the distance from the origin of the object frame:
_ASIDE = 0.02  # how far beside a path still is the same
_LONGEST = 0.6  # a longer step is no way that the camera went
_FEWEST = 10


class CameraPath:
    """Steps of the camera, by running numbers."""

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self._middles: list[Array] = []
        self._next = 0

    def add(self, start: Array, end: Array) -> int:
        """Note a step between two camera centres (3,), metres; gives its number."""
        self._numbers.append(self._next)
        self._middles.append(0.5 * (start + end))
        self._next += 1
        return self._next - 1

    def remove(self, number: int) -> None:
        """Forget a step."""
        row = self._numbers.index(number)
        del self._numbers[row], self._middles[row]

    def passed_again(self, start: Array, end: Array) -> list[int]:
        """Numbers of the steps whose middles a new step passes."""
        along, far = end - start, float(np.linalg.norm(start))
        length = float(np.linalg.norm(along))
        if not self._middles or not 0 < length < _LONGEST * far:
            return []
        away = np.array(self._middles) - start
        share = away @ along / length**2
        beside = np.linalg.norm(away - share[:, None] * along, axis=1)
        # On a circle the middle of a shorter step is farther out than that of a longer one.
        near = beside <= _ASIDE * far + length**2 / (8 * far)
        rows = np.flatnonzero(near & (share >= 0) & (share < 1))
        return [self._numbers[row] for row in rows]


def rim_centre(rim: Rim) -> Array:
    """Camera centre (3,) of a rim, metres: the point that all its tangent planes share.

    NaN where its points are too few or too much alike to tell.
    """
    good = rim.status == Status.GOOD
    normals = rim.normals[good]
    if len(normals) < _FEWEST:
        return np.full(3, np.nan)
    heights = np.einsum("nk,nk->n", normals, rim.points[good])
    # Normals all in one plane leave the centre free along a line.
    values, vectors = np.linalg.eigh(normals.T @ normals)
    if values[0] <= 1e-9 * values[2]:
        return np.full(3, np.nan)
    return np.asarray(vectors @ (vectors.T @ (normals.T @ heights) / values))
