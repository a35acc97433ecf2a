"""The place of a camera in the object frame, and between two of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Array


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
        """The pose a fraction (0 to 1) of the way to another: position linear, rotation
        at constant speed about one axis (slerp)."""
        from scipy.spatial.transform import (
            Rotation,  # here: half a second that no import should take
        )

        turn = Rotation.from_matrix(self.R_object_camera.T @ other.R_object_camera)
        part = Rotation.from_rotvec(fraction * turn.as_rotvec()).as_matrix()
        return CameraPose(
            self.R_object_camera @ part,
            self.centre + fraction * (other.centre - self.centre),
        )


ORIGIN = CameraPose(np.eye(3), np.zeros(3))
"""Where the place of a camera is not asked."""
