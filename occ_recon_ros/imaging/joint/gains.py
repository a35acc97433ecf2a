"""Light, exposure and white balance that change from image to image."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_DARK, _BRIGHT = 12.0, 240.0  # grey levels between which a ratio tells
_ENOUGH = 0.1  # share of the pixels that must be so
_SAME = 0.04  # by which a place may differ from itself
_STANDS = 0.5  # share of the usual image that must look the same then: the camera stood still
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
    stack = np.stack(images).astype(np.float32)
    usual = np.median(stack, axis=0)
    tells = (usual > _DARK) & (usual < _BRIGHT) & (stack > 0) & (stack < _BRIGHT)
    if not np.count_nonzero(tells, axis=(1, 2)).min() > _ENOUGH * usual[..., 0].size:
        return none
    ratios = np.where(tells, stack / np.maximum(usual, 1.0), np.nan)
    gains = np.nanmedian(ratios, axis=(1, 2))
    alike = [
        np.nanmean(np.where(tells, np.abs(ratios - g) < _SAME * g, np.nan), axis=(1, 2, 3))
        for g in (gains[:, None, None], none[:, None, None])
    ]
    with_gains, without = map(np.median, alike)
    return gains if with_gains > max(_STANDS, without + _BETTER) else none
