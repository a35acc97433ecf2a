"""Which places of a surface a turning camera sees edge-on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from occ_recon_ros.geometry import Camera
from occ_recon_ros.scene.objects import SceneObject

Array = NDArray[np.float64]

_BISECTIONS = 40
_ROWS_AT_ONCE = 4000


def seen_edge_on(
    scene_object: SceneObject, points: Array, cameras: Sequence[Camera], closed: bool = True
) -> NDArray[np.bool_]:
    """Whether some position of the camera has a surface point on its visible contour.

    The camera moves along a smooth curve through the given centres. Where it crosses a
    point's tangent plane, the point is on the rim; it is on the visible contour if the
    ray through it is free before and behind it.

    Args:
        scene_object: the solid.
        points: (n, 3) float64, metres, on its surface.
        cameras: at least 4 positions in order, dense enough for each point's tangent
            plane to be crossed at most once between neighbours.
        closed: the last position is followed by the first.

    Returns:
        (n,) bool.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    normals, S = scene_object.shape(points)
    path = _path(cameras, closed)
    crossed = path.x
    side = normals @ path(crossed).T - (normals * points).sum(1)[:, None] > 0
    row, leg = np.nonzero(side[:, 1:] != side[:, :-1])
    centres = path(_crossings(path, normals[row], points[row], crossed[leg], crossed[leg + 1]))
    T = points[row] - centres
    T /= np.linalg.norm(T, axis=1, keepdims=True)
    convex = np.einsum("ni,nij,nj->n", T, S[row], T) > 0
    row, T = row[convex], T[convex]
    seen = np.zeros(len(points), bool)
    for start in range(0, len(row), _ROWS_AT_ONCE):
        here = row[start : start + _ROWS_AT_ONCE]
        free = _free(scene_object, points[here], T[start : start + _ROWS_AT_ONCE])
        seen[here[free]] = True
    return seen


def _path(cameras: Sequence[Camera], closed: bool) -> CubicSpline:
    centres = np.array([camera.centre for camera in cameras])
    if closed:
        centres = np.vstack([centres, centres[:1]])
    ends = "periodic" if closed else "natural"
    return CubicSpline(np.arange(len(centres)), centres, bc_type=ends)


def _crossings(path: CubicSpline, N: Array, P: Array, low: Array, high: Array) -> Array:
    """Where the path crosses tangent planes between two positions on it."""
    low, high = low.astype(np.float64), high.astype(np.float64)
    positive = ((path(low) - P) * N).sum(1) > 0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        before = (((path(middle) - P) * N).sum(1) > 0) == positive
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return 0.5 * (low + high)


def _free(scene_object: SceneObject, points: Array, T: Array) -> NDArray[np.bool_]:
    """Whether rays along T (n, 3) meet the solid nowhere but at points (n, 3)."""
    extent = np.concatenate([part.grid(16)[0] for part in scene_object.parts])
    size = float(np.linalg.norm(np.ptp(extent, axis=0)))
    # Finer near the point, where a ray enters at a shallow angle if it does.
    along = size * np.concatenate([np.geomspace(2e-3, 2e-2, 10), np.linspace(3e-2, 1, 150)])
    along = np.concatenate([-along, along])
    places = points[:, None] + along[None, :, None] * T[:, None]
    inside = scene_object.inside(places.reshape(-1, 3)).reshape(len(points), -1)
    return np.asarray(~inside.any(axis=1))
