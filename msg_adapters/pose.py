"""PoseStamped and the camera's place in the object frame."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
)
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.pose import CameraPose

from .header import encode_header

_QUATERNION_TOLERANCE = 1e-2
_FARTHEST_M = 1e6  # clouds hold float32, which tell a decimetre there

POSE = "geometry_msgs/msg/PoseStamped"
PATH = "nav_msgs/msg/Path"
_POSES: Mapping[str, Callable[[Any], list[PoseStamped]]] = {
    POSE: lambda msg: [msg],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda msg: [_stamped(msg, msg.pose.pose)],
    "nav_msgs/msg/Odometry": lambda msg: [_stamped(msg, msg.pose.pose)],
    "geometry_msgs/msg/TransformStamped": lambda msg: [_stamped(msg, _moved(msg.transform))],
    PATH: lambda msg: list(msg.poses),
}
POSE_TYPES = tuple(_POSES)
"""Types of messages that tell where the camera is in the object frame."""

NEARER = (
    "subtract an offset from the positions of all cameras, or correct their unit (unit_in_metres "
    "of cameras.json)"
)
"""What to do where an object is too far away."""


def decode_pose(msg: PoseStamped) -> CameraPose:
    """Pose of the camera optical frame in the object frame.

    Raises:
        ValueError: not finite, the camera out of all measure away, or the quaternion not of
            unit length.
    """
    p, q = msg.pose.position, msg.pose.orientation
    return checked_pose(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))


def poses_of(msg: Any, msgtype: str) -> list[PoseStamped]:
    """What a message of one of ``POSE_TYPES`` tells of where the camera is."""
    return _POSES[msgtype](msg)


def _stamped(msg: Any, pose: Pose) -> PoseStamped:
    return PoseStamped(header=msg.header, pose=pose)


def _moved(transform: Any) -> Pose:
    """The pose that a Transform brings the origin to."""
    t = transform.translation
    return Pose(position=Point(x=t.x, y=t.y, z=t.z), orientation=transform.rotation)


def checked_pose(centre: np.ndarray, quaternion: np.ndarray) -> CameraPose:
    """A pose of (3,) metres and (4,) x y z w.

    Raises:
        ValueError: as ``decode_pose``.
    """
    if not (np.isfinite(centre).all() and np.isfinite(quaternion).all()):
        raise ValueError("the pose is not finite")
    if np.abs(centre).max() > _FARTHEST_M:
        far = f"{np.abs(centre).max():.3g} m from the origin of the object frame"
        raise ValueError(f"the camera is {far}: {NEARER}")
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > _QUATERNION_TOLERANCE:
        raise ValueError(f"the quaternion must have length 1, got {length:.3g}")
    return CameraPose(Rotation.from_quat(quaternion).as_matrix(), centre)


def encode_pose(camera: Camera, stamp_ns: int, frame_id: str) -> PoseStamped:
    """Pose of a camera in the object frame ``frame_id``."""
    return encode_camera_pose(camera.pose, stamp_ns, frame_id)


def encode_camera_pose(pose: CameraPose, stamp_ns: int, frame_id: str) -> PoseStamped:
    """A pose of the camera optical frame in the object frame ``frame_id``."""
    return PoseStamped(header=encode_header(stamp_ns, frame_id), pose=_pose(pose))


def _pose(pose: CameraPose) -> Pose:
    x, y, z = pose.centre
    qx, qy, qz, qw = Rotation.from_matrix(pose.R_object_camera).as_quat()
    return Pose(
        position=Point(x=float(x), y=float(y), z=float(z)),
        orientation=Quaternion(x=float(qx), y=float(qy), z=float(qz), w=float(qw)),
    )


def encode_pose_covariance(
    pose: CameraPose, covariance: np.ndarray, stamp_ns: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """A pose and its (6, 6) covariance of x, y, z and turns about them, in ``frame_id``."""
    return PoseWithCovarianceStamped(
        header=encode_header(stamp_ns, frame_id),
        pose=PoseWithCovariance(
            pose=_pose(pose), covariance=np.array(covariance, np.float64).ravel()
        ),
    )


def decode_pose_covariance(msg: PoseWithCovarianceStamped) -> np.ndarray:
    """(6, 6) float64 covariance of x, y, z and turns about them, in the axes of its frame.

    Raises:
        ValueError: not finite, or not a covariance (a negative variance).
    """
    covariance = np.array(msg.pose.covariance, np.float64).reshape(6, 6)
    if not np.isfinite(covariance).all():
        raise ValueError("the covariance is not finite")
    covariance = (covariance + covariance.T) / 2
    values = np.linalg.eigvalsh(covariance)
    if values[0] < -1e-9 * max(values[-1], 1e-300):
        raise ValueError("the covariance is not positive")
    return covariance
