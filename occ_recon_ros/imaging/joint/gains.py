"""Light, exposure and white balance that change from image to image."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_DARK, _BRIGHT = 12.0, 240.0  # grey levels between which a ratio tells
_ENOUGH = 0.1  # share of the pixels that must be so
_SAME = 0.04  # by which a place may differ from itself
_STANDS = 0.5  # share of the usual image that must look the same then: the camera stood still
_ROUNDS = 2  # of two exposures the usual image is neither, but where what moves makes it one
_BETTER = 0.1  # of all pixels, that look the same with gains and not without


def gains_between(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
    """By how much each image is lighter than usual, channel by channel, as the backdrop of a camera
    that stands still tells.

    Args:
        images: n of them, (h, w, channels).

    Returns:
        (n, channels) factors; all 1 where the camera moves, or nothing changes.
    """
    none = np.ones((len(images), images[0].shape[2]), np.float32)
    if len({image.shape for image in images}) != 1:
        return none
    stack, gains = np.stack(images).astype(np.float32), none
    for _ in range(_ROUNDS):
        if (ratios := _to_usual(stack, gains)) is None:
            return none
        gains = np.asarray(np.nanmedian(ratios, axis=(1, 2)), np.float32)
    with_gains, without = (_alike(_to_usual(stack, g), g) for g in (gains, none))
    return gains if with_gains > max(_STANDS, without + _BETTER) else none


def _to_usual(stack: NDArray[np.float32], gains: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """(n, h, w, channels) of each image to the usual one of these gains, NaN where that tells
    nothing; None where it tells too little of one."""
    usual = np.median(stack / gains[:, None, None], axis=0)
    tells = (usual > _DARK) & (usual < _BRIGHT) & (stack > 0) & (stack < _BRIGHT)
    if not np.count_nonzero(tells, axis=(1, 2)).min() > _ENOUGH * usual[..., 0].size:
        return None
    return np.where(tells, stack / np.maximum(usual, 1.0), np.float32(np.nan))


def _alike(ratios: NDArray[np.float32] | None, gains: NDArray[np.float32]) -> float:
    """Share of the places that look as usual, in the median of the images."""
    if ratios is None:
        return 0.0
    own = gains[:, None, None]
    same = np.where(np.isnan(ratios), np.nan, np.abs(ratios - own) < _SAME * own)
    return float(np.median(np.nanmean(same, axis=(1, 2, 3))))
