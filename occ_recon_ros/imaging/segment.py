"""Object against background by brightness: a first mask, good to about a pixel."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import robust_sigma
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
# An object whose own shades are many is looked for at levels that leave the backdrop narrow:
_SAMPLES = 4000  # of the values along the border of the image
_BESIDE = 6.0  # standard deviations of the values along the border, from their median
_SHADED = 0.1  # of its size, pixels between that level and Otsu's
_AS_WELL = 0.85  # of the share of Otsu's outline on edges, the share of the wider one
_LOOKED_AT = 640  # px, the longer side of the image in which edges are looked for
_STEEP, _LEAST_SLOPE = 3.0, 0.5  # times the usual slope; grey levels a pixel
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
    counts = _histogram(grey[::4])
    level, contrast = otsu(counts)
    noise = _noise(grey, 1)
    if contrast < _NOISY * noise:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), _SOFTEN), np.uint8)
        counts = _histogram(grey[::4])
        level, contrast = otsu(counts)
        noise = _noise(grey, _FAR)
    if contrast < max(_LEAST_CONTRAST * step, _LEAST_CLEAR * max(noise, _ROUNDED)):
        raise ContourError(
            "no_object",
            f"nothing stands out: contrast {contrast / step:.0f} steps of the camera, noise "
            f"{noise / step:.1f}",
        )
    mask = object_side(grey, level, into)
    if contrast >= faint:
        return _with_shaded_sides(grey, counts, level, mask)
    if _across(grey, mask) < _STEP_SHARE * contrast:
        raise ContourError("no_object", "nothing stands out: light and dark merge without an edge")
    return mask


def _with_shaded_sides(grey: Mask, counts: NDArray, level: int, mask: Mask) -> Mask:
    """The mask, or a wider one where Otsu's level cuts the object at its own shading: there
    the wider one ends on edges of the image as well as it does."""
    column, row = cv2.minMaxLoc(mask)[3]  # a place of the object
    light = bool(grey[row, column] > level)
    size = counts.sum() * cv2.countNonZero(mask) / mask.size
    kind = cv2.THRESH_BINARY if light else cv2.THRESH_BINARY_INV
    seen = min(1.0, _LOOKED_AT / max(grey.shape))
    steep: NDArray[np.bool_] | None = None
    wanted = 0.0
    for other in (_beside_backdrop(grey, light), minimum_error(counts)):
        low, high = sorted((level, other))
        if (other < level) != light or counts[low + 1 : high + 1].sum() < _SHADED * size:
            continue
        wider = np.asarray(cv2.threshold(grey, other, 255, kind)[1], np.uint8)
        if cv2.countNonZero(wider) > _MOST_OF_IMAGE * wider.size:
            continue
        if steep is None:
            slope = _slope(_reduced(grey, seen))
            usual = float(np.median(slope[::8, ::8]))
            steep = slope > max(_STEEP * usual, _LEAST_SLOPE)
            wanted = _AS_WELL * _share_on(steep, _reduced(mask, seen))
        if _share_on(steep, _reduced(wider, seen)) >= wanted:
            mask[:] = wider
            break
    return mask


def _beside_backdrop(grey: Mask, light: bool) -> int:
    """The level just above the values along the border of the image, or just below."""
    border = frame(grey)
    border = border[:: max(1, len(border) // _SAMPLES)].astype(np.int16)
    home = float(np.median(border))
    spread = robust_sigma(border - home)
    away = _BESIDE * max(spread, 1.0)
    return int(np.clip(home + (away if light else -away), 0, 255))


def _reduced(image: Mask, scale: float) -> Mask:
    size = [max(1, round(scale * side)) for side in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _slope(grey: Mask) -> NDArray:
    """(h, w) the steepest change of brightness next to each pixel, grey levels a pixel."""
    soft = cv2.GaussianBlur(grey, (0, 0), 1.0)
    across = cv2.Sobel(soft, cv2.CV_32F, 1, 0, scale=0.125)
    down = cv2.Sobel(soft, cv2.CV_32F, 0, 1, scale=0.125)
    return np.asarray(cv2.dilate(cv2.magnitude(across, down), np.ones((3, 3), np.uint8)))


def _share_on(steep: NDArray[np.bool_], mask: Mask) -> float:
    """Share of the border of a mask that lies on steep places."""
    border = cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 127
    return float(np.mean(steep[border])) if border.any() else 0.0


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


def minimum_error(counts: NDArray) -> int:
    """The threshold of a histogram between two normal distributions, of any two widths.

    J. Kittler and J. Illingworth, Pattern Recognition 19(1), 1986,
    doi:10.1016/0031-3203(86)90030-0.
    """
    share = counts / counts.sum()
    i = np.arange(len(share))
    p, s, q = np.cumsum(share), np.cumsum(share * i), np.cumsum(share * i * i)
    low, high = np.maximum(p, 1e-12), np.maximum(1 - p, 1e-12)
    low_variance = np.maximum(q / low - (s / low) ** 2, 0.08)
    high_variance = np.maximum((q[-1] - q) / high - ((s[-1] - s) / high) ** 2, 0.08)
    cost = low * np.log(low_variance / low**2) + high * np.log(high_variance / high**2)
    cost[(p < 0.005) | (p > 0.995)] = np.inf
    return int(np.argmin(cost))


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
