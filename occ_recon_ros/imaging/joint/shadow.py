"""Soft shadow on what the object stands on: the ground's colours with less light on them, to which
a way leads from the open ground without crossing an edge."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import COUNT, Bins, bin_colours, colour_bins, probability
from .regions import Mask, of_border
from .scenes import Array, dot, strongest

_GAINS = np.linspace(0.25, 0.95, 15)  # share of its light that ground in shadow has
_LIKELY = 10.0  # times an even distribution, from which on a colour counts as ground in shadow
_SOFT = 9.0  # grey levels a pixel as taken, most that a soft shadow changes
_HUED = 2.5  # of these, most that no dimming explains: 99 % of shadows are below, outlines above
_LIGHT = 48.0  # grey levels: on darker ground no shadow is told from the ground itself
_MOSTLY = 0.5  # share of the backdrop that must be so light; parts of the object are mixed into it


@lru_cache(maxsize=1)
def _dimmed() -> list[Bins]:
    """Of each gain, (COUNT,) the bin in which each bin's colour falls with so much light."""
    colours = bin_colours().astype(np.float32)
    return [
        colour_bins(np.rint(gain * colours)[:, None].astype(np.uint8)).ravel() for gain in _GAINS
    ]


def in_shadow(ground: Array) -> Array | None:
    """(COUNT,) probability of colours of the ground in shadow, by counts (COUNT,) of the ground's;
    None where it is too dark to show any."""
    counts = np.zeros(COUNT)
    light = ground * (bin_colours().max(axis=1) >= _LIGHT)
    if light.sum() < _MOSTLY * ground.sum() or not light.any():
        return None
    for bins in _dimmed():
        counts += np.bincount(bins, light, COUNT)
    return probability(counts)


def shadow_coloured(bins: Bins, shaded: Array | None) -> Mask:
    """(h, w) where a view, of these bins (h, w), shows colours of ``in_shadow``."""
    if shaded is None:
        return np.zeros(bins.shape, np.bool_)
    return np.asarray(shaded[bins] > _LIKELY / COUNT)


def soft_shadow(
    even: NDArray[np.uint8], bins: Bins, outside: Mask, shaded: Array, enlarged: float = 1.0
) -> Mask:
    """(h, w) where a view shows ground in soft shadow.

    Args:
        even: (h, w, 3) the view without noise.
        bins: (h, w) of its colours.
        outside: (h, w) where it shows the open ground or another backdrop.
        shaded: (COUNT,) probability of colours of the ground in shadow.
        enlarged: times that the view was blown up, which makes its edges as much flatter.
    """
    likely = shadow_coloured(bins, shaded)
    a_pixel = enlarged / 8
    slopes = [cv2.Sobel(even, cv2.CV_32F, *order, scale=a_pixel) for order in ((1, 0), (0, 1))]
    steep = np.hypot(*(strongest(np.abs(slope)) for slope in slopes))
    # Light dims a colour and turns no hue, so that a soft outline is an edge as well.
    light = even / np.maximum(np.linalg.norm(even, axis=2, keepdims=True), 1.0)
    hued = [slope - dot(slope, light)[..., None] * light for slope in slopes]
    turning = np.sqrt(dot(hued[0], hued[0]) + dot(hued[1], hued[1]))
    soft = likely & (steep < _SOFT) & (turning < _HUED)
    # Islands of it within the object are parts of that which look alike.
    shores = of_border(outside)
    labels = cv2.connectedComponents((soft | shores).astype(np.uint8), connectivity=4)[1]
    reached = np.zeros(int(labels.max()) + 1, np.bool_)
    reached[labels[shores]] = True
    reached[0] = False
    found = reached[labels] & ~outside
    # The steep pixels along its own far side are the object's.
    return np.asarray(found & likely)
