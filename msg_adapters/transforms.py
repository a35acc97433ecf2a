"""tf2_msgs/TFMessage, of rclpy where that is installed, or of a bag."""

from typing import Any

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from geometry_msgs.msg import Transform as TransformMessage
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses.transforms import Transform

from .header import decode_stamp, encode_header
from .pose import checked_pose


def decode_transforms(msg: Any) -> list[Transform]:
    """All transforms of a TFMessage.

    Raises:
        ValueError: one with a bad stamp, not finite, or with a quaternion not of unit length.
    """
    found = []
    for item in msg.transforms:
        stamp_ns = decode_stamp(item.header.stamp)
        p, q = item.transform.translation, item.transform.rotation
        pose = checked_pose(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))
        found.append(Transform(str(item.header.frame_id), str(item.child_frame_id), stamp_ns, pose))
    return found


def encode_transform(pose: CameraPose, stamp_ns: int, parent: str, child: str) -> TransformStamped:
    """The pose of a frame in its parent; a TFMessage holds a list of them."""
    x, y, z = (float(value) for value in pose.centre)
    qx, qy, qz, qw = (float(v) for v in Rotation.from_matrix(pose.R_object_camera).as_quat())
    return TransformStamped(
        header=encode_header(stamp_ns, parent),
        child_frame_id=child,
        transform=TransformMessage(
            translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw)
        ),
    )
