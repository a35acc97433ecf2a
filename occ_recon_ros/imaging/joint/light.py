"""What is lighter than an empty scene before a dark backdrop, though as dark as that elsewhere."""

from collections.abc import Sequence
from itertools import repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import evenly
from .each import each
from .regions import Mask, shrunk, square
from .scenes import LEAST_SEEN, USUAL, Array, Scene, dot, doubt_of_place, strongest, typical

_LEAST_EVEN, _LEAST_OF_LIGHT = 0.5, 0.01  # of such a backdrop, and share of its level
_CLEARLY, _CLEAN = 20.0, 0.05  # squared sigmas, and share of a backdrop so much lighter than empty
_NEAR_BODY = 0.06  # of the image's long side
_LOOKED_AT, _MOST_CLEAN = 12, 0.75  # views, and share of them that must be so
_HALO = 0.06  # share of a bright place that blurs over what is two pixels from it
_MOSTLY_SHOWN = 0.6  # of the views must show an empty place
_NEIGHBOURHOOD = 0.1  # of the image's long side, over which a backdrop is alike
_LEAST_PLACES = 0.01  # share of the picture
_SOME_PIXELS = 1000  # from which on a median says something


def empty_scene(images: Sequence[NDArray[np.uint8]], shown: Sequence[Mask]) -> Scene | None:
    """What a fixed camera sees without the object, and its spread, also where the object always
    hides it: there by what is around it, with doubt as large as that is uneven.

    Args:
        images: n views of one size, without noise.
        shown: of each, (h, w) where the backdrop is not hidden.
    """
    if len({image.shape for image in images}) > 1 or len(images) < LEAST_SEEN:
        return None
    chosen = evenly(len(images), 32)
    stack = np.stack([images[k] for k in chosen]).astype(np.float32)
    seen = np.stack([shown[k] for k in chosen])
    mostly = seen.mean(axis=0) >= _MOSTLY_SHOWN
    if mostly.mean() < _LEAST_PLACES:
        return None
    seen &= mostly
    median, _ = typical(stack, seen)
    # The light, or the exposure, is not the same in all views.
    stack -= np.stack(each(_offset, stack, repeat(median), seen))[:, None, None]
    median, spread = typical(stack, seen)
    known = np.isfinite(spread)
    if not known.any():
        return None
    reach = max(images[0].shape[:2]) * _NEIGHBOURHOOD

    def around(values: NDArray[np.float32]) -> NDArray[np.float32]:
        weights = np.maximum(cv2.GaussianBlur(known.astype(np.float32), (0, 0), reach), 1e-6)
        masked = np.where(known if values.ndim == 2 else known[..., None], values, np.float32(0))
        soft = np.asarray(cv2.GaussianBlur(masked, (0, 0), reach), np.float32)
        return np.asarray(soft / (weights if values.ndim == 2 else weights[..., None]), np.float32)

    level = around(median)
    uneven = around(strongest((median - level) ** 2)) + around(spread) ** 2
    filled = np.where(known[..., None], median, level)
    return filled, np.where(known, spread, np.sqrt(uneven)).astype(np.float32)


def is_clean(images: Sequence[NDArray[np.uint8]], empty: Scene, outside: Sequence[Mask]) -> bool:
    """Whether the backdrop away from the object is as dark as usual in nearly all views.

    Cloth may move, and a rod behind the object stand elsewhere in each view. Near the object dark
    parts of it may have been taken for backdrop.

    Args:
        images: n views, without noise.
        empty: what they show without the object.
        outside: of each, (h, w) where it seems to show the backdrop.
    """
    around, found = square(2 * round(_NEAR_BODY * max(empty[1].shape)) + 1), []
    for k in evenly(len(images), _LOOKED_AT):
        far = shrunk(outside[k], around)
        excess = excess_light(images[k], empty, outside[k])[far]
        found.append(len(excess) > 0 and float(np.mean(excess > _CLEARLY)) < _CLEAN)
    return bool(np.mean(found) >= _MOST_CLEAN)


def _offset(image: NDArray, scene: NDArray, shown: Mask) -> NDArray[np.float32]:
    """(3,) grey levels by which an image is lighter than a scene where that is shown."""
    if np.count_nonzero(shown) < _SOME_PIXELS:
        return np.zeros(3, np.float32)
    return np.asarray(np.median(image[shown] - scene[shown], axis=0), np.float32)


def excess_light(even: NDArray[np.uint8], scene: Scene, outside: Mask) -> Array:
    """(h, w) squared sigmas by which places are lighter than an empty scene, beyond what is
    usual.

    Without noise a little light on a dark object tells it from a backdrop as dark.

    Args:
        even: (h, w, 3) an image without noise.
        scene: what it shows without the object.
        outside: (h, w) where the image surely shows the backdrop.
    """
    median, spread = scene
    # Beside a bright place its blur is as light as a dark object.
    halo = strongest(cv2.dilate(even, square(3), iterations=2) - even.astype(np.float32))
    least = _LEAST_EVEN + _LEAST_OF_LIGHT * strongest(median)
    sigma = np.sqrt(spread**2 + doubt_of_place(median) ** 2 + (_HALO * halo) ** 2 + least**2)
    more = np.maximum(even - median - _offset(even, median, outside), 0.0) / sigma[..., None]
    return np.clip(dot(more, more) - USUAL, 0.0, 120.0)
