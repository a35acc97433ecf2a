"""A view made small, in which the views of a turn are looked at together."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from .colours import Bins, colour_bins
from .regions import Mask
from .scenes import Scene


@dataclass(frozen=True)
class SmallView:
    """A view made small.

    Attributes:
        image: (h, w, 3) uint8 BGR.
        camera: of the small image.
        picture: (h, w) bool, False on padding.
        given: (h, w) bool, a mask that came with the view, or None.
        bins: (h, w) int32, the bin of each pixel's colour.
        even: (h, w, 3) uint8, the image without noise and without what is thinner than 3 px.
        known: what the view shows where nothing hides it, as far as that is known beforehand.
        guess: (h, w) bool, a mask that is only begun from, or None.
        enlarged: times that the image was blown up, 1: it was not.
    """

    image: NDArray[np.uint8]
    camera: Camera
    picture: Mask
    given: Mask | None
    bins: Bins
    even: NDArray[np.uint8]
    known: Scene | None = None
    guess: Mask | None = None
    enlarged: float = 1.0


def small_view(
    image: NDArray[np.uint8],
    camera: Camera,
    picture: Mask,
    given: Mask | None,
    known: Scene | None = None,
    guess: Mask | None = None,
    enlarged: float = 1.0,
) -> SmallView:
    """A view with the bins of its colours, slightly softened against noise."""
    if image.ndim == 2:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    bins = colour_bins(np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), np.uint8))
    even = np.asarray(cv2.medianBlur(image, 5), np.uint8)
    return SmallView(image, camera, picture, given, bins, even, known, guess, enlarged)


def not_known(view: SmallView) -> Mask:
    """(h, w) where colours alone can tell: the print's own tell of no backdrop elsewhere."""
    if view.known is None:
        return np.ones(view.picture.shape, np.bool_)
    return ~np.isfinite(view.known[1])
