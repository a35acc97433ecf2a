"""Closed curves as arrays: length, tangents, curvature, resampling, shift across itself."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Array = NDArray[np.floating]


def shifted(values: NDArray, by: int) -> NDArray:
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
    # As complex numbers, for a pixel is then one element to gather.
    z = np.ascontiguousarray(points, np.float64).view(np.complex128)[:, 0]
    step = np.abs(shifted(z, -1) - z)
    apart = step > 1e-9
    if not apart.all():
        z, step = z[apart], step[apart]
    after = shifted(z, -1)
    at = np.concatenate([[0.0], np.cumsum(step)])
    count = max(8, round(at[-1] / spacing))
    s = np.arange(count) * (at[-1] / count)
    i = np.minimum(np.searchsorted(at, s, side="right") - 1, len(step) - 1)
    f = (s - at.take(i)) / step.take(i)
    slope = (after - shifted(z, 1)) / (step + shifted(step, 1))
    a, b, p = (slope * step).take(i), (shifted(slope, -1) * step).take(i), z.take(i)
    way = (after - z).take(i)
    q: Array = p + f * (a + f * (3 * way - 2 * a - b + f * (a + b - 2 * way)))
    return q.view(np.float64).reshape(-1, 2)


def normals(points: Array, reach: int = 1) -> Array:
    """(n, 2) unit normals to the right of the walk as displayed: out of the object."""
    x, y = (shifted(c, -reach) - shifted(c, reach) for c in points.T)
    length = np.sqrt(x * x + y * y)
    length[length == 0] = 1.0
    out = np.empty((len(x), 2))
    np.divide(-y, length, out=out[:, 0])
    np.divide(x, length, out=out[:, 1])
    return out


def curvature(points: Array, reach: int = 3) -> Array:
    """(n,) signed curvature, 1/px, positive where the object is convex.

    From the turn of the chords over ``reach`` samples to either side.
    """
    bx, by = (shifted(c, -reach) - c for c in points.T)
    ax, ay = shifted(bx, reach), shifted(by, reach)
    length = np.sqrt(ax * ax + ay * ay) + np.sqrt(bx * bx + by * by)
    turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
    # Convex object on the left, y down: the walk turns counter-clockwise, the cross product < 0.
    return -2.0 * turn / np.where(length > 0, length, 1.0)


def along(values: Array, width: int, axis: int = 0) -> Array:
    """Running mean around the loop, which is the given axis, over about ``width`` samples."""
    width = min(width | 1, (values.shape[axis] - 1) | 1)
    return uniform_filter1d(values, width, axis=axis, mode="wrap") if width > 1 else values
