"""Masks as files hold them: drawn white on black, as transparency, with parts that have numbers."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from occ_recon_ros.errors import UserError

from .cut_outs import coverage_of_cut_out, is_drawn_over
from .images import TURNED_BACK, decode, orientation, turned

_LEAST_CUT = 1e-3  # of the pixels, the least that is an object, or what is around one
_MOSTLY, _ALL_ALONG = 0.5, 0.8  # of the masks; of the border of one, whose object may leave it
_A_PART = 0.01  # of the object, and of its border, the least of a level that is a part's
_APART = 0.04  # of the brightest level, two parts, and the least from nothing: 25 have names
_BORDERED, _INSIDE = 0.8, 0.25  # of the rim, a border's level; of all, what such one encloses
_RIM = 2  # px within which the border of an object is, its edges smoothed or not
_ROUNDED = 1.0  # px by which a mask that was made smaller may be off the shape of its image
INVERTED = (
    "masks are white all along the border: the object must be white and what is around it black; "
    "invert them"
)
_WHITE = (
    "masks are white nearly everywhere: the object alone must be white, and what is around it black"
)


Placing = Literal["stretched", "in the middle", "in the corner", "cut", "pixel for pixel"]
PLACINGS: tuple[Placing, ...] = get_args(Placing)


class Layout(NamedTuple):
    """How a mask of another shape shows its image, as networks see these that take squares.

    Attributes:
        placing: stretched, or whole, with bars to both sides of it, or below or beside it; or the
            middle of the image is all of it, what is around that cut; or the same in the scale of
            the image.
        upright: turned as the EXIF data of the image say.
    """

    placing: Placing
    upright: bool


def read_mask(
    path: Path,
    size: tuple[int, int] | None = None,
    photograph: Path | None = None,
    layout: Layout | None = None,
) -> NDArray[np.uint8]:
    """A mask image as (h, w) uint8, 255 on the object, 0 elsewhere, between them coverage.

    Of an image with transparency that is the mask, of its photograph cut out what is left of it, of
    others the grey levels in relation to the brightest, so that masks of 0 and 1 come out right.
    Levels of a JPEG are ripples. Where parts of the object have numbers or colours, it is all of
    them; of a brighter border around them where nobody knows, the half that is inside.

    Args:
        path: of the file.
        size: width and height of its image, px. A larger or smaller mask of the same shape is made
            so large.
        photograph: its image, whose EXIF data may say to turn it: programs that draw masks do so,
            and the mask is turned back, for the rows of the image are those that are stored.
        layout: how a mask of another shape than its image shows it; None: nobody knows.

    Raises:
        UserError: not there, not readable, truncated, of another shape than its image and no known
            layout, one that names what is around the object, too, or its photograph, drawn over.
    """
    return read_mask_as(path, size, photograph, layout)[0]


def read_mask_as(
    path: Path,
    size: tuple[int, int] | None = None,
    photograph: Path | None = None,
    layout: Layout | None = None,
) -> tuple[NDArray[np.uint8], bool]:
    """``read_mask``, and whether it is its photograph, cut out on a plain colour."""
    pixels, cut_out = decode(path, cv2.IMREAD_UNCHANGED), False
    if pixels.ndim == 3 and pixels.shape[2] == 4 and _cuts(pixels[:, :, 3]):
        levels = _to_the_brightest(pixels[:, :, 3])
    elif (found := coverage_of_cut_out(path, photograph)) is not None:
        levels, cut_out = found, True
    elif photograph is not None and is_drawn_over(path, photograph):
        raise UserError(
            f"{path} is its photograph, with or without the object drawn over it, and no mask: the "
            "object must be white and what is around it black"
        )
    else:
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
        grey = decode(path, flags)
        if _names_all(grey):
            raise UserError(
                f"{path} has no black: its levels name parts of the whole picture; the object "
                "alone must be white, and what is around it black"
            )
        if _in_parts(grey):
            grey = grey > 0
        elif grey.max() == cv2.GC_PR_FGD:  # the codes of grabCut, of which the object's are odd
            grey = grey & 1
        elif (inside := _inside_a_border(grey)) is not None:
            grey = inside
        levels = _to_the_brightest(grey)
    if path.suffix.lower() in (".jpg", ".jpeg"):
        levels = np.where(levels > 127, np.uint8(255), np.uint8(0))
    return levels if size is None else _fitted(levels, size, path, photograph, layout), cut_out


def _to_the_brightest(grey: NDArray[Any]) -> NDArray[np.uint8]:
    return np.rint(grey * (255.0 / max(1, int(grey.max())))).astype(np.uint8)


def _fitted(
    mask: NDArray[np.uint8],
    size: tuple[int, int],
    path: Path,
    photograph: Path | None,
    layout: Layout | None,
) -> NDArray[np.uint8]:
    stored = mask
    if photograph is not None and not is_shaped(mask.shape[::-1], size):
        stored = turned(mask, TURNED_BACK.get(orientation(photograph), 0))
    if not is_shaped(stored.shape[::-1], size):
        if layout is None:
            height, width = mask.shape
            raise UserError(
                f"{path} is {width}x{height}, its image {size[0]}x{size[1]}: make it as large "
                "by taking back what was done to the image before its mask was made: stretch it, "
                "cut off bars that were added, or add the border that was cut off"
            )
        return laid_out(stored if layout.upright else mask, size, layout.placing)
    return _resized(stored, size)


def laid_out(mask: NDArray[np.uint8], size: tuple[int, int], placing: Placing) -> NDArray[np.uint8]:
    """(height, width) of an image of this size that a mask (h, w) shows so; 0 where it does not."""
    if placing == "stretched":
        return _resized(mask, size)
    shown, most = np.array(mask.shape), np.array(mask.shape) / size[::-1]
    scale = 1.0 if placing == "pixel for pixel" else most.max() if placing == "cut" else most.min()
    image = np.rint(scale * np.array(size[::-1])).astype(int)
    inside = np.zeros(image, np.uint8)
    before = np.zeros(2, int) if placing == "in the corner" else (shown - image) // 2
    first, last = np.maximum(before, 0), np.minimum(before + image, shown)
    to = first - before, last - before
    inside[to[0][0] : to[1][0], to[0][1] : to[1][1]] = mask[first[0] : last[0], first[1] : last[1]]
    return _resized(inside, size)


def _resized(mask: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if mask.shape[::-1] == size:
        return mask
    how = cv2.INTER_AREA if mask.shape[1] > size[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(mask, size, interpolation=how), np.uint8)


def is_shaped(mask: tuple[int, ...], size: tuple[int, int]) -> bool:
    """Whether the width and height of a mask are in the relation of those of an image, but for a
    rounded pixel."""
    width, height = mask
    return abs(height - width * size[1] / size[0]) <= max(_ROUNDED, width / size[0] * _ROUNDED)


def _flat(grey: NDArray[Any]) -> NDArray[np.int64]:
    """Levels, in order, that areas have."""
    near = np.ones((3, 3), np.uint8)
    inner = (cv2.erode(grey, near) == cv2.dilate(grey, near)) & (grey > 0)
    levels, sizes = np.unique(grey[inner], return_counts=True)
    return levels[sizes > _A_PART * np.count_nonzero(grey)].astype(np.int64)


def _rim(grey: NDArray[Any]) -> NDArray[np.bool_]:
    """What is not black along what is."""
    around = cv2.erode(grey, np.ones((3, 3), np.uint8), iterations=_RIM) == 0
    return np.asarray((grey > 0) & around, np.bool_)


def _in_parts(grey: NDArray[Any]) -> bool:
    """Whether levels are names of parts: then areas are all of one, and more than one of these ends
    where nothing is. Coverage is along edges alone, and so is a border where nobody knows; what is
    nearly covered, or nearly not, is no part."""
    rim = _rim(grey)
    least, apart = _A_PART * np.count_nonzero(rim), _APART * int(grey.max())
    parts = [
        level
        for level in _flat(grey)
        if level > apart and np.count_nonzero(grey[rim] == level) > max(least, 1)
    ]
    return bool(np.any(np.diff(parts) > apart))


def _inside_a_border(grey: NDArray[Any]) -> NDArray[np.bool_] | None:
    """The object that has a number or colour around which a border where nobody knows is drawn in
    a brighter one, as sets in the style of Pascal VOC have it; None: there is no such border. The
    contour is along its middle. That of a matte is of many levels."""
    border, rim = grey == grey.max(), _rim(grey)
    levels = _flat(grey)
    named = np.isin(grey, levels[levels < (1 - _APART) * int(grey.max())])
    if np.count_nonzero(named) <= _INSIDE * np.count_nonzero(grey) or not rim.any():
        return None
    if np.mean(border[rim]) < _BORDERED:
        return None
    to_named, to_nothing = (
        cv2.distanceTransform(what.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for what in (~named, grey > 0)
    )
    return np.asarray(to_named < to_nothing, np.bool_)


def _names_all(grey: NDArray[Any]) -> bool:
    """Whether parts of all that is in the picture have names."""
    apart = _APART * int(grey.max())
    return bool(grey.min() > apart and np.count_nonzero(np.diff(_flat(grey)) > apart) > 1)


def read_cut_out(path: Path) -> NDArray[np.uint8] | None:
    """The mask that an image holds in itself, for its object was cut out: (h, w) uint8, its
    alpha channel; None where it has none or one that says the same nearly everywhere.

    Raises:
        UserError: not there, not readable, or truncated.
    """
    pixels = decode(path, cv2.IMREAD_UNCHANGED)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or not _cuts(pixels[:, :, 3]):
        return None
    return read_mask(path)


def is_cut_out(path: Path) -> bool:
    """Whether the transparency of an image shows an object and not what is around it."""
    try:
        with Image.open(path) as image:
            if not image.mode.endswith(("A", "a")) and "transparency" not in image.info:
                return False
        mask = read_cut_out(path)
    except Exception:  # of many kinds: whatever the parser stumbles over
        return False
    return mask is not None and not misdrawn(mask)


def misdrawn(mask: NDArray[np.uint8]) -> str:
    """What is wrong with a mask (h, w), 255 = object, that tells no object; empty: nothing."""
    white = mask > 127
    border = np.concatenate([white[0], white[-1], white[:, 0], white[:, -1]]).mean()
    if border > _ALL_ALONG and border > white.mean() < 1 - _LEAST_CUT:
        return INVERTED
    return _WHITE if white.mean() >= 1 - _LEAST_CUT else ""


def refuse_misdrawn(found: Sequence[str], where: object) -> None:
    """Refuse masks most of which are wrong in one way.

    Args:
        found: of each mask, what is wrong with it.
        where: they are.

    Raises:
        UserError: how many are, and in which way.
    """
    for what, count in Counter(filter(None, found)).items():
        if count > _MOSTLY * len(found):
            raise UserError(f"{where}: {count} of {len(found)} {what}")


@contextmanager
def masks_may_go() -> Iterator[None]:
    """A UserError of the block is about masks that an import can do without."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{error} (--no-masks leaves them out)") from None


def _cuts(alpha: NDArray[Any]) -> bool:
    """Whether a transparency cuts something out, and not a pixel or two alone."""
    opaque = float((alpha > 0.5 * alpha.max()).mean())
    return _LEAST_CUT < opaque < 1 - _LEAST_CUT
