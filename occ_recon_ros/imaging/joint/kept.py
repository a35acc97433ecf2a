"""A view of a turn, kept small until all have come."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ..padding import picture_area
from ..segment import to_uint8
from ..segmenter import mask_coverage
from ..settings import ContourError
from .edges import LONG_SIDE
from .masks import Window
from .plane import Backdrop
from .small_view import SmallView, small_view

_LONG_SIDE = 1280  # px, of the copies of which parts may be looked at again
_QUALITY = 95  # of their JPEG
_THUMBNAIL = 96  # px, of the longer side
_ENLARGED = 2.0  # most that an image is blown up

Packed = NDArray[np.uint8]


@dataclass(frozen=True)
class Kept:
    """A view as it was given, packed.

    Attributes:
        image: JPEG.
        camera: of the packed image.
        picture: rows and columns that are no padding.
        given: PNG, the mask that came with it.
        guess: PNG, a mask that is only begun from.
        size: (width, height) px of the image as it was given.
        known: PNG, what it would show if nothing hid the backdrop, and how sure that is (grey
            levels, 255: not known).
        gains: (channels,) by which the image is lighter than those of the other views, None: not.
    """

    image: Packed
    camera: Camera
    picture: tuple[slice, slice]
    given: Packed | None
    guess: Packed | None
    size: tuple[int, int]
    known: tuple[Packed, Packed] | None = None
    gains: NDArray[np.float32] | None = None

    @staticmethod
    def of(
        image: NDArray,
        camera: Camera,
        mask: NDArray | None,
        guess: NDArray | None,
        backdrop: Backdrop | None,
    ) -> Kept:
        """Pack a view, as ``JointSegmenter.add`` takes it.

        Raises:
            ContourError: image_size, where image and camera are not of one size.
        """
        if (camera.width, camera.height) != image.shape[1::-1]:
            raise ContourError(
                "image_size",
                f"image is {image.shape[1::-1]} px, camera_info says {camera.width, camera.height}",
            )
        image = to_uint8(image)
        full = image.shape[1], image.shape[0]
        scale = min(1.0, _LONG_SIDE / max(full))
        size = max(1, round(scale * full[0])), max(1, round(scale * full[1]))
        part = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        given, guessed = (
            _png(cv2.resize(mask_coverage(m), size, interpolation=cv2.INTER_AREA))
            if m is not None and m.shape == image.shape[:2]
            else None
            for m in (mask, guess)
        )
        packed = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
        camera = camera.resized(*size)
        known = None
        if backdrop is not None:
            shows, spread = backdrop.picture(part, camera)
            known = _png(np.clip(shows, 0, 255)), _png(np.clip(np.ceil(spread), 0, 255))
        jpeg = np.asarray(packed, np.uint8)
        return Kept(jpeg, camera, picture_area(part), given, guessed, full, known)

    def part(self, window: Window) -> SmallView:
        """A part of the view, in pixels of the packed image, in the size of the joint pass."""
        x0, y0, x1, y1 = window
        scale = min(_ENLARGED, LONG_SIDE / max(x1 - x0, y1 - y0))
        if (x1 - x0, y1 - y0) == (self.camera.width, self.camera.height):
            scale = min(1.0, scale)
        size = max(1, round(scale * (x1 - x0))), max(1, round(scale * (y1 - y0)))
        how = cv2.INTER_AREA if scale <= 1 else cv2.INTER_LINEAR

        def part(pixels: NDArray) -> NDArray[np.uint8]:
            return np.asarray(cv2.resize(pixels[y0:y1, x0:x1], size, interpolation=how), np.uint8)

        picture = np.zeros((self.camera.height, self.camera.width), np.uint8)
        picture[self.picture] = 1
        given, guess = (
            None if m is None else part(_unpacked(m)) > 127 for m in (self.given, self.guess)
        )
        K = self.camera.K.copy()
        K[:2, 2] -= [x0, y0]
        camera = replace(self.camera, K=K, width=x1 - x0, height=y1 - y0).resized(*size)
        known = None
        if self.known is not None:
            shows, doubt = map(_unpacked, self.known)
            # What lies partly on what is not known is not known.
            unsure = part(np.where(doubt == 255, 255, 0).astype(np.uint8)) > 0
            spread = np.where(unsure, np.float32(np.inf), part(doubt).astype(np.float32))
            known = part(shows).astype(np.float32), spread
        image = part(_unpacked(self.image))
        if self.gains is not None:
            channels = image.reshape(*image.shape[:2], -1) / self.gains
            image = np.clip(np.rint(channels), 0, 255).astype(np.uint8).reshape(image.shape)
        return small_view(image, camera, part(picture) > 0, given, known, guess, max(1.0, scale))

    def thumbnail(self) -> NDArray[np.uint8]:
        """(h, w, 3) or (h, w, 1) the image, made small."""
        image = _unpacked(self.image)
        scale = _THUMBNAIL / max(image.shape[:2])
        size = [max(1, round(scale * side)) for side in image.shape[1::-1]]
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        return np.asarray(small if small.ndim == 3 else small[..., None], np.uint8)

    def of_whole(self, window: Window) -> Window:
        """The window in pixels of the image as it was given."""
        return self._scaled(window, *np.divide(self.size, (self.camera.width, self.camera.height)))

    def of_packed(self, window: Window) -> Window:
        """A window of the image as it was given, in pixels of the packed one."""
        return self._scaled(window, *np.divide((self.camera.width, self.camera.height), self.size))

    @staticmethod
    def _scaled(window: Window, x: float, y: float) -> Window:
        x0, y0, x1, y1 = window
        return round(x * x0), round(y * y0), round(x * x1), round(y * y1)


def _png(levels: NDArray) -> Packed:
    return np.asarray(cv2.imencode(".png", np.rint(levels).astype(np.uint8))[1], np.uint8)


def _unpacked(packed: Packed) -> NDArray[np.uint8]:
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED), np.uint8)
