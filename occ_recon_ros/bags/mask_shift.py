"""Masks that came with images by their numbers, and are those of the images after or before.

The first is missing, or one counts from 0 and the other from 1. Such masks agree with each other as
well as right ones do, in the poses of their own images. The edges of the images tell whose they
are.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.arrays import thinned
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.joint.edges import LONG_SIDE, in_small, rim_of, slopes_of, strength_along
from occ_recon_ros.surface.agreement import silhouette_agreement

from .frames import Frame
from .images import read_reduced
from .mask_files import read_mask
from .photographs import image_size

_FARTHEST = 3  # images, by which they are looked for
_SOME, _FEWEST = 8, 6  # frames that are looked at first, and at least
_MOSTLY = 0.8  # of the masks, that fit the same image before theirs or after it best of all
_CLEARLY = 1.25  # times the slopes along them in their own images, that they lie on there
_HELD = 0.5  # of the usual slopes along right masks, that the last ones reach in the first images
_NOWHERE = 0.25  # of these, less than which masks reach that are of another image
_WORSE = 0.01  # share of a silhouette by which others may contradict it more than before
_COMPARED = 24  # views, spread evenly
_SHIFTS = np.array(sorted(range(-_FARTHEST, _FARTHEST + 1), key=abs))  # none is the first


def masks_in_place(frames: Sequence[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames with the masks that lie on the edges of their images, where those that they have are
    of the images so many before or after, and what is to be said of that.

    Args:
        frames: in the order of their numbers.

    Returns:
        The frames as they are, and nothing, unless nearly all masks fit the same other image best,
        and agree as well in its pose as in that of their own; or two fit each other's images, and
        theirs nowhere.
    """
    kept = list(frames)
    if len(kept) < _FEWEST:
        return kept, []
    if not _shift(_fits(kept[:_SOME], turn=False)):
        return _exchanged(kept)
    fits = _fits(kept, turn=True)
    shift = _shift(fits)
    if not shift:
        return kept, []
    which = f"{_counted(shift)} {'after' if shift > 0 else 'before'} theirs"
    fit = fits[:, list(_SHIFTS).index(shift)]
    held = fit > _HELD * np.nanmedian(fit)
    moved = [replace(frame, mask=None) for frame in kept]
    for k, frame in enumerate(kept):
        there = k + shift
        if frame.mask is not None and (0 <= there < len(kept) or held[k]):
            there %= len(kept)
            moved[there] = replace(moved[there], mask=frame.mask)
    if _apart(moved) > _apart(kept) + _WORSE:
        return kept, [
            f"the masks fit the images {which} better, and yet agree as they are in these poses: "
            "check whether it is images that are called by other numbers than masks and poses"
        ]
    bare = sum(frame.mask is None for frame in moved)
    said = f"the masks are of the images {which}, by the edges of these: they are taken for those"
    return moved, [f"{said}; {bare} images have none then" if bare else said]


def _exchanged(frames: list[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames with the masks of pairs exchanged that lie on no edges of their images, and on those
    of each other's, and what is to be said of that."""
    looks = [_looked_at_or_none(frame) for frame in frames]
    own = np.array([_strength(look, look) for look in looks])
    if not np.isfinite(own).any():
        return frames, []
    usual = float(np.nanmedian(own))
    strange = np.flatnonzero(own < _NOWHERE * usual).tolist()
    moved, pairs = list(frames), list[str]()
    for n, i in enumerate(strange):
        for j in strange[n + 1 :]:
            both = _strength(looks[i], looks[j]), _strength(looks[j], looks[i])
            if min(both) > _HELD * usual and moved[i] is frames[i] and moved[j] is frames[j]:
                moved[i] = replace(frames[i], mask=frames[j].mask)
                moved[j] = replace(frames[j], mask=frames[i].mask)
                pairs.append(f"{frames[i].image.name} and {frames[j].image.name}")
    if not pairs:
        return frames, []
    said = f"the masks of {'; of '.join(pairs)} fit each other's images, by the edges of these"
    if _apart(moved) > _apart(frames) + _WORSE:
        return frames, [
            f"{said}, and yet agree as they are in these poses: check whether these images have "
            "each other's names"
        ]
    return moved, [f"{said}: they are exchanged"]


_Look = tuple[NDArray[np.float32], NDArray[np.bool_] | None]


def _looked_at_or_none(frame: Frame) -> _Look | None:
    with suppress(UserError):
        return _looked_at(frame)
    return None


def _strength(of_mask: _Look | None, of_image: _Look | None) -> float:
    """Grey levels a pixel by which an image changes along a mask, as ``_fits``."""
    if of_mask is None or of_image is None:
        return np.nan
    rim, slopes = of_mask[1], of_image[0]
    if rim is None or rim.shape != slopes.shape or not rim.any():
        return np.nan
    return float(strength_along(slopes, rim))


def _counted(shift: int) -> str:
    return f"{abs(shift)} places" if abs(shift) > 1 else "one place"


def _fits(frames: Sequence[Frame], turn: bool) -> NDArray[np.float64]:
    """(n, shifts) grey levels a pixel by which the image so many places on from each frame changes
    along its mask, in the median; NaN: not known.

    Args:
        frames: n of them.
        turn: whether the first frames follow the last.
    """
    slopes, rims = list[NDArray[np.float32] | None](), list[NDArray[np.bool_] | None]()
    for frame in frames:
        slopes.append(None)
        rims.append(None)
        with suppress(UserError):
            slopes[-1], rims[-1] = _looked_at(frame)
    n, fits = len(frames), np.full((len(frames), len(_SHIFTS)), np.nan)
    for k, rim in enumerate(rims):
        for column, there in enumerate((k + _SHIFTS).tolist()):
            seen = slopes[there % n] if turn or 0 <= there < n else None
            if rim is not None and seen is not None and seen.shape == rim.shape and rim.any():
                fits[k, column] = strength_along(seen, rim)
    return fits


def _looked_at(frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    """(h, w) slopes of an image, small, and the outermost pixels (h, w) of its mask.

    Raises:
        UserError: a file cannot be read.
    """
    size = frame.camera.width, frame.camera.height
    image = read_reduced(frame.image, size, LONG_SIDE)
    mask = np.zeros(image.shape[:2], np.uint8)
    with suppress(UserError):  # which is said where it is read to be taken
        if frame.mask is not None and image_size(frame.image) == size:
            mask = read_mask(frame.mask, size, frame.image, frame.layout)
    small, _, _ = in_small(image, np.zeros(image.shape[:2], np.uint8))
    inside = cv2.resize(mask, small.shape[1::-1], interpolation=cv2.INTER_AREA)
    return slopes_of(small), rim_of(np.where(inside > 127, np.uint8(255), np.uint8(0)))


def _shift(fits: NDArray[np.float64]) -> int:
    """Places from each mask to the image that nearly all fit best; 0: theirs, or nobody knows."""
    rows = np.isfinite(fits[:, 0]) & (np.isfinite(fits).sum(axis=1) > 1)
    if np.count_nonzero(rows) < _FEWEST:
        return 0
    best = np.nanargmax(fits[rows], axis=1)
    column = int(np.bincount(best).argmax())
    there = np.isfinite(fits[rows, column])
    own = float(np.median(fits[rows][there, 0]))
    clear = float(np.median(fits[rows][there, column])) > _CLEARLY * own
    return int(_SHIFTS[column]) if clear and np.mean(best[there] == column) >= _MOSTLY else 0


def _apart(frames: Sequence[Frame]) -> float:
    """Share of the silhouettes that others contradict, in the mean; 1 where they cannot be held
    against each other."""
    tracker, contours = ContourTracker(ContourSettings(refine="none")), list[Any]()
    for k, frame in enumerate(thinned([f for f in frames if f.mask is not None], _COMPARED)):
        with suppress(UserError, ContourError):
            size = frame.camera.width, frame.camera.height
            mask = read_mask(frame.mask or frame.image, size, frame.image, frame.layout)
            contours.append(tracker.process(mask, frame.camera, k, "object", mask))
    try:
        return float(silhouette_agreement(contours).share.mean())
    except (ValueError, np.linalg.LinAlgError):
        return 1.0
