"""Soft shadows that mattes half cover beside the object, as programs that cut objects out leave.

Where more than half covered, they would be of the object. Their images tell: along the outline of
object and shadow these change no more than elsewhere, along that of the object they do.
"""

from collections.abc import Sequence
from contextlib import suppress

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.imaging.joint.edges import LONG_SIDE, in_small, outline_normals, slopes_of
from occ_recon_ros.imaging.joint.regions import Mask, grown, square

from .frames import Frame
from .images import read_reduced
from .mask_files import read_cut_out, read_mask
from .mask_layout import REACH, share_on_crests

_HALF, _WHOLE = 127, 230  # levels: more is of the object; and more of that than of any shadow
_WIDE = 0.01  # of the longer side of a mask, the least width of a shadow: edges are less soft
_OUTSIDE = 0.25  # of its rim, that ends where nothing is, unlike that of thin places within
_LOOKED_AT = 9  # masks, spread evenly
_MOSTLY = 0.7  # of these, that hold one
_FEWEST = 20  # px of an outline, small, that tell
_ON_EDGES, _CLEARLY = 0.5, 2.0  # share of the object's outline on crests, and times the shadow's


def hold_shadows(frames: Sequence[Frame]) -> bool:
    """Whether most masks, of some that are looked at, half cover a shadow as their images tell."""
    found = list[bool]()
    for k in evenly(len(frames), _LOOKED_AT):
        with suppress(UserError):
            if (mask := _mask_of(frames[k])) is not None:
                found.append(_holds_one(frames[k], mask))
    return bool(found and np.mean(found) >= _MOSTLY)


def without_shadow(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A mask (h, w), coverage, without what is half covered, wide, and ends where nothing is; the
    same array where there is nothing like that. The object ends there half way from the level of
    the shadow to the highest."""
    side = 2 * round(0.5 * _WIDE * max(mask.shape)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    between = (mask > _HALF) & (mask <= _WHOLE)
    wide = np.asarray(cv2.morphologyEx(between.astype(np.uint8), cv2.MORPH_OPEN, disc), np.uint8)
    shadow = _at_the_outside(wide, cv2.dilate((mask <= _HALF).astype(np.uint8), disc) > 0)
    if not shadow.any():
        return mask
    level = float(np.median(mask[shadow]))
    near = cv2.dilate(shadow.astype(np.uint8), disc, iterations=2) > 0
    rest = np.clip(255 * (mask - level) / (255 - level), 0, 255)
    return np.where(near, np.rint(rest).astype(np.uint8), mask)


def _at_the_outside(places: NDArray[np.uint8], outside: Mask) -> Mask:
    """(h, w) those places that lie along what is outside for much of their rim."""
    count, label = cv2.connectedComponents(places, connectivity=4)
    rim = (places > 0) & (cv2.erode(places, np.ones((3, 3), np.uint8)) == 0)
    around = np.bincount(label[rim], minlength=count)
    along = np.bincount(label[rim & outside], minlength=count)
    taken = along > _OUTSIDE * np.maximum(around, 1)
    taken[0] = False
    return np.asarray(taken[label], np.bool_)


def _mask_of(frame: Frame) -> NDArray[np.uint8] | None:
    if frame.mask is None:
        return read_cut_out(frame.image)
    return read_mask(
        frame.mask, (frame.camera.width, frame.camera.height), frame.image, frame.layout
    )


def _holds_one(frame: Frame, mask: NDArray[np.uint8]) -> bool:
    """Whether the mask of a frame holds a shadow, by the edges of its image.

    Raises:
        UserError: a file cannot be read.
    """
    if (rest := without_shadow(mask)) is mask:
        return False
    size = frame.camera.width, frame.camera.height
    image = read_reduced(frame.image, size, LONG_SIDE)
    small, _, picture = in_small(image, np.zeros(image.shape[:2], np.uint8))
    outlines = [
        cv2.resize(m, small.shape[1::-1], interpolation=cv2.INTER_AREA) > _HALF
        for m in (mask, rest)
    ]
    slopes, shares = slopes_of(small), list[float]()
    for own, other in (outlines, outlines[::-1]):
        at, inwards = outline_normals(own, picture, REACH)
        rim = np.zeros(other.shape, np.bool_)
        there = outline_normals(other, picture, 0)[0]
        rim[there[:, 1], there[:, 0]] = True
        apart = ~grown(rim, square(7))[at[:, 1], at[:, 0]]
        if np.count_nonzero(apart) < _FEWEST:
            return False
        shares.append(share_on_crests(slopes, at[apart], inwards[apart]))
    with_it, without = shares
    return without > max(_ON_EDGES, _CLEARLY * with_it)
