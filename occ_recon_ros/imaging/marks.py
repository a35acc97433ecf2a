"""Where an outline is not that of a smooth rim: corners, T-junctions, contacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

Array = NDArray[np.floating]

_NEAR_PX = 4.0
_FAR_PX = 12.0
_CORNER_RAD = 0.6
_SPREAD_PX = 2.0


def corners(points: Array, spacing: float) -> NDArray[np.bool_]:
    """Samples at and about a corner of a closed loop.

    On a smooth outline the tangent turns over 8 px by a third of what it turns over 24 px;
    where one surface ends before another (a T-junction), at a true edge of the object and
    where it meets the table, nearly all of the turn is in the middle.

    Args:
        points: (n, 2) float64, px, evenly spaced.
        spacing: their distance, px.

    Returns:
        (n,) bool.
    """
    near, far = max(1, round(_NEAR_PX / spacing)), max(3, round(_FAR_PX / spacing))
    if len(points) <= 2 * far:
        return np.zeros(len(points), bool)
    step = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    before, after = np.roll(step, 1, axis=0), np.roll(step, -1, axis=0)
    bend = np.arctan2(
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1)
    )
    turned = np.cumsum(np.concatenate([bend[-far - 1 :], bend, bend[: far + 1]])) / 2
    middle = np.arange(len(points)) + far + 1
    over_near = turned[middle + near] - turned[middle - near]
    over_far = turned[middle + far] - turned[middle - far]
    excess = np.abs(over_near - over_far * near / far)
    size = 2 * round(_SPREAD_PX / spacing) + 1
    return maximum_filter1d(excess, size, mode="wrap") > _CORNER_RAD
