"""What most views see at one place."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .each import each
from .regions import Mask, square

Array = NDArray[np.floating]
Scene = tuple[NDArray[np.float32], NDArray[np.float32]]
"""A picture (h, w, 3) and its spread (h, w), grey levels, infinite where it is not known."""

LEAST_SEEN = 5  # views that must have seen the backdrop at a pixel to tell it
_DOUBT = 0.4  # share of the difference to a neighbour that may come from a shift
_STRIPS = 8  # in which places are looked at
USUAL = 12.0  # squared sigmas, three channels
_DARK = 4.0  # grey levels, below which a step counts as in noise


def typical(stack: NDArray, seen: Mask) -> Scene:
    """Median (h, w, 3) over (n, h, w, 3) views of a place, of those that see it (n, h, w), and
    its spread (h, w), infinite where fewer than ``LEAST_SEEN`` do."""
    strips = (np.array_split(whole, _STRIPS, axis=1) for whole in (stack, seen))
    median, spread = zip(*each(_typical, *strips), strict=True)
    return np.concatenate(median), np.concatenate(spread)


def _typical(stack: NDArray, seen: Mask) -> Scene:
    count = seen.sum(axis=0)
    known = count >= LEAST_SEEN
    some = np.where(seen[:, known, None], stack[:, known], np.float32(np.inf))
    rank = (count[known] - 1) // 2

    def middle(values: NDArray) -> NDArray:
        ordered = np.sort(values, axis=0)
        return np.asarray(np.take_along_axis(ordered, rank[None, :, None], axis=0)[0])

    median = np.zeros(stack.shape[1:], np.float32)
    spread = np.full(stack.shape[1:3], np.inf, np.float32)
    if known.any():
        median[known] = middle(some)
        spread[known] = 1.4826 * middle(np.abs(some - median[known])).max(axis=1)
    return median, spread


def strongest(image: NDArray) -> Any:
    """(h, w) the largest of the channels, several times as fast as along the last axis."""
    found = image[..., 0]
    for channel in range(1, image.shape[2]):
        found = np.maximum(found, image[..., channel])
    return found


def doubt_of_place(picture: NDArray) -> Any:
    """(h, w) grey levels of doubt about a colour that comes from doubt about where things are."""
    return _DOUBT * strongest(cv2.morphologyEx(picture, cv2.MORPH_GRADIENT, square(3)))


def dot(a: NDArray, b: NDArray) -> Array:
    """(h, w) sum over the channels, several times as fast as a sum along the last axis."""
    return np.asarray(np.einsum("hwc,hwc->hw", a, b))


def steepest(image: NDArray[np.uint8], blur: float) -> NDArray[np.float32]:
    """(h, w) the steepest change of all channels together, a pixel, of the root of grey levels: as
    noise and the eye go (Di Zenzo 1986).

    Args:
        image: (h, w, 3).
        blur: px, before slopes are taken.
    """
    root = 8 * np.sqrt(cv2.GaussianBlur(image.astype(np.float32), (0, 0), blur) + _DARK)
    x, y = (cv2.Sobel(root, cv2.CV_32F, *order) / 8 for order in ((1, 0), (0, 1)))
    xx, yy, xy = dot(x, x), dot(y, y), dot(x, y)
    return np.asarray(np.sqrt(0.5 * (xx + yy + np.sqrt((xx - yy) ** 2 + 4 * xy * xy))))
