"""Masks that came with images by their numbers, and are those of images after or before."""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.imaging.joint.edges import rim_of, slopes_of, strength_along
from occ_recon_ros.poses.pose_shift import PoseShift

Mask = NDArray[np.uint8]

_CLEARLY = 1.3  # times the slope of the one image along a mask is that of the other: by chance 1.3


def masks_of_others(views: BagViews, found: PoseShift) -> dict[int, int]:
    """Of outlines that have the pose of another, those whose masks lie on the edges of its image:
    the poses are right, and the masks are not. Empty where masks lie on the edges of their own.

    Args:
        views: of all images.
        found: which outlines fit poses that others were given.

    Returns:
        By the number of a view, that of the image its mask is of, -1: one of another shape; from
        the first to the last.
    """
    masks = {k: view.mask for k, view in enumerate(views) if view.mask is not None}
    there = {k: given for k, given in enumerate(found.given) if k in masks and given not in (k, -1)}
    asked = defaultdict[int, list[int]](list)  # by image, masks
    for k, given in there.items():
        asked[k].append(k)
        asked[given].append(k)
    strength = dict[tuple[int, int], float]()
    for j, view in enumerate(views):
        if j not in asked:
            continue
        slopes = slopes_of(view.image)
        for k in asked[j]:
            if slopes.shape == masks[k].shape:
                strength[k, j] = strength_along(slopes, rim_of(masks[k]))
    alike = {k: j for k, j in there.items() if (k, j) in strength and (k, k) in strength}
    theirs = [k for k, j in alike.items() if strength[k, j] > _CLEARLY * strength[k, k]]
    own = [k for k, j in alike.items() if strength[k, k] > _CLEARLY * strength[k, j]]
    if len(theirs) <= len(own):
        return {}
    return {k: alike.get(k, -1) for k in there if theirs[0] <= k <= theirs[-1]}


def given_back(masks: Mapping[int, Mask], moved: Mapping[int, int]) -> dict[int, Mask]:
    """Masks by the numbers of the images that they are of.

    Args:
        masks: (h, w) uint8 by the number of the image that each came with.
        moved: as ``masks_of_others``.
    """
    own = {k: mask for k, mask in masks.items() if k not in moved}
    return own | {j: masks[k] for k, j in moved.items() if j >= 0}  # which lie on its edges
