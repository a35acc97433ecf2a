"""Whether the images of one sheet were taken with two settings of zoom or focus.

A plane under a tilt tells the focal length from one image alone, if the principal point is in the
middle (Z. Zhang, "A flexible new technique for camera calibration", PAMI 22(11), 2000,
doi:10.1109/34.888718, equations 3 and 4).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from occ_recon_ros.geometry.arrays import Array

from .intrinsics import FEWEST_VIEWS, BoardView, calibrate_intrinsics

_APART = 0.1  # of itself, that the focal lengths differ; less may be of focus, or of a tilt
_CLEAR = 3.0  # times the spread of either group
_BETTER = 0.5  # of the distance of the corners, that must be left with a camera for each group
_FEWEST_CORNERS = 8
_NAMED = 4


def two_zooms(views: Sequence[BoardView], size: tuple[int, int], rms_px: float) -> str:
    """What is wrong where focal lengths fall into two groups, in words; "" where they do not.

    A principal point off the middle, or distortion, makes groups too where the board was seen
    under two tilts; one camera then explains all views.

    Args:
        views: of the board.
        size: width and height of the images, pixels.
        rms_px: how far the corners are off with one camera for all, root mean square; inf: none
            was found.
    """
    usable = [view for view in views if len(view.points) >= _FEWEST_CORNERS]
    focal = np.array([_focal_px(view, size) for view in usable])
    known = np.flatnonzero(np.isfinite(focal))
    order = known[np.argsort(focal[known])]
    if len(order) < 2 * FEWEST_VIEWS:
        return ""
    log_f = np.log(focal[order])
    gaps = np.diff(log_f)[FEWEST_VIEWS - 1 : len(order) - FEWEST_VIEWS]
    cut = int(gaps.argmax()) + FEWEST_VIEWS
    spread = max(float(np.ptp(log_f[:cut])), float(np.ptp(log_f[cut:])))
    if log_f[cut] - log_f[cut - 1] < max(_APART, _CLEAR * spread):
        return ""
    groups = [[usable[k] for k in sorted(part)] for part in (order[:cut], order[cut:])]
    try:
        told = [calibrate_intrinsics(group, size) for group in groups]
    except ValueError:
        return ""
    if max(found.rms_px for found in told) > _BETTER * rms_px:
        return ""
    each = [
        f"{found.camera.K[0, 0]:.0f} px in {len(group)} images ({some_of([v.name for v in group])})"
        for found, group in zip(told, groups, strict=True)
    ]
    return (
        f"zoom or focus was changed: the focal length is {' and '.join(each)}; use photographs of "
        "one setting"
    )


def some_of(names: Sequence[str]) -> str:
    """The first of names, in words."""
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")


def _focal_px(view: BoardView, size: tuple[int, int]) -> float:
    """Focal length by least squares of the two conditions of one homography; NaN: none."""
    scale = float(max(size))
    uv = (view.uv - (np.array(size) - 1) / 2) / scale
    found, _ = cv2.findHomography(view.points[:, :2], uv, 0)
    if found is None:
        return float("nan")
    H: Array = np.asarray(found, np.float64)
    a, b = H[:, 0], H[:, 1]
    across = np.array([a[:2] @ b[:2], a[:2] @ a[:2] - b[:2] @ b[:2]])
    along = -np.array([a[2] * b[2], a[2] ** 2 - b[2] ** 2])
    inverse = float(across @ along / (across @ across))  # 1 / f^2
    return scale / float(np.sqrt(inverse)) if inverse > 0 else float("nan")
