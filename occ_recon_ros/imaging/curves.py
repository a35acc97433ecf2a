"""Closed curves as arrays: length, tangents, curvature, resampling, shift across itself."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ..geometry.compiled import compiled

Array = NDArray[np.floating]


def _loops() -> ModuleType:
    return compiled("imaging.kernels")


def _plain(points: Array) -> Array:
    """As the loops take them."""
    return np.ascontiguousarray(points, np.float64)


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
    found: Array = _loops().resampled(_plain(points), float(spacing))
    return found


def normals(points: Array, reach: int = 1) -> Array:
    """(n, 2) unit normals to the right of the walk as displayed: out of the object."""
    out: Array = _loops().normals(_plain(points), reach)
    return out


def curvature(points: Array, reach: int = 3) -> Array:
    """(n,) signed curvature, 1/px, positive where the object is convex.

    From the turn of the chords over ``reach`` samples to either side.
    """
    bend: Array = _loops().curvature(_plain(points), reach)
    return bend


def along(values: Array, width: int) -> Array:
    """Running mean around the loop, which is the first axis, over about ``width`` samples."""
    width = min(width | 1, (len(values) - 1) | 1)
    if width <= 1:
        return values
    columns = _plain(values).reshape(len(values), -1)
    mean: Array = _loops().running_mean(columns, width)
    return mean.reshape(values.shape)


def largest(values: Array, width: int) -> Array:
    """(n,) the largest of values (n,) around the loop over so many samples."""
    found: Array = _loops().largest(_plain(values), width)
    return found


def for_loops(image: NDArray) -> NDArray:
    """An image (h, w[, channels]) as (h, w, channels), laid out and locked in one way, for the
    compiled loops are compiled anew for each."""
    image = np.ascontiguousarray(image).reshape(*image.shape[:2], -1).view()
    image.flags.writeable = False
    return image
