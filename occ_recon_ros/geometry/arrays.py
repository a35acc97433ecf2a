"""The array types that signatures name (what their axes hold, docstrings tell), and what is asked
of arrays of vectors everywhere."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

Item = TypeVar("Item")


def dot(x: Array, y: Array) -> Array:
    """Scalar products over the last axis, which is short."""
    product: Array = (x * y) @ np.ones(x.shape[-1])
    return product


def lengths(vectors: Array) -> Array:
    """(n,) of vectors (n, k)."""
    return np.sqrt(dot(vectors, vectors))


def cross(a: Array, b: Array) -> Array:
    """(3,) of two vectors, for which np.cross takes ten times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def median(values: NDArray[np.floating]) -> float:
    """Of one or more values none of which is NaN, in a third of the time of np.median."""
    half = values.size // 2
    part = np.partition(values.ravel(), half)
    return float(part[half] if values.size % 2 else 0.5 * (part[:half].max() + part[half]))


def robust_sigma(errors: NDArray[np.floating]) -> float:
    """1 sigma about zero of errors that are normal but for some, by the median of their size."""
    return 1.4826 * float(np.median(np.abs(errors)))


def axes_along(z: Array) -> Array:
    """(3, 3) rows x, y, z of a right-handed frame about a unit vector z (3,)."""
    x = cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x = x / np.sqrt(x @ x)
    return np.array([x, cross(z, x), z])


def nearest_to_rays(centres: Array, directions: Array, parallel: float | None = None) -> Array:
    """(3,) the point nearest to rays from centres (n, 3) along unit vectors (n, 3); of the points
    that are as near, where rays are within an angle of each other (``parallel``, radians, about),
    the one nearest to the origin."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    b = np.einsum("nij,nj->ni", across, centres).ravel()
    middle: Array = np.linalg.lstsq(across.reshape(-1, 3), b, rcond=parallel)[0]
    return middle


def thinned(items: Sequence[Item], most: int) -> Sequence[Item]:
    """Every so many-th item, so that there are no more than ``most``."""
    return items[:: -(-len(items) // most) or 1]


def evenly(count: int, most: int) -> Index:
    """(k,) numbers below a count, evenly apart from the first to the last, at most so many;
    of none, none."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def repeated(count: Index) -> tuple[Index, Index]:
    """Each index as often as counted, and which time it is."""
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)


def sampled(image: NDArray, x: Array, y: Array) -> Array:
    """Float32 values of an (h, w[, channels]) image, between its pixels, at x, y: their
    shape[, channels]."""
    height, width = image.shape[:2]
    x = np.minimum(np.maximum(x, 0), width - 1.001)
    y = np.minimum(np.maximum(y, 0), height - 1.001)
    column, row = x.astype(np.intp), y.astype(np.intp)
    fx, fy = (x - column).astype(np.float32), (y - row).astype(np.float32)
    if image.ndim == 3:
        fx, fy = fx[..., None], fy[..., None]
    flat = image.reshape(height * width, *image.shape[2:])
    at = row * width + column

    def there(offset: int) -> Array:
        return flat.take(at + offset, axis=0).astype(np.float32)

    top, low = there(0), there(width)
    top += fx * (there(1) - top)
    low += fx * (there(width + 1) - low)
    low -= top
    low *= fy
    low += top
    return low
