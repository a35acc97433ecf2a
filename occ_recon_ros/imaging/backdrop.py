"""A backdrop that is not evenly lit, made even."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.uint8]
Array = NDArray[np.floating]

_SAMPLES = 1500
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
    deep = max(2, min(height, width) // 50)
    side = np.zeros((height, width), bool)
    side[:deep], side[-deep:], side[:, :deep], side[:, -deep:] = True, True, True, True
    at = np.flatnonzero(side)
    at = at[:: max(1, len(at) // _SAMPLES)]
    values = grey.ravel()[at].astype(np.float64)
    terms = _terms(at % width / width, at // width / height)
    keep = np.ones(len(at), bool)
    for _ in range(3):
        weights = np.linalg.lstsq(terms[keep], values[keep], rcond=None)[0]
        off = np.abs(terms @ weights - values)
        keep = off <= 3 * 1.4826 * np.median(off[keep]) + 1
    fitted = terms[keep] @ weights
    if np.ptp(fitted) < _UNEVEN or keep.mean() < 0.6:
        return grey
    # A quadratic needs no more than a few nodes; cv2.resize is linear between them.
    rows, columns = max(2, height // 8), max(2, width // 8)
    y, x = np.mgrid[:rows, :columns]
    terms = _terms((x.ravel() + 0.5) / columns, (y.ravel() + 0.5) / rows)
    surface = (terms @ weights - _LEVEL).reshape(rows, columns).astype(np.float32)
    surface = np.asarray(cv2.resize(surface, (width, height)), np.float32)
    return np.clip(grey - surface, 0, 255).astype(np.uint8)


def _terms(x: Array, y: Array) -> Array:
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
