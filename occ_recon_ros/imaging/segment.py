"""Object against background by brightness: a first mask, good to about a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .backdrop import evened
from .settings import ContourError

Mask = NDArray[np.uint8]

_LEAST_CONTRAST = 3.0  # grey levels: fewer steps of the camera's converter place no edge
# Contrasts that a backdrop may have in itself, from place to place: grey levels of 8 bits, share
# of the brightest place where 16 bits say nothing of the camera's range. Such need an edge:
_FAINT, _FAINT_SHARE = 8.0, 0.08
_STEP_PX, _STEP_SHARE = 4, 0.6  # within so many pixels to either side, most of the contrast
_LEAST_CLEAR = 4.0  # sigmas of the noise; two halves of noise alone are 1.6 apart
_MOST_OF_IMAGE = 0.95
_NOISY = 12.0
_SOFTEN = 1.5
_FAR = 8  # px, beyond the reach of the softening
_ROUNDED = 0.29  # sigma of rounding to whole steps, 1 / sqrt(12)


def threshold_mask(image: NDArray, into: Mask | None = None) -> Mask:
    """Otsu's threshold on the grey values, the light on the backdrop evened.

    The object is what touches the border less.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        into: (h, w) uint8 to be written over, which spares the system a new one.

    Returns:
        (h, w) uint8, 255 = object.

    Raises:
        ContourError: no_object, where nothing stands out.
    """
    grey = evened(to_grey(image))
    step, faint = _step(image)
    # A quarter of the pixels tells the brightness of the two as well as all of them.
    level, contrast = otsu(_histogram(grey[::4]))
    noise = _noise(grey, 1)
    if contrast < _NOISY * noise:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), _SOFTEN), np.uint8)
        level, contrast = otsu(_histogram(grey[::4]))
        noise = _noise(grey, _FAR)
    if contrast < max(_LEAST_CONTRAST * step, _LEAST_CLEAR * max(noise, _ROUNDED)):
        raise ContourError(
            "no_object",
            f"nothing stands out: contrast {contrast / step:.0f} steps of the camera, noise "
            f"{noise / step:.1f}",
        )
    mask = object_side(grey, level, into)
    if contrast < faint and _across(grey, mask) < _STEP_SHARE * contrast:
        raise ContourError("no_object", "nothing stands out: light and dark merge without an edge")
    return mask


def _across(grey: Mask, mask: Mask) -> float:
    """The change of the mean from just outside of a mask to just inside."""
    near = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _STEP_PX + 1, 2 * _STEP_PX + 1))
    inside = cv2.subtract(mask, cv2.erode(mask, near))
    outside = cv2.subtract(cv2.dilate(mask, near), mask)
    return abs(cv2.mean(grey, inside)[0] - cv2.mean(grey, outside)[0])


def otsu(counts: NDArray) -> tuple[int, float]:
    """Otsu's threshold of a histogram, and the distance of the means of its two classes.

    N. Otsu, IEEE Trans. SMC 9(1), 1979, doi:10.1109/TSMC.1979.4310076.
    """
    share = counts.astype(np.float64) / counts.sum()
    below, moment = np.cumsum(share), np.cumsum(share * np.arange(len(share)))
    above = 1 - below
    both = (below > 1e-9) & (above > 1e-9)
    apart = np.where(
        both,
        (moment[-1] - moment) / np.where(both, above, 1) - moment / np.where(both, below, 1),
        0.0,
    )
    level = int(np.argmax(below * above * apart**2))
    return level, float(apart[level])


def _histogram(grey: NDArray) -> NDArray:
    """(256,) how many pixels of an (h, w) uint8 image have each value."""
    return cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel()


def _noise(grey: Mask, apart: int) -> float:
    """Noise of an image, grey levels, from the differences of pixels so far apart in some rows."""
    rows = grey[::32]
    counts = _histogram(cv2.absdiff(rows[:, apart:], rows[:, :-apart]))
    below = np.cumsum(counts)
    if not below[-1]:
        return 0.0
    # A difference of k levels is one from k - 1/2 to k + 1/2; of 0 levels, below 1/2.
    median = np.interp(below[-1] / 2, np.r_[0.0, below], np.r_[0.0, np.arange(256) + 0.5])
    return float(1.4826 / np.sqrt(2) * median)


def object_side(values: Mask, level: int, into: Mask | None = None) -> Mask:
    """The pixels above a level or the others, whichever hold less of the border of the image.

    Args:
        values: (h, w) uint8.
        level: of the values.
        into: as of ``threshold_mask``.

    Returns:
        (h, w) uint8, 255 = object.

    Raises:
        ContourError: no_object, where the object would cover all of the image or nothing.
    """
    border = frame(values)
    dark = np.count_nonzero(border > level) > 0.5 * border.size
    kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
    mask = np.asarray(cv2.threshold(values, level, 255, kind, dst=into)[1], np.uint8)
    share = cv2.countNonZero(mask) / mask.size
    if share > _MOST_OF_IMAGE or share == 0:
        raise ContourError("no_object", f"the object would cover {share:.0%} of the image")
    return mask


def to_grey(image: NDArray) -> Mask:
    """(h, w) uint8 of a grey or BGR image of 8 or 16 bits."""
    image = to_uint8(image)
    if image.ndim == 3:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    return image


def to_uint8(image: NDArray) -> Mask:
    """The image in 8 bits; 16 bits are stretched from the darkest to the brightest place that
    is more than a hot or dead pixel."""
    if image.dtype == np.uint8:
        return image
    low, high = _span(image)
    lifted = cv2.subtract(image, np.full(4, low))
    return np.asarray(cv2.convertScaleAbs(lifted, alpha=255.0 / (high - low)), np.uint8)


def _span(image: NDArray[np.uint16]) -> tuple[float, float]:
    """The darkest and the brightest place, at least a step apart."""
    few = cv2.medianBlur(np.ascontiguousarray(image[::4, ::4]), 3)
    low = float(few.min())
    return low, max(float(few.max()), low + 1.0)


def _step(image: NDArray) -> tuple[float, float]:
    """What a step of the camera's converter is in grey levels of ``to_uint8``, and a contrast
    that is faint."""
    if image.dtype == np.uint8:
        return 1.0, _FAINT
    low, high = _span(image)
    step = 255.0 / (high - low)
    return step, _FAINT_SHARE * high * step


def frame(image: NDArray) -> NDArray:
    """The pixels along the border, a fiftieth of the image deep; rows of channels."""
    deep = max(2, min(image.shape[:2]) // 50)
    rest = image.shape[2:]
    sides = (image[:deep], image[-deep:], image[:, :deep], image[:, -deep:])
    return np.concatenate([side.reshape(-1, *rest) for side in sides])
