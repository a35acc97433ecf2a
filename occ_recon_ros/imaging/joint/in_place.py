"""What stays at its place in all views, which one trial takes for a part of the object and another
for the backdrop: a round foot that turns with the object, or a stand that does not turn."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from .masks import JointMasks
from .regions import Mask, opened, square

_RASTER = 200  # px, of the longer side of the images in which masks are compared
_A_PART = 0.05  # of the object's area; less, outlines differ by themselves
_THERE = 0.8  # of the views that show it at one place
_MOSTLY = 0.5  # of what differs, that is there so: what turns is at one place in few views
_BELIEF = 0.65  # where it is left out, for nothing tells whether it is the object's foot
_HOW = "for it looks the same in all views"


def told_in_place(
    found: JointMasks, rivals: Sequence[JointMasks], size: tuple[int, int]
) -> JointMasks:
    """Masks, and words on what stays at its place and which other trials told otherwise.

    Args:
        found: the masks that were chosen.
        rivals: those of other trials.
        size: (width, height) of the images, px.
    """
    own = _drawn(found, size)
    area = float(np.median([np.count_nonzero(mask) for mask in own])) if own else 0.0
    others = [_drawn(rival, size) for rival in rivals] if area else []
    lacking = max((_in_place(other, own) / area for other in others), default=0.0)
    more = max((_in_place(own, other) / area for other in others), default=0.0)
    if lacking > _A_PART:
        words = (
            f"what stands still was left out, {_HOW}; with it the masks are larger, in one trial "
            f"by {lacking:.0%} of their area: a stand stands still, but so does a round foot that "
            "turns; a strip of tape on it tells, or masks of a few images"
        )
        return replace(found, belief=min(found.belief, _BELIEF), warnings=(*found.warnings, words))
    if more > _A_PART:
        words = (
            f"{more:.0%} of the area of the masks stands still in all views and was taken along: a "
            "round foot does, but so does a stand that does not turn; a scan volume (volume_*) "
            "leaves a stand out"
        )
        return replace(found, notes=(words,))
    return found


def _drawn(masks: JointMasks, size: tuple[int, int]) -> list[Mask]:
    """Of each view, (h, w) the mask in the whole image, made small."""
    scale = _RASTER / max(size)
    shape = [max(1, round(scale * side)) for side in size[::-1]]
    drawn = []
    for small, window in zip(masks.small, masks.windows, strict=True):
        x0, y0, x1, y1 = (round(scale * at) for at in window)
        whole = np.zeros(shape, np.bool_)
        part = whole[y0:y1, x0:x1]
        here = small.astype(np.uint8) * 255
        part[:] = cv2.resize(here, part.shape[::-1], interpolation=cv2.INTER_AREA) > 127
        drawn.append(whole)
    return drawn


def _in_place(masks: Sequence[Mask], without: Sequence[Mask]) -> float:
    """Pixels of the usual mask that another lacks, where most of them are there in all views."""
    more: list[NDArray[np.bool_]] = [
        opened(a & ~b, square(3)) for a, b in zip(masks, without, strict=True)
    ]
    there = np.mean(more, axis=0) >= _THERE
    usual = float(np.median([np.count_nonzero(region) for region in more]))
    at_one_place = float(np.median([np.count_nonzero(region & there) for region in more]))
    return usual if at_one_place > _MOSTLY * usual else 0.0
