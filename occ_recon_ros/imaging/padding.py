"""Bars and frames of one colour around a picture: no part of what the camera saw."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

_FLAT = 4.0  # grey levels by which a bar may leave its colour: what JPEG makes of none
_FEW = 0.003  # share of a line that may leave it by more; a dark backdrop has more noise
_STEP = 8.0  # grey levels by which the picture leaves the colour of the bar where that ends
_STAND_OUT = 0.5  # share of the line along which it must
_REACH = 8  # lines over which JPEG softens the end of a bar
_MOST = 0.45  # share of the picture that one bar may cover
_LEAST = 4  # lines: the dark rim of a sensor is no bar


def picture_area(image: NDArray[np.uint8]) -> tuple[slice, slice]:
    """Rows and columns of the picture within its padding.

    A bar is a run of lines from the border inwards, all of one colour as far as JPEG leaves it,
    that ends in a step along most of its length. A dark backdrop is as even but ends in no
    such step, and stays.

    Args:
        image: (h, w) or (h, w, 3) uint8.

    Returns:
        Slices of rows and of columns, the whole image where there is no padding.
    """
    top, bottom, left, right = 0, image.shape[0], 0, image.shape[1]
    for _ in range(2):  # bars on one side end in a step only once those beside them are gone
        part = image[top:bottom, left:right]
        above, below = _bar(part), _bar(part[::-1])
        top, bottom = top + above, bottom - below
        turned = image[top:bottom, left:right].swapaxes(0, 1)
        before, after = _bar(turned), _bar(turned[::-1])
        left, right = left + before, right - after
    return slice(top, bottom), slice(left, right)


def _bar(image: NDArray[np.uint8]) -> int:
    """Number of lines of padding that an image begins with."""
    most = int(_MOST * len(image))
    if most < _LEAST:
        return 0
    colour = np.median(image[:2].reshape(-1, *image.shape[2:]), axis=0)
    step = max(1, image.shape[1] // 256)

    def away(lines: NDArray) -> Array:
        """(n,) or (n, w) grey levels from the colour of the bar."""
        difference = np.abs(lines[:, ::step].astype(np.float32) - colour)
        return np.asarray(difference.max(axis=2) if difference.ndim == 3 else difference)

    flat = np.mean(away(image[:most]) > _FLAT, axis=1) <= _FEW
    lines = int(np.argmin(flat)) if not flat.all() else 0
    if lines < _LEAST:
        return 0
    # What is behind the end of a bar leaves its colour all along the line, and at once.
    behind = np.mean(away(image[lines : lines + _REACH]) > _STEP, axis=1) >= _STAND_OUT
    return lines + int(np.argmax(behind)) if behind.any() else 0
