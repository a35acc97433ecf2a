"""Turns of exact contours about the objects of the virtual turntable, computed once a worker."""

from functools import cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene import SceneObject, TurntableSettings, make_object, turntable_cameras

ELEVATION = TurntableSettings().elevation


def exact_turn(
    name: str,
    frames: int = 36,
    elevation: float = ELEVATION,
    step: float | None = None,
    width: int = 640,
) -> tuple[SceneObject, list[Camera], list[Contours]]:
    """An object, and cameras and exact contours around it; elevation and step in radians, a full
    turn if there is no step; width of the images in pixels. The lists may be changed."""
    truth, cameras, contours = _turn(name, frames, elevation, step or 2 * np.pi / frames, width)
    return truth, list(cameras), list(contours)


@cache
def _turn(
    name: str, frames: int, elevation: float, step: float, width: int
) -> tuple[SceneObject, list[Camera], list[Contours]]:
    truth = make_object(name)
    size = {"width": width, "height": width * 3 // 4, "focal_px": 1.25 * width}
    cameras = turntable_cameras(
        TurntableSettings(frames=frames, step=step, elevation=elevation, **size)
    )
    return truth, cameras, [truth.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(cameras)]


@cache
def surface_points(name: str, count: int = 5000) -> NDArray[np.float64]:
    """(count, 3) points all over the surface of an object, metres."""
    truth = make_object(name)
    points = np.asarray(trimesh.sample.sample_surface(truth.mesh(64), count, seed=0)[0])
    return points - truth.distance(points)[:, None] * truth.shape(points)[0]
