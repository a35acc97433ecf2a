"""How steep an edge every way from a place to the border of the picture has to cross.

What is as dark as the backdrop, or of its colours, is still bounded by edges, and a smooth
backdrop, lit however unevenly, is not: the minimum over all ways of the steepest step on each
(Zhang, Sclaroff, Lin et al., "Minimum barrier salient object detection at 80 FPS", 2015, take
the range of values; steps let a backdrop shade off). Two things mislead: an outline that has no
edge at some place lets the object leak out, in this view; and what is seen through a handle is
enclosed as well. So this speaks softly, beside the colours.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import Bins
from .evidence import Array, Mask, SmallView
from .scenes import of_border

_LEVELS = 32  # of steepness, each 1.2 times the one before
_FLATTEST, _STEEPEST = 0.1, 40.0  # of the slopes that are told apart, as of ``_slope``
_SOFT = 1.0  # px by which the image is blurred
_EDGE = 5  # px, the width of an edge after this: its outer half is of the backdrop
_DARK = 4.0  # grey levels, below which a step counts as in noise
_LEAKY = 0.2  # share of the object that leaks out, at most as seen when its colours were learnt
_ENCLOSED = 0.05  # share of the backdrop that the object encloses
_UNSEEN = 0.02  # share of each distribution that is even over all levels
_SPEAKS = 1.0  # nats from which a barrier speaks for the object
_NEAR = 12  # times twice a voxel: so far from its outline a part of the object may be


def barriers(view: SmallView) -> Bins:
    """(h, w) int32, how steep the edge about each pixel is, on a scale of logarithms."""
    steep = np.log(np.maximum(_slope(view.even), _FLATTEST) / _FLATTEST)
    level = np.minimum(_LEVELS * steep / np.log(_STEEPEST / _FLATTEST), _LEVELS - 1).astype(
        np.uint8
    )
    inner = cv2.erode(view.picture.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    found = np.zeros(level.shape, np.uint8)
    for k in range(_LEVELS - 1):
        found += ~of_border((level <= k) | ~inner)  # no way out over edges of this level
    return cv2.erode(found, np.ones((_EDGE, _EDGE), np.uint8)).astype(np.int32)


def speaking(
    levels: Sequence[Bins], inside: Sequence[Mask], outside: Sequence[Mask]
) -> list[NDArray[np.float32]]:
    """Of each view, (h, w) float32 nats by which the barrier about a pixel speaks for the object.

    Args:
        levels: of each view, as of ``barriers``.
        inside, outside: of each view, (h, w), where the object and the backdrop are known.
    """
    p, q = (_distribution(levels, masks) for masks in (inside, outside))
    told = np.log(((1 - _LEAKY) * p + _LEAKY * q) / ((1 - _ENCLOSED) * q + _ENCLOSED * p))
    return [told.astype(np.float32)[level] for level in levels]


def enclosed_beside(
    views: Sequence[SmallView], masks: Sequence[Mask], footprint: float
) -> NDArray[np.float64]:
    """(n,) area beside each mask, and in touch with it, that edges enclose as they enclose what is
    within the masks, as a share of the mask's. A part of the object of the colours of the
    backdrop, lost in all views alike, is seen by nothing else; a hard shadow is so as well.

    Args:
        views: n of them.
        masks: of each view, (h, w).
        footprint: pixels that a voxel of the body covers.
    """
    reach = max(3, round(2 * footprint)) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    covered = [mask.astype(np.uint8) for mask in masks]
    around = [cv2.dilate(c, disc) > 0 for c in covered]
    inside = [cv2.erode(c, disc) > 0 for c in covered]
    outside = [~a & view.picture for a, view in zip(around, views, strict=True)]
    spoken = speaking([barriers(view) for view in views], inside, outside)
    shares = []
    for nats, mask, out in zip(spoken, covered, outside, strict=True):
        speaks = ((nats > _SPEAKS) & (mask == 0)).astype(np.uint8)
        parts = cv2.connectedComponents(
            np.asarray(cv2.morphologyEx(speaks, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)))
        )[1]
        touching = np.setdiff1d(parts[cv2.dilate(mask, disc) > 0], 0)
        near = (cv2.dilate(mask, disc, iterations=_NEAR) > 0) & out
        area = int(np.count_nonzero(np.isin(parts, touching) & near))
        shares.append(area / max(1, int(np.count_nonzero(mask))))
    return np.array(shares)


def _distribution(levels: Sequence[Bins], masks: Sequence[Mask]) -> Array:
    counts = np.zeros(_LEVELS)
    for level, mask in zip(levels, masks, strict=True):
        counts += np.bincount(level[mask], minlength=_LEVELS)
    soft = np.convolve(counts, [0.25, 0.5, 0.25], mode="same")
    return np.asarray((1 - _UNSEEN) * soft / max(soft.sum(), 1.0) + _UNSEEN / _LEVELS)


def _slope(even: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w) the steepest change of all channels together, a pixel, of the root of grey levels:
    as noise and the eye go (Di Zenzo 1986)."""
    root = 8 * np.sqrt(cv2.GaussianBlur(even.astype(np.float32), (0, 0), _SOFT) + _DARK)
    x, y = (cv2.Sobel(root, cv2.CV_32F, *order) / 8 for order in ((1, 0), (0, 1)))
    xx, yy, xy = (np.einsum("hwc,hwc->hw", a, b) for a, b in ((x, x), (y, y), (x, y)))
    return np.asarray(np.sqrt(0.5 * (xx + yy + np.sqrt((xx - yy) ** 2 + 4 * xy * xy))))
