"""Colour models of object and backdrop, learnt over all views."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Bins = NDArray[np.int32]

_LIGHT, _HUE = 24, 24  # bins of lightness and of each of the two hue axes
_HUE_SPAN = 72  # levels of a and b to either side of grey that have bins of their own
_SOFTEN = 0.8  # bins by which histograms are blurred
_UNSEEN = 0.02  # share of each model that is even over all colours: none is impossible

# Lightness goes by its root: a backdrop below 20 and a crevice at 30 are worlds apart.
_lightness = np.minimum(_LIGHT - 1, _LIGHT * np.sqrt(np.arange(256) / 256.0)).astype(np.int32)
_hue = np.clip((np.arange(256) - 128 + _HUE_SPAN) * _HUE // (2 * _HUE_SPAN), 0, _HUE - 1)
COUNT = _LIGHT * _HUE * _HUE


def colour_bins(image: NDArray[np.uint8]) -> Bins:
    """(h, w) int32 bin of each pixel of an (h, w) or (h, w, 3) BGR image, by CIE L*a*b*."""
    if image.ndim == 2:
        return (_lightness[image] * _HUE + _HUE // 2) * _HUE + _HUE // 2
    lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB)
    hue = _hue.astype(np.int32)
    return (_lightness[lab[..., 0]] * _HUE + hue[lab[..., 1]]) * _HUE + hue[lab[..., 2]]


@lru_cache(maxsize=1)
def bin_colours() -> NDArray[np.uint8]:
    """(COUNT, 3) BGR, the middle of each bin."""
    light, a, b = np.unravel_index(np.arange(COUNT), (_LIGHT, _HUE, _HUE))
    lightness = 256.0 * ((light + 0.5) / _LIGHT) ** 2
    hue = [128.0 - _HUE_SPAN + (k + 0.5) * 2 * _HUE_SPAN / _HUE for k in (a, b)]
    lab = np.clip(np.stack([lightness, *hue], axis=-1), 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(lab[:, None], cv2.COLOR_LAB2BGR)[:, 0], np.uint8)


def histogram(bins: NDArray, weights: NDArray | None = None) -> NDArray[np.float64]:
    """(COUNT,) weight of each bin, not blurred, not normed."""
    return np.bincount(bins.ravel(), None if weights is None else weights.ravel(), COUNT).astype(
        np.float64
    )


def probability(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """(COUNT,) probability of each bin, from its counts."""
    soft = gaussian_filter(counts.reshape(_LIGHT, _HUE, _HUE), _SOFTEN, mode="constant").ravel()
    total = soft.sum()
    even = 1.0 / COUNT
    return (1 - _UNSEEN) * soft / total + _UNSEEN * even if total > 0 else np.full(COUNT, even)
