"""Corrected cameras in the object frame of the given ones.

Contours see no place, turn and scale of the object frame: seven numbers that a correction of
poses and focal length leaves to chance. They are chosen so that the surface which the corrected
cameras see lies, in the given cameras, where these saw its outlines.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import (
    Camera,
    Contours,
    Rim,
    RimReconstructor,
    RimSettings,
    Status,
)
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.geometry.viewing import seen_by

_POINTS = 100  # of each rim
_FEWEST = 30  # points of all
_SOFT_PX = 1.0  # residuals above count less than their square


def held_in_place(
    corrected: Sequence[Camera], given: Sequence[Camera], contours: Sequence[Contours | None]
) -> list[Camera]:
    """The corrected cameras, moved, turned and scaled together to fit the given ones.

    Args:
        corrected, given: n views each.
        contours: of the n views, found with the given cameras; None where there are none.

    Returns:
        n cameras that see the same of a surface which is moved, turned and scaled with them; the
        corrected ones as they are where too little surface comes of them to tell.
    """
    found = _rim_points(corrected, contours)
    some = [k for k, (X, _) in enumerate(found) if len(X)]
    if sum(len(found[k][0]) for k in some) < _FEWEST:
        return list(corrected)
    middle = np.concatenate([found[k][0] for k in some]).mean(axis=0)
    size = max(float(np.median([np.linalg.norm(c.centre - middle) for c in corrected])), 1e-12)

    def residuals(x: Array) -> Array:
        """In px; x is a turn (3), a shift (3) in sizes and the logarithm of a scale."""
        turn, scale = Rotation.from_rotvec(x[:3]).as_matrix(), np.exp(x[6])
        off = [
            given[k].project(middle + scale * (X - middle) @ turn.T + size * x[3:6]) - uv
            for k, (X, uv) in ((k, found[k]) for k in some)
        ]
        return np.nan_to_num(np.concatenate(off).ravel(), nan=1e3)

    x = least_squares(residuals, np.zeros(7), loss="soft_l1", f_scale=_SOFT_PX).x
    turn, scale = Rotation.from_rotvec(x[:3]).as_matrix(), float(np.exp(x[6]))
    placed = []
    for camera in corrected:
        centre = middle + scale * turn @ (camera.centre - middle) + size * x[3:6]
        placed.append(camera.at(CameraPose(turn @ camera.R_camera_object.T, centre)))
    return placed


def _rim_points(
    cameras: Sequence[Camera], contours: Sequence[Contours | None]
) -> list[tuple[Array, Array]]:
    """Good rim points (m, 3) of each view, and the pixels (m, 2) that they were seen at."""
    reconstructor, rims = RimReconstructor(RimSettings()), dict[int, Rim]()
    for k, (camera, seen) in enumerate(zip(cameras, contours, strict=True)):
        if seen is not None and len(seen) > 2:
            rims |= {rim.stamp_ns: rim for rim in reconstructor.add(seen_by(camera, seen, k))}
    rims |= {rim.stamp_ns: rim for rim in reconstructor.finish()}
    found = []
    for k, seen in enumerate(contours):
        rim = rims.get(k)
        if rim is None or seen is None:
            found.append((np.zeros((0, 3)), np.zeros((0, 2))))
            continue
        good = np.flatnonzero(rim.status == Status.GOOD)
        good = good[:: max(1, len(good) // _POINTS)]
        found.append((rim.points[good], seen.uv[good]))
    return found
