"""Object against a coloured backdrop, whatever the light on it.

Pixels are compared by the shares of red and blue in their sum, which shading and shadow
leave alone. Fisher's discriminant finds the direction in that plane in which object and
backdrop differ, the minimum-error threshold the limit on it: unlike Otsu's it allows a
backdrop of narrow and an object of wide colour.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import robust_sigma
from ..geometry.compiled import compiled
from .curves import for_loops
from .segment import Mask, frame, minimum_error, object_side, to_uint8
from .settings import ContourError

Array = NDArray[np.floating]

_DARK = 40.0  # added to the sum of the channels, so that noise in the dark has no colour
_SAMPLES = 12_000
_ROUNDS = 3
_LEAST_SPREAD = 2e-6
_LEAST_SEPARATION = 2.0
_LEAST_WAY = 0.15  # from the backdrop's colour to the object's: JPEG strews less about an edge
_LEVEL = 1.0  # grey level, of one channel, that is no colour
_CLEAR = 1 / 240  # grey levels of the channel that tells most, beyond the limit


def chroma_mask(image: NDArray, into: Mask | None = None) -> Mask:
    """The object by colour.

    Args:
        image: (h, w, 3) BGR, uint8 or uint16.
        into: as of ``threshold_mask``.

    Returns:
        (h, w) uint8, 255 = object.

    Raises:
        ContourError: no_colour for a grey image, no_object where no colour stands out.
    """
    if image.ndim == 2:
        raise ContourError("no_colour", "segmentation: chroma needs colour images, got grey ones")
    small = to_uint8(image)
    (red, blue), limit, separation = discriminant(small)
    if separation < _LEAST_SEPARATION:
        raise ContourError("no_object", "no colour stands out from the backdrop's")
    # red R/sum + blue B/sum > limit is linear in B, G, R once multiplied by the sum.
    plane = np.array([blue - limit, -limit, red - limit, -limit * _DARK])
    plane[3] -= _CLEAR * np.abs(plane[:3]).max()
    if into is None or into.shape != image.shape[:2]:
        into = np.empty(image.shape[:2], np.uint8)
    compiled("imaging.pixel_kernels").beyond(for_loops(small), plane.astype(np.float32), into)
    return object_side(into, 0, into)


def discriminant(image: Mask) -> tuple[Array, float, float]:
    """The direction in the plane of the shares of red and blue, the limit on it, and how
    many standard deviations of the backdrop the object's mean lies from the backdrop's."""
    step = max(1, int(np.sqrt(image.shape[0] * image.shape[1] / _SAMPLES)))
    some = image[::step, ::step].reshape(-1, 3)
    colours, sums = _shares(some), some.sum(axis=1) + _DARK
    border = frame(image)
    home = np.median(_shares(border[:: max(1, len(border) // _SAMPLES)]), axis=1)
    x, y = colours - home[:, None]
    levels = np.clip(np.hypot(x, y) * 600, 0, 255).astype(np.uint8)
    is_object = levels > cv2.threshold(levels, 0, 255, cv2.THRESH_OTSU)[0]
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    whole = terms.sum(axis=1)
    w, limit, separation = np.array([1.0, 0.0]), 0.0, 0.0
    for _ in range(_ROUNDS):
        inside = terms @ is_object.astype(np.float64)
        outside = whole - inside
        if min(inside[0], outside[0]) < 10:
            return w, limit, 0.0
        (mean_in, spread_in), (mean_out, spread_out) = _normal(inside), _normal(outside)
        spread = 0.5 * (spread_in + spread_out) + _LEAST_SPREAD * np.eye(2)
        w = np.linalg.solve(spread, mean_in - mean_out)
        z = w @ colours
        z0, z1 = np.median(z[~is_object]), np.median(z[is_object])
        if z1 - z0 < 1e-9:
            return w, limit, 0.0
        binned = np.clip(64 + 128 * (z - z0) / (z1 - z0), 0, 255).astype(np.uint8)
        way = (minimum_error(np.bincount(binned, minlength=256)) + 0.5 - 64) / 128
        limit = float(z0 + way * (z1 - z0))
        before, is_object = is_object, z > limit
        if is_object.all() or not is_object.any():
            return w, limit, 0.0
        # Whole levels hide noise, and JPEG strews as much: of it, dark colours are made.
        level = _LEVEL * float(np.abs(w).max()) / (np.median(sums[~is_object]))
        deviation = max(robust_sigma((z - z0)[~is_object]), level)
        separation = float(z1 - z0) / max(deviation, 1e-9)
        if (is_object == before).all():  # as another round would find
            break
    return w, max(limit, float(z0 + _LEAST_WAY * (z1 - z0))), separation


def _normal(sums: Array) -> tuple[Array, Array]:
    """Mean (2,) and covariance (2, 2) from the sums (6,) of 1, x, y, xx, xy, yy."""
    n, *mean = sums[:3]
    mean = np.array(mean) / n
    square = sums[[3, 4, 4, 5]].reshape(2, 2)
    return mean, (square - n * np.outer(mean, mean)) / (n - 1)


def _shares(colours: NDArray) -> Array:
    """(2, n) shares of red and blue of (n, 3) BGR colours."""
    blue, green, red = colours.T.astype(np.float64)
    return np.stack([red, blue]) / (blue + green + red + _DARK)
