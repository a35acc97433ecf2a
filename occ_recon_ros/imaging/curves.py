"""Closed curves as arrays: length, tangents, curvature, resampling, shift across itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Array = NDArray[np.floating]


def shifted(values: Array, by: int) -> Array:
    """Values moved on along the loop (axis 0), as np.roll does at four times the cost."""
    by %= max(len(values), 1)
    return np.concatenate((values[len(values) - by :], values[: len(values) - by]))


def lengths(vectors: Array) -> Array:
    """(n,) lengths of (n, 2) vectors."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


def signed_area(points: Array) -> float:
    """Area of a closed (n, 2) polygon; negative if counter-clockwise as displayed (y down)."""
    x, y = points.T
    return float(0.5 * np.sum(x * shifted(y, -1) - shifted(x, -1) * y))


def perimeter(points: Array) -> float:
    """Length of a closed (n, 2) polygon."""
    return float(lengths(shifted(points, -1) - points).sum())


def resample(points: Array, spacing: float) -> Array:
    """Samples at uniform arc length on a closed polygon, about ``spacing`` apart.

    Cubic Hermite pieces between the given points, so that a resampled circle keeps its
    radius; the given points should be spaced evenly to within a factor of two or so.
    """
    step = lengths(shifted(points, -1) - points)
    points = points[step > 1e-9]
    step = step[step > 1e-9]
    at = np.concatenate([[0.0], np.cumsum(step)])
    count = max(8, round(at[-1] / spacing))
    s = np.arange(count) * (at[-1] / count)
    i = np.clip(np.searchsorted(at, s, side="right") - 1, 0, len(step) - 1)
    j = (i + 1) % len(points)
    h = step[i][:, None]
    f = (s - at[i])[:, None] / h
    slope = (shifted(points, -1) - shifted(points, 1)) / (step + shifted(step, 1))[:, None]
    p, q = points[i], points[j]
    a, b = slope[i] * h, slope[j] * h
    return p + f * (a + f * (3 * (q - p) - 2 * a - b + f * (2 * (p - q) + a + b)))


def normals(points: Array, reach: int = 1) -> Array:
    """(n, 2) unit normals to the right of the walk as displayed: out of the object."""
    t = shifted(points, -reach) - shifted(points, reach)
    length = lengths(t)[:, None]
    t = t / np.where(length > 0, length, 1.0)
    return np.column_stack([-t[:, 1], t[:, 0]])


def curvature(points: Array, reach: int = 3) -> Array:
    """(n,) signed curvature, 1/px, positive where the object is convex.

    From the turn of the chords over ``reach`` samples to either side.
    """
    a = points - shifted(points, reach)
    b = shifted(points, -reach) - points
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    length = lengths(a) + lengths(b)
    turn = np.arctan2(cross, (a * b).sum(axis=1))
    # Convex object on the left, y down: the walk turns counter-clockwise, cross < 0.
    return -2.0 * turn / np.where(length > 0, length, 1.0)


def along(values: Array, width: int, axis: int = 0) -> Array:
    """Running mean around the loop, which is the given axis, over about ``width`` samples."""
    width = min(width | 1, (values.shape[axis] - 1) | 1)
    return uniform_filter1d(values, width, axis=axis, mode="wrap") if width > 1 else values
