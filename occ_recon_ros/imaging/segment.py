"""Object against background: a first mask, good to about a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .settings import ContourError

Mask = NDArray[np.uint8]

_LEAST_CONTRAST = 8.0
_MOST_OF_IMAGE = 0.95


def threshold_mask(image: NDArray) -> Mask:
    """Otsu's threshold on the grey values; the object is what touches the border less.

    Returns:
        (h, w) uint8, 255 = object.
    """
    grey = to_uint8(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    return _object_side(grey, _otsu(grey))


def chroma_mask(image: NDArray) -> Mask:
    """Otsu's threshold on the distance of colour (not brightness) from the border's.

    Returns:
        (h, w) uint8, 255 = object.

    Raises:
        ContourError: no_colour, for a grey image.
    """
    if image.ndim == 2:
        raise ContourError("no_colour", "segmentation: chroma needs colour images, got grey ones")
    return _object_side(*_with_otsu(chroma_distance(image)))


def chroma_distance(image: NDArray) -> Mask:
    """(h, w) uint8, how far the colour of each pixel is from that of the image's border.

    Colour is the share of red and blue in the sum of the channels, so that shading and
    shadow on the backdrop do not count.
    """
    small = to_uint8(image).astype(np.float32)
    total = small.sum(axis=2) + 40.0
    red, blue = small[..., 2] / total, small[..., 0] / total
    red0, blue0 = (np.median(_frame(c)) for c in (red, blue))
    return np.clip(600 * np.hypot(red - red0, blue - blue0), 0, 255).astype(np.uint8)


def to_uint8(image: NDArray) -> Mask:
    """The image in 8 bits; 16 bits are stretched from the darkest to the brightest pixel."""
    if image.dtype == np.uint8:
        return image
    low, high = float(image.min()), float(image.max())
    scale = 255.0 / max(1.0, high - low)
    return cv2.convertScaleAbs(np.subtract(image, low, dtype=np.float32), alpha=scale)


def _frame(channel: NDArray) -> NDArray:
    """The pixels along the border, a little way in."""
    rim = max(2, min(channel.shape[:2]) // 50)
    return np.concatenate(
        [
            channel[:rim].ravel(),
            channel[-rim:].ravel(),
            channel[:, :rim].ravel(),
            channel[:, -rim:].ravel(),
        ]
    )


def _otsu(grey: Mask) -> float:
    return float(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0])


def _with_otsu(grey: Mask) -> tuple[Mask, float]:
    return grey, _otsu(grey)


def _object_side(grey: Mask, level: float) -> Mask:
    bright = cv2.compare(grey, level, cv2.CMP_GT)
    dark, light = cv2.mean(grey, cv2.bitwise_not(bright))[0], cv2.mean(grey, bright)[0]
    if light - dark < _LEAST_CONTRAST:
        raise ContourError("no_object", f"nothing stands out: contrast {light - dark:.0f} of 255")
    mask = bright if np.mean(_frame(bright) > 0) <= 0.5 else cv2.bitwise_not(bright)
    share = cv2.countNonZero(mask) / mask.size
    if share > _MOST_OF_IMAGE or share == 0:
        raise ContourError("no_object", f"the object would cover {share:.0%} of the image")
    return mask
