"""Masks that came with images, some of which hold a part, as of what the object stands on, that the
others leave out."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging.joint.edges import LONG_SIDE
from occ_recon_ros.imaging.joint.regions import disc, grown, opened
from occ_recon_ros.poses.refine import refine
from occ_recon_ros.surface.agreement import Agreement, silhouette_agreement
from occ_recon_ros.surface.hull import Hull

from .raycast import RayCaster

Mask = NDArray[np.uint8]

CUT = "the others refute {:.0%} of its mask: cut off"
LACKS = "its mask leaves out {:.0%} of what those of most others hold: left out"
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
        if not _some_large(silhouette_agreement(contours)):
            return {}
        # Where poses are off, thin parts of right masks are refuted as well.
        cameras, contours, found = _in_corrected_poses(contours, cameras)
        if not _some_large(found):
            return {}
        body = Hull(contours).mesh(_CELLS)
    except ValueError:  # nothing in common
        return {}
    caster = RayCaster(body.triangles)
    return {
        i: Trimmed(_cut(masks[i], caster, cameras[i]), float(found.refuted[i]))
        for i in np.flatnonzero(found.too_large).tolist()
    }


def lacking(contours: Sequence[Contours]) -> dict[int, float]:
    """Masks of the fewer, by their rows, that leave out a part which those of most views hold, and
    how much of these it is. What most hold must agree by itself: pieces of a table do not.

    Args:
        contours: outlines of n views.

    Returns:
        Empty where there are none, or the masks contradict each other otherwise.
    """
    try:
        found = silhouette_agreement(contours)
        large = found.too_large
        if np.mean(large) <= _MOST or not found.parted:
            return {}
        most = [c for c, more in zip(contours, large, strict=True) if more]
        if silhouette_agreement(most).doubtful.any():
            return {}
    except ValueError:
        return {}
    part = float(np.median(found.refuted[large]))
    return dict.fromkeys(np.flatnonzero(~large).tolist(), part)


def part_words(cut: Mapping[int, Trimmed], short: Mapping[int, float], count: int) -> str:
    """What is doubtful about masks some of which hold a part that the others leave out.

    Args:
        cut: those that were cut, as ``trimmed``.
        short: those that were left out, as ``lacking``.
        count: of all masks.
    """
    if short:
        what = f"{len(short)} of {count} masks leave out what the others hold"
        return f"{what}, {max(short.values()):.0%} of these: they were left out"
    share = max(own.share for own in cut.values())
    what = (
        f"{len(cut)} of {count} masks hold what the others leave out, up to {share:.0%} of a mask"
    )
    half = "; as many do as do not, and nobody can tell which are right" * (2 * len(cut) >= count)
    return f"{what}: it was cut off{half}"


def _some_large(found: Agreement) -> bool:
    """Whether some masks hold more than the others, and not most."""
    return found.parted and bool(np.mean(found.too_large) <= _MOST)


def _in_corrected_poses(
    contours: Sequence[Contours], cameras: Sequence[Camera]
) -> tuple[Sequence[Camera], Sequence[Contours], Agreement]:
    """Cameras that the outlines ask for, the outlines as these see them, and how they agree."""
    with suppress(ValueError):  # too few
        cameras = refine(contours, cameras).cameras
        contours = [seen_by(camera, own) for camera, own in zip(cameras, contours, strict=True)]
    return cameras, contours, silhouette_agreement(contours)


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
