"""Masks of another shape than their images, as networks draw them that take squares.

Such a network is shown its image stretched, or with bars beside it, or the middle of it alone, and
no mask says which. The edges of the images do: one layout, that of all masks, puts the outlines on
them.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.imaging.joint.edges import (
    LONG_SIDE,
    colours_at,
    in_small,
    outline_normals,
    slopes_of,
)

from .frames import Frame
from .images import TURNED_BACK, orientation, read_reduced, turned
from .mask_files import PLACINGS, Layout, is_shaped, laid_out, read_mask
from .photographs import image_size

_LOOKED_AT = 9  # frames, spread evenly
_CREST, _FEET = (-0.7, 0.0, 0.7), (-5.0, -3.0, 3.0, 5.0)  # px across an outline, small
REACH = max(_FEET)
"""px that ``share_on_crests`` looks away from an outline"""
_MOSTLY = 0.7  # of the masks looked at, that lie best on edges in one layout
_CLEARLY = 1.2  # times the share of their outlines on edges in any other
_SAID = {
    "stretched": "stretched to their shape",
    "in the middle": "with bars to both sides",
    "in the corner": "with a bar below or beside them",
    "pixel for pixel": "pixel for pixel, without a border",
}


def masks_laid_out(frames: Sequence[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames that know how masks of another shape show their images, where the edges of these tell,
    and what is to be said of that.

    Args:
        frames: of the frames some are looked at.

    Returns:
        The frames as they are, and nothing, where masks are of the shape of their images; or their
        outlines lie on edges in no layout, in two, or if what is around the middle of each image
        was cut off, of which nothing is known, unless no object reaches there.
    """
    kept = list(frames)
    other, rows = [f for f in kept if _is_other(f)], list[NDArray[np.float64]]()
    some = [other[k] for k in evenly(len(other), _LOOKED_AT)]
    turns = any(orientation(frame.image) in TURNED_BACK for frame in some)
    trimmed = turns == 0 and all(map(_is_smaller, some))
    placings = [p for p in PLACINGS if trimmed or p != "pixel for pixel"]
    layouts = [Layout(p, upright) for upright in (False, True)[: 1 + turns] for p in placings]
    for frame in some:
        with suppress(UserError):
            rows.append(_on_edges(frame, layouts))
    if not rows:
        return kept, []
    shares = np.array(rows)
    usual = np.median(shares, axis=0)
    best = int(usual.argmax())
    clear = usual[best] > _CLEARLY * np.delete(usual, best).max()
    layout = layouts[best]
    if not clear or np.mean(shares.argmax(axis=1) == best) < _MOSTLY or layout.placing == "cut":
        return kept, []
    if layout.placing == "pixel for pixel" and any(map(_is_cut, other)):
        return kept, []
    return [replace(frame, layout=layout) for frame in kept], [
        "the masks are of another shape than their images, and by the edges of these show them "
        f"{_SAID[layout.placing]}: they are read so"
    ]


def share_on_crests(slopes: NDArray[np.float32], at: NDArray[Any], inwards: NDArray[Any]) -> float:
    """Share of the pixels ``at`` (m, 2) of an outline of ``outline_normals`` where an image changes
    more than to both sides of it; 0 without any. How steep it is there tells less: a cluttered
    backdrop has steep places everywhere.

    Args:
        slopes: (h, w) of the image, small.
        at, inwards: of the outline, farther than ``REACH`` px from the border of the image.
    """
    crest = np.max([colours_at(slopes, at, inwards, away) for away in _CREST], axis=0)
    feet = np.max([colours_at(slopes, at, inwards, away) for away in _FEET], axis=0)
    return float(np.mean(crest > feet)) if len(at) else 0.0


def _is_other(frame: Frame) -> bool:
    """Whether the mask of a frame is of another shape than its image, turned or not."""
    size = frame.camera.width, frame.camera.height
    if frame.mask is None or (of_mask := image_size(frame.mask)) is None:
        return False
    return not any(is_shaped(of_mask, shape) for shape in (size, size[::-1]))


def _is_smaller(frame: Frame) -> bool:
    """Whether the mask of a frame is smaller than its image, both ways."""
    width, height = image_size(frame.mask or frame.image) or (0, 0)
    return width < frame.camera.width and height < frame.camera.height


def _is_cut(frame: Frame) -> bool:
    """Whether the object of a mask ends at the border of it."""
    mask = read_mask(frame.mask or frame.image) > 127
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def _on_edges(frame: Frame, layouts: Sequence[Layout]) -> NDArray[np.float64]:
    """(n,) share of the outline of a mask in each of n layouts that is on crests of its image.

    Raises:
        UserError: a file cannot be read.
    """
    size = frame.camera.width, frame.camera.height
    mask = read_mask(frame.mask or frame.image)
    image = read_reduced(frame.image, size, LONG_SIDE)
    small, _, picture = in_small(image, np.zeros(image.shape[:2], np.uint8))
    slopes, found = slopes_of(small), list[float]()
    for placing, upright in layouts:
        stored = turned(mask, TURNED_BACK.get(orientation(frame.image), 0)) if upright else mask
        laid = laid_out(stored, size, placing)  # in full, as one placing is in pixels of the image
        inside = cv2.resize(laid, small.shape[1::-1], interpolation=cv2.INTER_AREA) > 127
        found.append(share_on_crests(slopes, *outline_normals(inside, picture, REACH)))
    return np.array(found)
