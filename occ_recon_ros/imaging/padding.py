"""Bars and frames of one colour around a picture: no part of what the camera saw."""

from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

_FLAT = 4.0  # grey levels by which a bar may leave its colour: what JPEG makes of none
_FEW = 0.003  # share of a line that may leave it by more; a dark backdrop has more noise
_STEP = 8.0  # grey levels by which the picture leaves the colour of the bar where that ends
_STAND_OUT = 0.5  # share of the line along which it must
_REACH = 8  # lines over which JPEG softens the end of a bar
_MOST = 0.45  # share of the picture that one bar may cover
_GLANCE, _LOOKED_AT = 32, 256  # places of a line that are looked at, first and if that is a bar
_LEFT = 0.6  # share of the image that bars all around leave at the least
_LEAST = 4  # lines: the dark rim of a sensor is no bar
_STRAIGHT = 0.9  # share of that which ends at one line, to a pixel; an object's side is turned


def picture_area(image: NDArray[np.uint8]) -> tuple[slice, slice]:
    """Rows and columns of the picture within its padding.

    A bar is a run of lines from the border inwards, all of one colour as far as JPEG leaves it,
    that ends in a step along most of its length. A dark backdrop is as even but ends in no
    such step, and stays. A block seen from its front before an even backdrop ends in one, too:
    bars on more than two sides that face each other leave most of the image.

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
        if not above + below + before + after:
            break
    height, width = image.shape[:2]
    all_around = bottom - top < height and right - left < width
    if all_around and (bottom - top) * (right - left) < _LEFT * height * width:
        return slice(0, height), slice(0, width)
    return slice(top, bottom), slice(left, right)


def _bar(image: NDArray[np.uint8]) -> int:
    """Number of lines of padding that an image begins with."""
    return _lines(image, _LOOKED_AT) if _lines(image, _GLANCE) else 0


def _lines(image: NDArray[np.uint8], places: int) -> int:
    """The same by so many places, at the most, of each line."""
    most = int(_MOST * len(image))
    if most < _LEAST:
        return 0
    thin = image[:, :: -(-image.shape[1] // places)]
    colour = np.resize(np.rint(np.median(thin[0], axis=0)), 4)

    def away(lines: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(n, w) grey levels from the colour of the bar, the most of any channel."""
        apart = np.asarray(cv2.absdiff(np.ascontiguousarray(lines), colour), np.uint8)
        return np.asarray(reduce(cv2.max, cv2.split(apart)), np.uint8)

    def uneven(lines: NDArray[np.uint8]) -> NDArray[np.bool_]:
        return np.asarray(np.mean(away(lines) > _FLAT, axis=1) > _FEW)

    if uneven(thin[:_LEAST]).any():  # as most pictures
        return 0
    ends = np.flatnonzero(uneven(thin[:most]))
    if not len(ends):
        return 0
    lines = int(ends[0])
    # What is behind the end of a bar leaves its colour all along the line, and at once.
    behind = away(thin[lines : lines + _REACH])
    whole = np.mean(behind > _STEP, axis=1) >= _STAND_OUT
    if not whole.any():
        return 0
    most_away = behind.max(axis=0)
    place = np.argmax(behind > 0.5 * most_away, axis=0)[most_away > _STEP]
    straight = np.mean(np.abs(place - np.median(place)) <= 1) >= _STRAIGHT
    return lines + int(np.argmax(whole)) if straight else 0
