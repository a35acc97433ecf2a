"""A backdrop that is not evenly lit, made even."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import median

Mask = NDArray[np.uint8]
Array = NDArray[np.floating]

_SAMPLES = 400
_EVEN, _UNEVEN = 4.0, 12.0
_MOST_OF_BORDER = 0.75
_ROUNDS, _SETTLED = 12, 0.5
_LEVEL = 128.0


def evened(grey: Mask) -> Mask:
    """The image less a quadratic surface through the grey values along its border.

    Args:
        grey: (h, w) uint8.

    Returns:
        (h, w) uint8, the backdrop near 128; the image itself where its border is even or
        no quadratic describes it.
    """
    height, width = grey.shape
    y, x, terms = _along_border(height, width)
    values = grey[y, x].astype(np.float64)
    noise = 1.4826 / np.sqrt(2) * median(np.abs(np.diff(values)))
    near = 3 * noise + _EVEN
    if np.mean(np.abs(values - median(values)) < near) > 0.5:
        return grey
    # The object may hide a part of the border: least absolute differences pass it over.
    weights = np.zeros(terms.shape[1])
    share = np.ones(len(values))
    for _ in range(_ROUNDS):
        before, weighted = weights, terms * share[:, None]
        weights = np.linalg.solve(weighted.T @ terms, weighted.T @ values)
        if np.abs(terms @ (weights - before)).max() < _SETTLED:
            break
        share = 1 / np.maximum(np.abs(terms @ weights - values), 1.0)
    keep = np.abs(terms @ weights - values) < near
    if keep.mean() < _MOST_OF_BORDER or np.ptp(terms[keep] @ weights) < _UNEVEN:
        return grey
    # A quadratic needs no more than a few nodes; cv2.resize is linear between them.
    rows, columns = max(2, height // 8), max(2, width // 8)
    y, x = (grid.ravel() for grid in np.mgrid[:rows, :columns])
    terms = _terms((x + 0.5) / columns, (y + 0.5) / rows)
    surface = (terms @ weights - _LEVEL).reshape(rows, columns).astype(np.float32)
    surface = np.asarray(cv2.resize(surface, (width, height)), np.float32)
    return np.clip(grey - surface, 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _along_border(height: int, width: int) -> tuple[NDArray, NDArray, Array]:
    """Rows (n,) and columns (n,) of pixels along the border, and the terms (n, 6) there."""
    deep = min(height, width) // 100
    across = np.arange(0, width, max(1, 4 * width // _SAMPLES))
    down = np.arange(0, height, max(1, 4 * height // _SAMPLES))
    x = np.concatenate(
        [across, across, np.full(len(down), deep), np.full(len(down), width - 1 - deep)]
    )
    y = np.concatenate(
        [np.full(len(across), deep), np.full(len(across), height - 1 - deep), down, down]
    )
    return y, x, _terms(x / width, y / height)


def _terms(x: Array, y: Array) -> Array:
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
