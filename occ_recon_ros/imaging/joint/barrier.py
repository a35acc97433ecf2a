"""How steep an edge every way from a place to the border of the picture has to cross.

What is as dark as the backdrop, or of its colours, is still bounded by edges, and a smooth
backdrop, lit however unevenly, is not: the minimum over all ways of the steepest step on each
(Zhang, Sclaroff, Lin et al., "Minimum barrier salient object detection at 80 FPS", 2015, take
the range of values; steps let a backdrop shade off). Two things mislead: an outline that has no
edge at some place lets the object leak out, in this view; and what is seen through a handle is
enclosed as well. So this speaks softly, beside the colours.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import Bins
from .each import each
from .regions import Mask, disc, grown, of_border, opened, shrunk, square
from .scenes import Array, steepest
from .small_view import SmallView
from .space import Grid

_LEVELS = 32  # of steepness, each 1.2 times the one before
_FLATTEST, _STEEPEST = 0.1, 40.0  # of the slopes that are told apart, as of ``steepest``
_SOFT = 1.0  # px by which the image is blurred
_EDGE = 5  # px, the width of an edge after this: its outer half is of the backdrop
_LEAKY = 0.2  # share of the object that leaks out, at most as seen when its colours were learnt
_ENCLOSED = 0.05  # share of the backdrop that the object encloses
_UNSEEN = 0.02  # share of each distribution that is even over all levels
_STEEPER = 0.03  # share of the backdrop, with that, which edges so steep or steeper enclose
_NEARLY_ALL = 0.95  # of the object
_SPEAKS = 1.0  # nats from which a barrier speaks for the object
_NEAR = 12  # voxels: so far from its outline a part of the object may be
_ALONG = 64  # voxels along the body and what is so near to it
_OFTEN = 0.5  # of the views that see past the body at a place: so many show a part of it there
_FEWEST = 0.15  # of all views, in which it is seen


def barriers(view: SmallView) -> Bins:
    """(h, w) int32, how steep the edge about each pixel is, on a scale of logarithms."""
    steep = np.log(np.maximum(steepest(view.even, _SOFT), _FLATTEST) / _FLATTEST)
    level = np.minimum(_LEVELS * steep / np.log(_STEEPEST / _FLATTEST), _LEVELS - 1).astype(
        np.uint8
    )
    inner = shrunk(view.picture, square(5), goes_on=False)
    found = np.zeros(level.shape, np.uint8)
    for k in range(_LEVELS - 1):
        found += ~of_border((level <= k) | ~inner)  # no way out over edges of this level
    return cv2.erode(found, square(_EDGE)).astype(np.int32)


def speaking(
    levels: Sequence[Bins],
    inside: Sequence[Mask],
    outside: Sequence[Mask],
    away: Sequence[Mask] | None = None,
) -> list[NDArray[np.float32]]:
    """Of each view, (h, w) float32 nats by which the barrier about a pixel speaks for the object.

    Args:
        levels: of each view, as of ``barriers``.
        inside, outside: of each view, (h, w), where the object and the backdrop are known.
        away: of each view, (h, w), the backdrop away from the object, if that beside it may be
            of the object.
    """
    p, q = (_distribution(levels, masks) for masks in (inside, outside))
    told = np.log(((1 - _LEAKY) * p + _LEAKY * q) / ((1 - _ENCLOSED) * q + _ENCLOSED * p))
    if away is not None:
        # What is steeper than all that is there tells no less, however rare it is inside.
        steeper = np.cumsum(_distribution(levels, away)[::-1])[::-1]
        told = np.where(steeper < _STEEPER, np.maximum.accumulate(told), told)
    return [told.astype(np.float32)[level] for level in levels]


def enclosed_beside(
    views: Sequence[SmallView], masks: Sequence[Mask], shadows: Sequence[Mask], footprint: float
) -> list[Mask]:
    """Of each view, (h, w) what lies beside its mask, and in touch with it, and is enclosed by
    edges as what is within the masks is. A part of the object of the colours of the backdrop, lost
    in all views alike, is seen by nothing else; a hard shadow is so as well. What is wider than the
    object is ever seen is no part of it: a plate, on which it stands.

    Args:
        views: n of them.
        masks: of each view, (h, w).
        shadows: of each view, (h, w) where its colours are those of ground in shadow, which does
            not count but where steeper edges enclose it than the object.
        footprint: pixels that a voxel of the body covers.
    """
    near = disc(2 * footprint)
    around = [grown(mask, near) for mask in masks]
    wide = [grown(mask, near, _NEAR) for mask in masks]
    outside = [view.picture & ~a for a, view in zip(around, views, strict=True)]
    away = [view.picture & ~w for w, view in zip(wide, views, strict=True)]
    inside = [shrunk(mask, near) for mask in masks]
    levels = each(barriers, views)
    spoken = speaking(levels, inside, outside, away)
    steepest = _steepest(levels, inside)
    widest = max(cv2.boundingRect(mask.astype(np.uint8))[2] for mask in masks)
    found = []
    for k, mask in enumerate(masks):
        speaks = (spoken[k] > _SPEAKS) & ~mask & ~(shadows[k] & (levels[k] <= steepest))
        enclosed = opened(speaks, square(5)).astype(np.uint8)
        _, parts, boxes, _ = cv2.connectedComponentsWithStats(enclosed)
        plates = np.flatnonzero(boxes[:, cv2.CC_STAT_WIDTH] > widest)
        touching = np.setdiff1d(parts[around[k]], [0, *plates])
        found.append(np.isin(parts, touching) & wide[k] & outside[k])
    return found


def of_one_place(
    views: Sequence[SmallView],
    grid: Grid,
    body: Mask,
    footprint: float,
    masks: Sequence[Mask],
    regions: Sequence[Mask],
    saying: Sequence[NDArray[np.float32]],
) -> list[Mask]:
    """Of each view, (h, w) what of a region beside its mask may be of the object: it has the
    object's colours, or lies at a place in space of which other views show as much. What stands in
    the room behind is beside the object in each view at another place.

    Args:
        views: n of them.
        grid, body: (nx, ny, nz) occupied voxels.
        footprint: pixels that a voxel of the body covers.
        masks, regions: of each view, (h, w).
        saying: of each view, (h, w) nats that a pixel is of the object.
    """
    about = Grid.around(*grid.box_of(body, _NEAR), _ALONG)
    near = disc(2 * footprint * about.size / grid.size)
    seen = [about.pixels(view.camera) for view in views]
    count, bare = np.zeros((2, int(np.prod(about.shape))))
    for view, mask, region, (pixels, inside) in zip(views, masks, regions, seen, strict=True):
        hidden = grown(mask, near) | ~view.picture
        count += inside & region.ravel()[pixels]
        bare += inside & ~(hidden | region).ravel()[pixels]
    there = (count >= _OFTEN * (count + bare)) & (count >= _FEWEST * len(views))
    found = []
    for region, nats, (pixels, inside) in zip(regions, saying, seen, strict=True):
        drawn = np.zeros(region.size, np.bool_)
        drawn[pixels[inside & there]] = True
        found.append(region & (grown(drawn.reshape(region.shape), near) | (nats > 0)))
    return found


def _steepest(levels: Sequence[Bins], masks: Sequence[Mask]) -> int:
    """The level up to which nearly all of what is within the masks is enclosed."""
    counts = sum(
        np.bincount(level[mask], minlength=_LEVELS)
        for level, mask in zip(levels, masks, strict=True)
    )
    held = np.cumsum(counts)
    return int(np.searchsorted(held, _NEARLY_ALL * held[-1]))


def _distribution(levels: Sequence[Bins], masks: Sequence[Mask]) -> Array:
    counts = np.zeros(_LEVELS)
    for level, mask in zip(levels, masks, strict=True):
        counts += np.bincount(level[mask], minlength=_LEVELS)
    soft = np.convolve(counts, [0.25, 0.5, 0.25], mode="same")
    return np.asarray((1 - _UNSEEN) * soft / max(soft.sum(), 1.0) + _UNSEEN / _LEVELS)
