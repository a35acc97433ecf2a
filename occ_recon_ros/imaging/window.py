"""The part of the image in which contours count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .padding import picture_area
from .segment import to_uint8
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

    def without_bars(self, image: NDArray) -> Window:
        """The picture within bars and frames of one colour around it."""
        rows, columns = picture_area(to_uint8(self.cut(image)))
        return replace(
            self,
            left=self.left + columns.start,
            top=self.top + rows.start,
            right=self.left + columns.stop,
            bottom=self.top + rows.stop,
        )

    def cut(self, image: NDArray) -> NDArray:
        """The part of an (h, w, ...) image that lies within."""
        return image[self.top : self.bottom, self.left : self.right]

    def restored(self, mask: NDArray[np.uint8], image: NDArray) -> NDArray[np.uint8]:
        """A mask of the part as one of the whole image, all outside of it background."""
        if mask.shape == image.shape[:2]:
            return mask
        whole = np.zeros(image.shape[:2], np.uint8)
        self.cut(whole)[:] = mask
        return whole

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(n,) whether each of (n, 2) points keeps clear of the border."""
        x, y = points.T
        inside = (x >= self.left + self.margin) & (x <= self.right - 1 - self.margin)
        return inside & (y >= self.top + self.margin) & (y <= self.bottom - 1 - self.margin)
