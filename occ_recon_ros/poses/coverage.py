"""A picture of where in the image the corners of a calibration were."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .intrinsics import BoardView, Intrinsics


def coverage_picture(intrinsics: Intrinsics, views: Sequence[BoardView]) -> NDArray[np.uint8]:
    """Where the corners of all views were: (h, w, 3) uint8, dots on white."""
    width, height = intrinsics.camera.width, intrinsics.camera.height
    scale = min(1.0, 1200 / max(width, height))
    picture = np.full((round(scale * height), round(scale * width), 3), 255, np.uint8)
    known = dict(zip(intrinsics.views, intrinsics.view_rms_px, strict=True))
    worst = max(float(np.max(intrinsics.view_rms_px)), 1e-9)
    for view in views:
        share = known.get(view.name, worst) / worst
        colour = (60, int(200 * (1 - share)), int(255 * share))
        for u, v in np.rint(view.uv * scale).astype(int):
            cv2.circle(picture, (int(u), int(v)), 3, colour, -1, cv2.LINE_AA)
    return picture
