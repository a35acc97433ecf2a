"""The place of a camera in the object frame, and between two of them."""

from __future__ import annotations

from dataclasses import dataclass

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
