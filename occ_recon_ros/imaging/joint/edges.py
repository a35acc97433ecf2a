"""Whether an outline lies where the image changes."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..padding import picture_area
from ..segment import to_uint8
from .regions import Mask, disc, grown, shrunk, square
from .scenes import steepest
from .small_view import SmallView

LONG_SIDE = 400  # px, of the images on which the joint pass works
MANY_STEPS = 0.3  # px of steps beside a mask for one of its outline; a hard shadow has fewer
SOME_WITHOUT_EDGE = 0.06  # share of an outline; less, dark places of a right one have too

_APART = 2.5  # px to either side of the outline at which colours are compared
_SMOOTH = 1.5  # px, of the mask, for its normals
_FAINT = 0.15  # of the usual contrast along the outlines: less is no edge
_FINE, _COARSE = 0.8, 3.0  # px, blurs: by the second a step is flatter by far, and a ramp is not
_SHARP = 1.5  # times the slope after the second, above which that after the first is a step's
_USUAL, _CLEARLY = 0.995, 2.0  # quantile of the backdrop away from the object, and times it
_REACH = 0.17  # of the longer side of the mask, about it
_STILL = 0.4  # of the views, in which an edge at one place is of the room, or of a plate
_RING = 4  # px, about an outline: its own edge


def without_edge(views: Sequence[SmallView], masks: Sequence[Mask]) -> NDArray[np.float64]:
    """(n,) share of each view's outline across which its image changes much less than usual.

    Colour models learnt from a wrong outline confirm it; its own image does not. Outlines that
    came with the views, and those along the border of the picture, are not looked at.

    Args:
        views: n of them.
        masks: of each view, (h, w).
    """
    contrasts = [
        contrast(view.even, mask, view.picture) if view.given is None else np.zeros(0, np.float32)
        for view, mask in zip(views, masks, strict=True)
    ]
    return faint(contrasts)


def faint(contrasts: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    """(n,) share of each view's outline whose ``contrast`` (m,) is much less than usual in all."""
    usual = float(np.median(np.concatenate([*contrasts, np.full(1, np.inf)])))
    return np.array([float(np.mean(c < _FAINT * usual)) if len(c) else 0.0 for c in contrasts])


class StepsBeside:
    """Steps of brightness beside the masks of a turn, far above what each backdrop shows elsewhere.

    White before white has no colour of its own, and edges with gaps enclose nothing; but where a
    backdrop is even, an edge beside the outline is of something. A soft shadow has none.
    """

    def __init__(self) -> None:
        self._beside: list[NDArray[np.intp]] = []
        self._rims: list[int] = []
        self._seen: NDArray[np.int32] | None = None
        self._alike = True

    def add(self, image: NDArray[np.uint8], mask: Mask, picture: Mask) -> None:
        """Look at a view: (h, w, 3), its mask (h, w), and False on padding (h, w)."""
        own = square(2 * _RING + 1)
        width, height = cv2.boundingRect(mask.astype(np.uint8))[2:]
        wide = grown(mask, disc(2 * _REACH * max(width, height)))
        inner = shrunk(picture, own, goes_on=False)
        fine, coarse = (steepest(image, blur) for blur in (_FINE, _COARSE))
        steps = fine - np.float32(_SHARP) * coarse
        away = steps[inner & ~wide]
        least = _CLEARLY * max(float(np.quantile(away, _USUAL)), 0.0) if len(away) else np.inf
        edges = steps > least
        self._beside.append(np.flatnonzero(edges & inner & wide & ~grown(mask, own)))
        self._rims.append(max(1, int(np.count_nonzero(mask & ~shrunk(mask, square(3))))))
        if self._seen is None:
            self._seen = np.zeros(mask.shape, np.int32)
        self._alike &= self._seen.shape == mask.shape
        if self._alike:
            self._seen += grown(edges, square(3))

    def shares(self) -> NDArray[np.float64]:
        """(n,) pixels of such steps for one of each view's outline."""
        still = np.zeros(0, np.bool_)
        if self._seen is not None and self._alike:
            still = (self._seen > _STILL * len(self._rims)).ravel()
        counts = [
            np.count_nonzero(~still[beside]) if len(still) else len(beside)
            for beside in self._beside
        ]
        return np.array(counts, np.float64) / np.array(self._rims)


def in_small(image: NDArray, mask: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], Mask, Mask]:
    """An image (h, w) or (h, w, 3) and its mask (h, w), 255 = object, in the size in which the
    views of a turn are looked at together; and what of it is no padding."""
    scale = min(1.0, LONG_SIDE / max(image.shape[:2]))
    size = [max(1, round(scale * side)) for side in image.shape[1::-1]]
    small = np.asarray(cv2.resize(to_uint8(image), size, interpolation=cv2.INTER_AREA), np.uint8)
    if small.ndim == 2:
        small = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), np.uint8)
    picture = np.zeros(small.shape[:2], np.bool_)
    picture[picture_area(small)] = True
    inside = cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 127
    return small, np.asarray(inside), picture


def small_contrast(small: NDArray[np.uint8], inside: Mask, picture: Mask) -> NDArray[np.float32]:
    """``contrast`` of what ``in_small`` gives."""
    return contrast(np.asarray(cv2.medianBlur(small, 5), np.uint8), inside, picture)


def contrast(even: NDArray[np.uint8], mask: Mask, picture: Mask) -> NDArray[np.float32]:
    """(m,) grey levels by which an image differs on the two sides of each outline pixel.

    Args:
        even: (h, w, 3) the image without noise.
        mask: (h, w).
        picture: (h, w) False on padding.
    """
    at, inwards = outline_normals(mask, picture, _APART)
    sides = [colours_at(even, at, inwards, away) for away in (_APART, -_APART)]
    return np.asarray(np.abs(sides[0] - sides[1]).max(axis=1), np.float32)


def outline_normals(mask: Mask, picture: Mask, reach: float) -> tuple[NDArray, NDArray]:
    """Pixels x, y (m, 2) along the outline of a mask (h, w), farther than ``reach`` px from where
    the picture (h, w) ends, and (m, 2) unit, the way into the mask."""
    here = mask.astype(np.uint8)
    loops = cv2.findContours(here, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0]
    at = np.concatenate([np.zeros((0, 2), np.int32), *(loop[:, 0] for loop in loops)])
    within = shrunk(picture, square(2 * round(reach) + 5), goes_on=False)
    at = at[within[at[:, 1], at[:, 0]]]
    soft = cv2.GaussianBlur(here.astype(np.float32), (0, 0), _SMOOTH)
    slopes = [cv2.Sobel(soft, cv2.CV_32F, *order)[at[:, 1], at[:, 0]] for order in ((1, 0), (0, 1))]
    inwards = np.stack(slopes, axis=-1)
    inwards /= np.linalg.norm(inwards, axis=1)[:, None] + 1e-9
    return at, inwards


def edge_strength(image: NDArray[Any], mask: NDArray[np.uint8]) -> float:
    """Grey levels a pixel by which an image changes along the outline of a mask, in the median.

    Args:
        image: (h, w) or (h, w, 3) BGR, 8 or 16 bit.
        mask: (h, w), coverage, 0 = background.
    """
    return strength_along(slopes_of(image), rim_of(mask))


def keeps_to_edges(image: NDArray[Any], mask: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Whether an image changes more along the outline of a mask than along that of another,
    where the two part.

    Args:
        image: (h, w) or (h, w, 3) BGR, 8 or 16 bit.
        mask, other: (h, w), coverage, 0 = background.
    """
    slopes, rims = slopes_of(image), (rim_of(mask), rim_of(other))
    beside = [grown(rim, square(2 * round(_APART) + 1)) for rim in rims[::-1]]
    own, others = (
        strength_along(slopes, rim & ~near) for rim, near in zip(rims, beside, strict=True)
    )
    return own > others


def slopes_of(image: NDArray[Any]) -> NDArray[np.float32]:
    """(h, w) grey levels a pixel by which an image (h, w) or (h, w, 3) changes, noise apart."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH)
    slopes = np.hypot(cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1))
    return np.asarray(slopes / 8, np.float32)


def rim_of(mask: NDArray[np.uint8]) -> Mask:
    """(h, w), the outermost pixels of a mask, not those along the border of the image."""
    covered = mask > 127
    return covered & ~shrunk(covered, square(3))


def strength_along(slopes: NDArray[np.float32], rim: Mask) -> float:
    """Grey levels a pixel by which an image changes along a rim, in the median; 0 without one."""
    return float(np.median(slopes[rim])) if rim.any() else 0.0


def colours_at(image: NDArray, at: NDArray, inwards: NDArray, away: float) -> NDArray[np.float32]:
    """(m, channels) between the pixels of a uint8 image, whole levels, so many px within an outline
    of ``outline_normals``."""
    if not len(at):
        return np.zeros((0, *image.shape[2:]), np.float32)
    # The outline runs half a pixel outside of the outermost pixels of the mask.
    x, y = np.ascontiguousarray((at + (away - 0.5) * inwards).T, np.float32)
    found = cv2.remap(image, x, y, cv2.INTER_LINEAR)
    return np.asarray(found, np.float32).reshape(-1, *image.shape[2:])
