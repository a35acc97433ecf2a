"""Masks that came with images and hold more than the object, as pieces of what it stands on."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.imaging.joint.edges import LONG_SIDE
from occ_recon_ros.imaging.joint.regions import disc, grown, opened
from occ_recon_ros.surface.agreement import silhouette_agreement
from occ_recon_ros.surface.hull import Hull

from .raycast import RayCaster

Mask = NDArray[np.uint8]

_MOST = 0.5  # of the masks, that may hold more than the object: the others tell
_CELLS = 96  # along the body that all masks leave
_SLACK_PX = 3  # of images of the joint pass, by which this body may be off
_PIECE = 0.01  # of what it covers: less may be a thin part that is not quite where it was


@dataclass(frozen=True)
class Trimmed:
    """A mask without what the others refute of it.

    Attributes:
        mask: (h, w) uint8 coverage.
        share: of what it held, that they refute.
    """

    mask: Mask
    share: float


def trimmed(
    masks: Sequence[Mask], contours: Sequence[Contours], cameras: Sequence[Camera]
) -> dict[int, Trimmed]:
    """Masks, by their rows, of which the others refute much, without that.

    A mask that is too large carves nothing wrong: the body that all leave is right, if none lacks
    something. Wrong poses, and outlines of something else, lack as much as they hold too much.

    Args:
        masks: (h, w) uint8 coverage, of n views.
        contours: their outlines.
        cameras: of these views.

    Returns:
        Empty where nothing is to be left out, or the masks contradict each other otherwise.
    """
    try:
        found = silhouette_agreement(contours)
        large = found.too_large
        if not large.any() or found.too_small.any() or np.mean(large) > _MOST:
            return {}
        body = Hull(contours).mesh(_CELLS)
    except ValueError:  # nothing in common
        return {}
    caster = RayCaster(body.triangles)
    return {
        i: Trimmed(_cut(masks[i], caster, cameras[i]), float(found.refuted[i]))
        for i in np.flatnonzero(large).tolist()
    }


def _cut(mask: Mask, body: RayCaster, camera: Camera) -> Mask:
    """A mask without the pieces that a body does not cover, up to where it does."""
    scale = min(1.0, LONG_SIDE / max(mask.shape))
    width, height = (max(1, round(scale * side)) for side in mask.shape[::-1])
    covers = body.silhouette(camera.resized(width, height))
    held = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA) > 127
    near = disc(2 * _SLACK_PX + 1)
    more = opened(held & ~grown(covers, near), near).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(more)
    pieces = stats[:, cv2.CC_STAT_AREA] > _PIECE * np.count_nonzero(covers)
    pieces[0] = False
    beside = grown(pieces[labels], near, 2) & ~covers
    beside = cv2.resize(beside.astype(np.float32), mask.shape[::-1]) > 0.5
    return np.where(beside, 0, mask).astype(np.uint8)
