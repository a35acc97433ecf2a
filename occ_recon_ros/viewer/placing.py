"""Where the page's own camera stands, and in which units."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.arrays import Array

from .scan_view import ScanView

_DISTANCE = 3.2  # object radii
_HIGHER = 0.3  # of the way to the object
_ASIDE = np.deg2rad(35.0)  # from the view of the scanning camera


@dataclass(frozen=True)
class Placing:
    """How a scan is laid out on the page.

    Attributes:
        scale: page units a metre: the scanning camera is about one unit away, whatever the
            size of the rig.
        up: (3,) axis of the object frame that is up.
        target: (3,) middle of the object, page units.
        radius: of the object, page units.
        position: (3,) of the page's camera, page units.
    """

    scale: float
    up: Array
    target: Array
    radius: float
    position: Array


def place(view: ScanView) -> Placing | None:
    """From the first rim and camera, or whatever surface there is; None without any."""
    surfaces = [*view.rims, *([view.closed.vertices] if view.closed else [])]
    latest = view.surface.latest()
    if latest is not None:
        surfaces.append(latest.vertices)
    if not surfaces:
        return None
    points = np.concatenate(surfaces).astype(np.float64)
    low, high = np.percentile(points, [1, 99], axis=0)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    if radius == 0:
        return None
    frame = view.pictured()
    up = _upright(frame.R_object_camera) if frame else np.array([0.0, 0.0, 1.0])
    away = (frame.centre if frame else next(iter(view.centres), middle)) - middle
    distance = float(np.linalg.norm(away)) or 5 * radius
    if not away.any():
        away = np.array([1.0, 0.5, 0.5])
    aside = Rotation.from_rotvec(_ASIDE * up).apply(away / np.linalg.norm(away))
    scale = 1 / distance
    position = scale * (middle + _DISTANCE * radius * (aside + _HIGHER * up))
    return Placing(scale, up, scale * middle, scale * radius, position)


def _upright(R_object_camera: Array | None) -> Array:
    """(3,) the axis of the object frame, or its opposite, nearest to the image's up."""
    if R_object_camera is None:
        return np.array([0.0, 0.0, 1.0])
    up = -R_object_camera[:, 1]
    axis = int(np.abs(up).argmax())
    return np.eye(3)[axis] * np.sign(up[axis])
