"""Masks that are the photograph again, with one plain colour in place of what is around the object.

Repositories keep such beside photographs, in folders named "masked". Their grey levels are no
coverage. That is c of each pixel m, the photograph's I, and the plain colour p: m = p + c (I - p).
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError

from .images import decode, orientation, turned

_PLAIN = 0.5  # of the border of a cut-out, whose object may leave it; of a mask, that is one level
_SAME = 0.9  # of what is left of the photograph, that is as it is there
_WHOLE = 0.5  # of it, that is no edge of it, where both are mixed
_ALIKE = 24  # grey levels by which that is, smaller or pressed by another program
_NOISE, _RIPPLES = 1, 16  # grey levels of what is one colour, and of that in a JPEG
_LEAST = 1e-3  # of the pixels, the least that is an object
_SMALL = 0.01  # of the object: spots of the plain colour of one in a backdrop of it


def coverage_of_cut_out(path: Path, photograph: Path | None) -> NDArray[np.uint8] | None:
    """The mask that a photograph tells which was cut out on a plain colour, such as black.

    What is of that colour in the photograph too is of the object where it lies within it: all of it
    where the backdrop is of other colours, else spots.

    Args:
        path: of the cut-out.
        photograph: of which it may be one.

    Returns:
        (h, w) uint8, 255 on the object, between 0 and that coverage; None where it is no cut-out.

    Raises:
        UserError: the cut-out is not there, not readable, or truncated.
    """
    shown = decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    border = np.concatenate([shown[0], shown[-1], shown[:, 0], shown[:, -1]])
    plain = np.median(border, axis=0).astype(np.float32)
    noise = _RIPPLES if path.suffix.lower() in (".jpg", ".jpeg") else _NOISE
    left = _apart(shown, plain)
    kept = left > _ALIKE
    if np.mean(_apart(border[None], plain) <= noise) < _PLAIN or np.mean(kept) < _LEAST:
        return None
    usual = np.median(shown[kept], axis=0).astype(np.float32)
    if photograph is None or np.mean(_apart(shown[kept][None], usual) <= _NOISE) > _PLAIN:
        return None
    whole = _of_shape(photograph, shown.shape[:2])
    if whole is None:
        return None
    own, full = _apart(whole, plain), whole - plain
    share = ((shown - plain) * full).sum(axis=2) / np.maximum((full * full).sum(axis=2), 1)
    share = np.clip(share, 0, 1)
    same = _apart(shown, plain + share[:, :, None] * full) <= _ALIKE
    if np.mean(same[kept]) < _SAME or np.mean(share[kept] > _SAME) < _WHOLE:
        return None
    if noise == _RIPPLES:
        share = np.where(share > 0.5, 1, 0)
    alike = own <= noise  # in both the plain colour: nothing tells them apart
    mask = np.where(alike, 0, np.rint(255 * share)).astype(np.uint8)
    told = bool(np.mean(alike[left <= noise]) < _PLAIN)  # by the colours of the backdrop
    mask[_within(alike, mask > 127, told)] = 255
    return mask


def is_drawn_over(path: Path, photograph: Path) -> bool:
    """Whether a file is its photograph, of which only what is drawn over it differs, as programs
    show what they segmented; and not dark or one level nearly everywhere, as masks are.

    Raises:
        UserError: the file is not there, not readable, or truncated.
    """
    shown = decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    whole = _of_shape(photograph, shown.shape[:2])
    if whole is None:
        return False
    same = shown[np.abs(shown.astype(np.float32) - whole).max(axis=2) <= _ALIKE]
    if same.shape[0] <= _PLAIN * shown.shape[0] * shown.shape[1]:
        return False
    usual = np.median(same, axis=0).astype(np.float32)
    plain = np.mean(_apart(same[None], usual) <= _NOISE) > _PLAIN
    return bool(not plain and np.mean(same.max(axis=1) > 2 * _ALIKE) > _PLAIN)


def _of_shape(photograph: Path, shape: tuple[int, ...]) -> NDArray[np.uint8] | None:
    """The photograph (h, w, 3) in the size and turned as its cut-out is; None: it cannot be."""
    try:
        whole = decode(photograph, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except UserError:
        return None
    height, width = shape
    for pixels in (whole, turned(whole, orientation(photograph))):
        if abs(pixels.shape[0] * width - pixels.shape[1] * height) <= max(pixels.shape):
            if pixels.shape[:2] == shape:
                return pixels
            how = cv2.INTER_AREA if pixels.shape[1] > width else cv2.INTER_LINEAR
            return np.asarray(cv2.resize(pixels, (width, height), interpolation=how), np.uint8)
    return None


def _apart(image: NDArray[Any], colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) grey levels by which an image (h, w, 3) differs from a colour or another image."""
    return np.asarray(np.abs(image - colour).max(axis=2), np.float32)


def _within(spots: NDArray[np.bool_], found: NDArray[np.bool_], large: bool) -> NDArray[np.bool_]:
    """(h, w) those spots that the object found so far is around: small ones along most of their
    rim; and large ones, if any, all along it."""
    count, label = cv2.connectedComponents(spots.astype(np.uint8), connectivity=4)
    if count < 2:
        return spots
    near = np.ones((3, 3), np.uint8)
    rim = (cv2.dilate(label.astype(np.float32), near) > 0) & ~spots
    owner = np.asarray(cv2.dilate(label.astype(np.float32), near), np.intp)[rim]
    around = np.bincount(owner, minlength=count)
    of_object = np.bincount(owner, weights=found[rim], minlength=count)
    size = np.bincount(label.ravel(), minlength=count)
    small = size <= _SMALL * np.count_nonzero(found)
    inside = np.where(small, of_object > 0.5 * around, large & (of_object == around))
    inside[0] = False
    return np.asarray(inside[label], np.bool_)
