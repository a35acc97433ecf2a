"""Where a view stands, roughly, by laying its outline on the body that other views leave.

A ray of a right outline touches the body: along it the least distance to the visual hull of the
others is zero. Where it passes beside the hull or goes through it, that distance, signed, says by
how much. A robust least squares fit of these of all rays finds the pose from some degrees away; of
several places to begin with the one that fits best is taken.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array

from .refine_coherence import DistanceImage
from .refine_lens import undistorted
from .refine_rig import Rig

_GRID = 48  # cells along the cube about the object
_REACH = 1.3  # radii of the object from its middle to the sides of that cube
_RAYS, _DEPTHS = 120, 40
_SOFT = 0.03  # of the object's radius: rays that miss by more count less than their square
_SEEN = 0.05  # of what is seen of the way of moving that shows most; less is the grid's
_TURNS = np.deg2rad([0, 6, -6, 12, -12])  # about the axis, to begin from
_TILTS = np.deg2rad([0, 6, -6])  # about the way to the right in the image
_FIRST, _LAST = 8, 30  # steps from each place, and from the best
_FARTHEST = 0.1  # of the object's radius, in one step
# Another place than the first is better by so much: of its misfit, and by what rays make that pass
# so far, in radii of the object, beside the hull.
_CLEARLY, _AT_LEAST = 0.9, 0.003


def moved(camera: Camera, x: Array, middle: Array, radius: float) -> Camera:
    """A camera that sees an object moved.

    Args:
        camera: as it is.
        x: (6,) float64, in the camera's frame: turn of the object about its middle (rad), shift
            of that in its radii, along the view in its distances.
        middle, radius: (3,) and of the object, metres, object frame.
    """
    R = Rotation.from_rotvec(x[:3]).as_matrix() @ camera.R_camera_object
    at = camera.in_camera(middle)
    t = at + units(at, radius) * x[3:] - R @ middle
    return replace(camera, R_camera_object=R, t_camera_object=t)


def units(at: Array, radius: float) -> Array:
    """(3,) metres of the shifts of ``moved``; at: (3,) the object's middle, camera frame."""
    return np.array([radius, radius, float(np.linalg.norm(at))])


class HullOfOthers:
    """The visual hull of views as a grid of how far its points are outside of it.

    Args:
        contours: of the views, each with an outline; made with the cameras.
        cameras: of the views.
        middle, radius: (3,) and of the object, metres, object frame.
    """

    def __init__(
        self, contours: Sequence[Contours], cameras: Sequence[Camera], middle: Array, radius: float
    ) -> None:
        self._middle, self._radius = middle, radius
        rig = Rig.of(cameras)
        self._low, self._cell = middle - _REACH * radius, 2 * _REACH * radius / _GRID
        at = np.indices((_GRID + 1,) * 3).reshape(3, -1).T * self._cell + self._low
        worst = np.full(len(at), -np.inf)
        for k, (own, camera) in enumerate(zip(contours, cameras, strict=True)):
            depth = np.maximum((at - rig.C[k]) @ rig.R[k, 2], 0)
            outside = DistanceImage(own, camera).outside(rig.projected(k, at))
            np.maximum(worst, outside * depth / rig.focal[k], out=worst)
        self._field = worst.reshape((_GRID + 1,) * 3)
        self._slope = np.stack(np.gradient(self._field, self._cell))

    def placed(
        self, contours: Contours, starts: Sequence[Camera], axis: Array | None = None
    ) -> Camera:
        """The pose from which an outline fits the hull best.

        Args:
            contours: of one view.
            starts: poses of its camera to begin from, and about; what the outline does not tell
                is as in the first that fits as well.
            axis: (3,) that the cameras go around; None: the way up in the image is taken.
        """
        uv = contours.uv[:: max(1, len(contours) // _RAYS)]
        straight = undistorted(uv, starts[0])
        d = Rig.of(starts[:1]).rays(straight[None])[0] @ starts[0].R_camera_object.T
        right, best, least = np.array([1.0, 0.0, 0.0]), starts[0], np.inf
        for start in starts:
            up = np.array([0.0, 1.0, 0.0]) if axis is None else start.R_camera_object @ axis
            for tilt in _TILTS:
                for turn in _TURNS:
                    by = Rotation.from_rotvec(tilt * right) * Rotation.from_rotvec(turn * up)
                    there = self._moved(start, np.concatenate([by.as_rotvec(), np.zeros(3)]))
                    camera, misfit = self._descended(there, d, _FIRST)
                    if misfit < _CLEARLY * least - _loss(np.array([_AT_LEAST])):
                        best, least = camera, misfit
        return self._descended(best, d, _LAST)[0]

    def _moved(self, camera: Camera, x: Array) -> Camera:
        return moved(camera, x, self._middle, self._radius)

    def _descended(self, camera: Camera, d: Array, most: int) -> tuple[Camera, float]:
        """From a pose towards the nearest from which rays d (m, 3), camera frame, fit best, and
        their misfit: steps of Gauss and Newton with the weights of a loss that grows like the
        distance."""
        misfit = np.inf
        for _ in range(most):
            miss, J = self._misses(camera, d)
            misfit, w = _loss(miss), 1 / np.sqrt(1 + (miss / _SOFT) ** 2)
            values, ways = np.linalg.eigh(J.T @ (w[:, None] * J))
            seen = values > _SEEN**2 * values[-1]
            along = ways.T @ (J.T @ (w * miss))
            x = -ways @ np.where(seen, along / np.where(seen, values, 1.0), 0.0)
            camera = self._moved(
                camera, x * min(1.0, _FARTHEST / max(float(np.linalg.norm(x)), 1e-12))
            )
        return camera, misfit

    def _misses(self, camera: Camera, d: Array) -> tuple[Array, Array]:
        """(m,) how far rays d (m, 3), camera frame, pass outside of the hull, in radii of the
        object, negative inside; and (m, 6) derivatives of that by x of ``moved``."""
        R, at = camera.R_camera_object, camera.in_camera(self._middle)
        away = float(np.linalg.norm(at))
        reach = min(_REACH * self._radius, 0.9 * away)
        depths = np.linspace(away - reach, away + reach, _DEPTHS)
        from_middle = d[:, None] * depths[:, None] - at
        place = (from_middle @ R + self._middle - self._low) / self._cell
        near = map_coordinates(self._field, place.reshape(-1, 3).T, order=1, mode="nearest")
        near = near.reshape(len(d), -1)
        rows, best = np.arange(len(d)), near.argmin(axis=1)
        there = place[rows, best].T
        normal = np.stack([map_coordinates(s, there, order=1, mode="nearest") for s in self._slope])
        n = normal.T @ R.T
        J = np.column_stack([np.cross(n, from_middle[rows, best]), -n * units(at, self._radius)])
        return near[rows, best] / self._radius, J / self._radius


def _loss(misses: Array) -> float:
    """Mean of a loss that grows like the distance, of (m,) in radii of the object."""
    return float((np.sqrt(1 + (misses / _SOFT) ** 2) - 1).mean())
