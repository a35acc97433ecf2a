"""Parts of an image as masks (h, w) bool: about them, within them, along its border."""

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Shape = NDArray[np.uint8]


def square(side: int) -> Shape:
    """So many px wide."""
    return np.ones((side, side), np.uint8)


def disc(width: float) -> Shape:
    """About so many px wide: an odd number of them, and at least three."""
    side = max(3, round(width)) | 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def grown(mask: Mask, by: Shape, times: int = 1) -> Mask:
    """A mask and what lies within half a shape of it."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), by, iterations=times) > 0)


def shrunk(mask: Mask, by: Shape, times: int = 1, goes_on: bool = True) -> Mask:
    """A mask without what lies within half a shape of its outside.

    Args:
        mask, by: as of ``grown``.
        times: one after the other.
        goes_on: whether the mask goes on beyond the border of the image; else it ends there.
    """
    inner = cv2.erode(mask.astype(np.uint8), by, iterations=times, borderValue=int(goes_on))
    return np.asarray(inner > 0)


def opened(mask: Mask, by: Shape) -> Mask:
    """A mask without the parts that are thinner than a shape."""
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, by) > 0)


def of_border(mask: Mask) -> Mask:
    """The parts of a mask that touch the border of the image."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8))
    at_border = np.zeros(count, np.bool_)
    for rim in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        at_border[rim] = True
    at_border[0] = False
    return at_border[labels]
