"""The angle of one joint in a JointState."""

import math
from typing import Any

from occ_recon_ros.geometry.refusal import Refusal


class BadJoint(Refusal):
    """A JointState that does not tell the angle: no_joint, bad_joint_states or bad_angle."""


def decode_joint(msg: Any, joint: str) -> float:
    """Angle of a joint, radians.

    Args:
        msg: sensor_msgs/JointState, rclpy's or that of a bag.
        joint: its name; empty: the only one there is.

    Raises:
        BadJoint: it is not among the joints, has no position, or one that is not finite.
    """
    names = list(msg.name)
    if len(msg.position) != len(names):
        raise BadJoint("bad_joint_states", f"{len(names)} joints but {len(msg.position)} positions")
    if joint and joint not in names:
        raise BadJoint("no_joint", f"joint '{joint}' is not among {', '.join(names) or 'none'}")
    if not joint and len(names) != 1:
        raise BadJoint(
            "no_joint", f"which of {', '.join(names) or 'no joints'}? Set the parameter joint"
        )
    angle = float(msg.position[names.index(joint) if joint else 0])
    if not math.isfinite(angle) or abs(angle) > 1e6:
        raise BadJoint("bad_angle", f"the angle of joint '{names[0]}' is {angle}")
    return angle
