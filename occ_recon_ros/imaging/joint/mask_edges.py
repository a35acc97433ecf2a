"""Whether masks that came with images lie on the edges that these show."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..segment import to_uint8
from .colour_edge import ColourEdge
from .edges import LONG_SIDE, in_small, rim_of, slopes_of, small_contrast, strength_along
from .finer import finer, signed_distance
from .regions import shrunk, square

_BESIDE, _HALF_WIDE = 12, 0.75  # px about an outline where it is asked for a better one
_OFF = 0.5  # of the slope there, with less of which along the outline there is one
_AS_STEEP = 0.8  # of the steepest, from which on the nearest is where masks should lie
_MOSTLY = 0.8  # of the masks are boxes, or fit the image before theirs, or after it, better
_FULL = 0.985  # of the box around it that a mask fills which is one
_SHARP, _FAINT = 0.75, 0.1  # quantile of the contrasts along all masks, and of it: less is no edge
_MUCH_EDGELESS = 0.12  # share of the usual outline; of right masks, dark before dark, up to 0.08
_RUN = (
    3  # views, from which on masks that lie beside by as much were made otherwise than the others
)
_AS_FAR = 1.5  # px of a small copy, by which they differ in that
_PLAIN = 1.5  # times what images change by anywhere beside masks, that they do along edges


class MaskEdges:
    """Looks at the masks of a turn one by one, each in a small copy of its image.

    Masks of a generous brush, or those of the next images, agree with each other as well as right
    ones do.
    """

    def __init__(self) -> None:
        self._colours = ColourEdge()
        self._about: list[NDArray[np.float32]] = []
        self._contrasts: list[NDArray[np.float32]] = []
        self._fit: list[tuple[float, float, float]] = []  # own, image before, image after
        self._last: tuple[NDArray[np.float32], NDArray[np.bool_], float] | None = None
        self._scales: list[float] = []  # px of the image of each view for one of its copy
        self._boxes: list[bool] = []
        self._off: list[float] = []  # of each view alone, px of its image

    def add(self, image: NDArray[Any], mask: NDArray[np.uint8]) -> None:
        """Look at a view.

        Args:
            image: (h, w) or (h, w, 3) BGR, 8 or 16 bit.
            mask: (h, w), coverage, 0 = background.
        """
        scale = max(1.0, max(mask.shape) / LONG_SIDE)
        self._scales.append(scale)
        small, inside, picture = in_small(image, mask)
        slopes, rim = slopes_of(small), rim_of(255 * inside.astype(np.uint8))
        within = signed_distance(inside)
        away = (
            np.float32(0.5) * np.sign(within) - within
        )  # outwards, from the sides of its outermost pixels
        colours, about = ColourEdge(), _slopes_about(slopes, away, picture)
        colours.add(np.asarray(cv2.medianBlur(small, 3), np.uint8), away, picture)
        self._colours.join(colours)
        self._about.append(about)
        self._off.append(scale * _off_px(colours, about))
        self._contrasts.append(small_contrast(small, inside, picture))
        own = strength_along(slopes, rim)
        _, _, width, height = cv2.boundingRect(inside.astype(np.uint8))
        self._boxes.append(bool(np.count_nonzero(inside) > _FULL * width * height))
        if self._last is not None and self._last[0].shape == slopes.shape:
            before, rim_before, own_before = self._last
            self._fit.append(
                (own + own_before, strength_along(before, rim), strength_along(slopes, rim_before))
            )
        self._last = slopes, rim, own

    def doubts(self) -> list[str]:
        """Sentences on what is wrong with them."""
        if self.boxes():
            return ["the masks that came are upright boxes around the object, and no outlines"]
        if off := self.off_px():  # then it is chance which images they fit better
            side = "outside" if off > 0 else "inside"
            what = f"the masks that came lie some {abs(off):.0f} px {side} of the edges"
            return [f"{what} of their images"]
        found = []
        fit = np.array(self._fit).reshape(-1, 3)
        for which, other in (("before", fit[:, 1]), ("after", fit[:, 2])):
            if len(fit) and np.mean(2 * other > fit[:, 0]) > _MOSTLY:
                found.append(f"the masks that came fit the images {which} theirs better")
        if not found and (share := self.edgeless()) > _MUCH_EDGELESS:
            what = f"{share:.0%} of the outlines of the masks that came"
            found.append(f"{what} lie where their images show no edge")
        return found

    def edgeless(self) -> float:
        """Share of the usual outline across which its image changes hardly at all: that of a hull
        drawn around the object, or of a shadow with it, or where a mask is cut off."""
        known = [c for c in self._contrasts if len(c)]
        if not known:
            return 0.0
        least = _FAINT * float(np.quantile(np.concatenate(known), _SHARP))
        return float(np.median([np.mean(c < least) for c in known]))

    def boxes(self) -> bool:
        """Whether most masks are boxes that lie on no edges, as those of a detector are."""
        if not self._boxes or np.mean(self._boxes) <= _MOSTLY:
            return False
        usual = self._usual()
        at = usual[_BESIDE - 1 : _BESIDE + 2]
        return bool(not len(usual) or at.max() < _PLAIN * np.median(usual))

    def _usual(self) -> NDArray[np.float32]:
        """What images change by about their masks, as ``_slopes_about``; empty: not known."""
        known = [slopes for slopes in self._about if np.isfinite(slopes).all()]
        return np.median(known, axis=0) if known else np.zeros(0, np.float32)

    def off_px(self) -> float:
        """By how much masks lie outside of the edges of their images, negative: inside; 0.0 where
        they lie on them, or images change about as much along the masks as anywhere beside them.
        Where colours tell, slopes are not asked: what is printed behind has edges everywhere."""
        if not self._scales:
            return 0.0
        return _off_px(self._colours, self._usual()) * float(np.median(self._scales))

    def off_in_some(self) -> tuple[NDArray[np.intp], float]:
        """Rows of the views, where masks of these alone lie beside the edges of their images, all
        by as much, and by how much, as ``off_px``; none where they do not."""
        off = np.array(self._off)
        rows = np.flatnonzero(off)
        some = _RUN <= len(rows) < len(off)
        some = some and np.ptp(off[rows]) < _AS_FAR * max(self._scales[k] for k in rows)
        if not some or self.off_px() or self.boxes():
            return rows[:0], 0.0
        return rows, float(np.median(off[rows]))


def _off_px(colours: ColourEdge, slopes: NDArray[np.float32]) -> float:
    """As ``MaskEdges.off_px``, px of the small images.

    Args:
        colours: about the outlines.
        slopes: (2 _BESIDE + 1,) as ``_slopes_about``; empty, or NaN somewhere: not known.
    """
    if (edge := colours.off_px()) is not None:
        return -edge
    known = len(slopes) > 0 and bool(np.isfinite(slopes).all())
    if not known or slopes[_BESIDE - 1 : _BESIDE + 2].max() >= _OFF * slopes.max():
        return 0.0
    edges = np.flatnonzero(slopes > _AS_STEEP * slopes.max()) - _BESIDE
    return -float(edges[np.argmin(np.abs(edges))])


def redrawn(image: NDArray[Any], mask: NDArray[np.uint8], off_px: float = 0.0) -> NDArray[np.uint8]:
    """The mask where its image shows the outline, which lies beside that of the mask.

    Args:
        image: (h, w) or (h, w, 3) BGR, 8 or 16 bit.
        mask: (h, w), coverage, 0 = background.
        off_px: by how much masks lie outside of the edges of their images, negative: inside.

    Returns:
        (h, w) uint8, 255 = object.
    """
    near = signed_distance(mask > 127) - np.sign(off_px) / 2 > off_px
    _, small, _ = in_small(image, 255 * near.astype(np.uint8))
    return finer(to_uint8(image), small, np.zeros(small.shape, np.float32))


def _slopes_about(
    slopes: NDArray[np.float32], away: NDArray[np.float32], picture: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Grey levels a pixel by which an image changes at distances of -_BESIDE to _BESIDE px from the
    outline of its mask, outwards, in the median; NaN where there is nothing.

    Args:
        slopes: (h, w) of the image.
        away: (h, w) px outwards from the outline of its mask.
        picture: (h, w) False on padding.
    """
    inner = shrunk(picture, square(3), goes_on=False)
    found = np.full(2 * _BESIDE + 1, np.nan, np.float32)
    for k, distance in enumerate(range(-_BESIDE, _BESIDE + 1)):
        at = inner & (np.abs(away - distance) < _HALF_WIDE)
        if at.any():
            found[k] = np.median(slopes[at])
    return found
