"""Contours drawn over their image, for people."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours
from .curves import normals
from .segment import to_uint8

_LOOP_COLOURS = ((80, 220, 60), (255, 160, 40), (220, 80, 220), (60, 200, 255), (200, 220, 60))
_DOUBT_COLOUR = (40, 40, 255)
_TICK_COLOUR = (0, 255, 255)
_DOUBT_PX = 0.5
_TICK_EVERY = 25
_TICK_PX = 8
_SHIFT = 4


def draw_contours(image: NDArray, contours: Contours) -> NDArray[np.uint8]:
    """Draw loops in colours, outward normals as ticks, doubtful stretches in red.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        contours: what was found in it.

    Returns:
        (h, w, 3) uint8 BGR, a new array.
    """
    grey = to_uint8(image)
    canvas = np.repeat(grey[..., None], 3, axis=2) if grey.ndim == 2 else grey.copy()
    if not len(contours):
        return canvas
    starts = contours.uv
    ends = starts[contours.next_row]
    doubtful = ~(contours.sigma < _DOUBT_PX * contours.radians_per_pixel)
    for loop in np.unique(contours.loop):
        mine = (contours.loop == loop) & contours.linked
        colour = _LOOP_COLOURS[int(loop) % len(_LOOP_COLOURS)]
        _segments(canvas, starts[mine & ~doubtful], ends[mine & ~doubtful], colour)
        _segments(canvas, starts[mine & doubtful], ends[mine & doubtful], _DOUBT_COLOUR)
        rows = np.flatnonzero(contours.loop == loop)
        out = normals(starts[rows], reach=2)[::_TICK_EVERY]
        feet = starts[rows][::_TICK_EVERY]
        _segments(canvas, feet, feet + _TICK_PX * out, _TICK_COLOUR)
    return canvas


def _segments(canvas: NDArray, a: NDArray, b: NDArray, colour: tuple[int, int, int]) -> None:
    if len(a):
        lines = np.round(np.stack([a, b], axis=1) * 2**_SHIFT).astype(np.int32)
        cv2.polylines(canvas, list(lines), False, colour, 1, cv2.LINE_AA, _SHIFT)
