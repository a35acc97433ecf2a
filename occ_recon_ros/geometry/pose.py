"""The place of a camera in the object frame, and between two of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Array

_TINY = 1e-4  # rad: below it the next term of the series is nothing


@dataclass(frozen=True)
class CameraPose:
    """Pose of the camera optical frame in the object frame.

    Attributes:
        R_object_camera: (3, 3) float64, rotation camera optical frame -> object.
        centre: (3,) float64, camera centre C, metres.
    """

    R_object_camera: Array
    centre: Array

    @property
    def inverse(self) -> CameraPose:
        """Of the object frame in the camera's."""
        return CameraPose(self.R_object_camera.T, -self.R_object_camera.T @ self.centre)

    def __matmul__(self, inner: CameraPose) -> CameraPose:
        """The pose of what is at ``inner`` in the frame that is at this one."""
        R = self.R_object_camera
        return CameraPose(R @ inner.R_object_camera, R @ inner.centre + self.centre)

    def towards(self, other: CameraPose, fraction: float) -> CameraPose:
        """The pose a fraction (0 to 1) of the way to another, as one steady screw: a turn about
        the axis that the two poses define, and a shift along it; without a turn, straight."""
        from scipy.spatial.transform import Rotation  # half a second to import

        turn = Rotation.from_matrix(self.R_object_camera.T @ other.R_object_camera).as_rotvec()
        way = self.R_object_camera.T @ (other.centre - self.centre)
        velocity, part = np.linalg.solve(_mean_rotation(turn), way), fraction * turn
        shift = fraction * _mean_rotation(part) @ velocity
        return self @ CameraPose(Rotation.from_rotvec(part).as_matrix(), shift)


def _mean_rotation(turn: Array) -> Array:
    """(3, 3) the mean of all rotations on the way to that of a rotation vector, (3,) radians: a
    velocity that turns along moves a point by that of it."""
    angle = float(np.linalg.norm(turn))
    K = np.cross(np.eye(3), turn)  # [turn]x
    if angle < _TINY:
        return np.eye(3) + K / 2
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * K + second * K @ K


ORIGIN = CameraPose(np.eye(3), np.zeros(3))
"""Where the place of a camera is not asked."""
