"""Projection of points with its derivatives by the pose."""

import numpy as np
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose

_STEP = 1e-6


def moved(pose: CameraPose, change: Array) -> CameraPose:
    """A pose changed by (6,): centre in metres, then a turn in radians, both in the axes of the
    object frame (the order of PoseWithCovariance)."""
    turn = Rotation.from_rotvec(change[3:]).as_matrix()
    return CameraPose(turn @ pose.R_object_camera, pose.centre + change[:3])


def difference(pose: CameraPose, base: CameraPose) -> Array:
    """(6,) the change that takes ``base`` to ``pose``."""
    turn = Rotation.from_matrix(pose.R_object_camera @ base.R_object_camera.T).as_rotvec()
    return np.concatenate([pose.centre - base.centre, turn])


def pixel_jacobian(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Pixels of points and their derivatives by the pose, as ``moved`` counts it.

    Args:
        camera: the view, distortion included.
        points: (n, 3) float64, object frame, metres, in front of the camera.

    Returns:
        (n, 2) pixels and (n, 2, 6) derivatives.
    """
    R = camera.R_camera_object
    X = camera.in_camera(points)
    x, y, z = X[:, 0] / X[:, 2], X[:, 1] / X[:, 2], X[:, 2]
    K = camera.K[:2, :2]
    here = np.column_stack(camera._distort(x, y))
    by_x = (np.column_stack(camera._distort(x + _STEP, y)) - here) / _STEP
    by_y = (np.column_stack(camera._distort(x, y + _STEP)) - here) / _STEP
    # d(x, y) / dX
    n = len(points)
    perspective = np.zeros((n, 2, 3))
    perspective[:, 0, 0] = perspective[:, 1, 1] = 1 / z
    perspective[:, 0, 2], perspective[:, 1, 2] = -x / z, -y / z
    image = np.stack([by_x, by_y], axis=2)
    # X = R exp(-turn) (P - C - step): dX/dstep = -R, dX/dturn = R [P - C]x.
    arms = points - camera.centre
    motion = np.empty((n, 3, 6))
    motion[:, :, :3] = -R
    motion[:, :, 3:] = R @ np.cross(np.eye(3), arms[:, None])
    uv = here @ K.T + camera.K[:2, 2]
    return uv, K @ image @ perspective @ motion
