"""Loading what the first contours would else have to wait for."""

from functools import cache

import numpy as np

from ..geometry import Camera
from .settings import ContourSettings
from .tracker import ContourTracker

_SIDE, _RADIUS = 96, 30.0  # px, of the picture of a disc


@cache  # once a process
def warm_up() -> None:
    """Find a small contour, so that the compiled loops are there: a third of a second, or some
    seconds where they are compiled for the first time, in which a live scan would lose frames."""
    K = np.array([[_SIDE, 0, _SIDE / 2], [0, _SIDE, _SIDE / 2], [0, 0, 1.0]])
    camera = Camera(K, _SIDE, _SIDE, np.eye(3), np.array([0, 0, 1.0]))
    y, x = np.mgrid[:_SIDE, :_SIDE] - _SIDE / 2
    share = np.clip(_RADIUS - np.hypot(x, y), 0, 1)[..., None]
    image = (share * [60, 90, 200] + (1 - share) * [90, 160, 90]).astype(np.uint8)
    mask = np.uint8(255) * (share[..., 0] > 0.5)
    for segmentation in ("threshold", "chroma", "mask"):
        tracker = ContourTracker(ContourSettings(segmentation=segmentation))
        tracker.process(image, camera, 1, "object", mask)
