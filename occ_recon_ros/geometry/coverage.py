"""How far around the object the camera has been."""

from collections.abc import Sequence

import numpy as np

from .arrays import Array

_NEIGHBOURS = np.pi / 2
"""The widest step from one view to the next that may be taken for a way that was gone."""
_MISSING = 1.5
"""Usual steps that may be missing from the last position to the first of a whole turn."""


def angle_covered(centres: Array | Sequence[Array]) -> float:
    """Angle over which a camera that goes around has seen the object, radians.

    That between its extreme positions; a whole turn where no more than one and a half
    usual steps are missing from the last position to the first. Where views do not follow each
    other around the object, it is all of the circle but for the widest gap.

    The centres are taken to lie about a circle: its plane is that of least squares, its
    middle the algebraic fit (Kasa 1976, doi:10.1109/TIM.1976.6312298).

    Args:
        centres: (frames, 3) float64, camera centres, metres, in the order of time.

    Returns:
        0 for fewer than three positions or positions on a line.
    """
    angle = np.unwrap(angles_around(centres))
    if not len(angle):
        return 0.0
    around = np.sort(np.mod(angle, 2 * np.pi))
    gaps = np.sort(np.diff(around, append=around[0] + 2 * np.pi))
    if np.abs(np.diff(angle)).max() <= _NEIGHBOURS:
        covered = float(np.ptp(angle))
    else:
        covered = float(2 * np.pi - gaps[-1])
    # Half of the way was gone in steps of at least the usual: a table that stands, and an image
    # that comes again, add none.
    way = np.cumsum(gaps[:-1])
    usual = gaps[np.searchsorted(way, 0.5 * way[-1])]
    return max(covered, 2 * np.pi) if covered + _MISSING * usual >= 2 * np.pi else covered


def angles_around(centres: Array | Sequence[Array]) -> Array:
    """Angle of each camera centre about the middle of the circle that they lie on.

    Args:
        centres: (frames, 3) float64, camera centres, metres.

    Returns:
        (frames,) float64, -pi to pi, from an arbitrary direction; none at all for fewer than
        three positions or positions on a line.
    """
    C = np.asarray(centres, np.float64).reshape(-1, 3)
    if len(C) < 3:
        return np.zeros(0)
    C = C - C.mean(axis=0)
    _, size, axes = np.linalg.svd(C, full_matrices=False)
    if size[1] < 1e-6 * size[0] or size[0] == 0:
        return np.zeros(0)
    xy = C @ axes[:2].T
    A = np.column_stack([2 * xy, np.ones(len(xy))])
    middle = np.linalg.lstsq(A, (xy**2).sum(axis=1), rcond=None)[0][:2]
    return np.asarray(np.arctan2(*(xy - middle).T))
