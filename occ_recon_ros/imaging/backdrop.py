"""A backdrop that is not evenly lit, made even."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.uint8]
Array = NDArray[np.floating]

_SAMPLES = 400
_UNEVEN = 12.0
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
    keep = np.ones(len(values), bool)
    for _ in range(3):
        weights = np.linalg.lstsq(terms[keep], values[keep], rcond=None)[0]
        off = np.abs(terms @ weights - values)
        kept, keep = keep, off <= 3 * 1.4826 * np.median(off[keep]) + 1
        if (kept == keep).all():
            break
    fitted = terms[keep] @ weights
    if np.ptp(fitted) < _UNEVEN or keep.mean() < 0.6:
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
