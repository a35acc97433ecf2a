"""The part of the image in which contours count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .settings import ContourError, ContourSettings


@dataclass(frozen=True)
class Window:
    """Pixels left <= x < right, top <= y < bottom, and how far from its border a sample
    must stay."""

    left: int
    top: int
    right: int
    bottom: int
    margin: float

    @staticmethod
    def of(image: NDArray, settings: ContourSettings) -> Window:
        """The region of interest within an image.

        Raises:
            ContourError: roi, where they do not overlap.
        """
        s, (height, width) = settings, image.shape[:2]
        right = min(width, s.roi_x + s.roi_width) if s.roi_width else width
        bottom = min(height, s.roi_y + s.roi_height) if s.roi_height else height
        if right - s.roi_x < 3 or bottom - s.roi_y < 3:
            raise ContourError("roi", "the region of interest lies outside the image")
        return Window(s.roi_x, s.roi_y, right, bottom, s.border_px)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns of an image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def clear(self, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The mask with all outside of the window as background."""
        if (self.bottom - self.top, self.right - self.left) == mask.shape:
            return mask
        kept = np.zeros_like(mask)
        kept[self.slices] = mask[self.slices]
        return kept

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(n,) whether each of (n, 2) points keeps clear of the border."""
        x, y = points.T
        inside = (x >= self.left + self.margin) & (x <= self.right - 1 - self.margin)
        return inside & (y >= self.top + self.margin) & (y <= self.bottom - 1 - self.margin)
