"""turntable_pose: angles of a joint and a calibrated axis in, poses of the camera out."""

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from msg_adapters import Level, decode_pose, decode_stamp
from msg_adapters.joint import decode_joint
from msg_adapters.pose import encode_camera_pose
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.poses.axis import read_turntable
from occ_recon_ros.poses.encoder_watch import EncoderWatch
from occ_recon_ros.poses.joint_watch import JointWatch

from .base import Dropped, PipelineNode
from .main import run_node
from .qos import reliable
from .settings import TurntablePoseSettings

_REMEMBERED = 300  # angles, for poses that come later


class TurntablePoseNode(PipelineNode[TurntablePoseSettings]):
    """The camera in the object's frame, as a table with an encoder turns the object.

    Where board_camera_pose tells what a camera sees of a board on the table, the two are
    compared: an encoder that slips or runs the other way is told of in /diagnostics.

    Raises:
        SettingsError: the file of the axis is not there, or is none.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("turntable_pose", TurntablePoseSettings, **kwargs)
        try:
            self.table = read_turntable(Path(self.settings.axis).expanduser())
        except ValueError as error:
            raise SettingsError(f"axis: {error}") from None
        self._watch = EncoderWatch(self.table)
        self._angles: dict[int, float] = {}
        self._joint = JointWatch()
        self._apart: float | None = None
        self.advertise(PoseStamped, "camera_pose", reliable(100))
        # Best effort takes what is sent either way.
        any_way = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.subscribe(JointState, "joint_states", self._on_joint, any_way)
        self.subscribe(PoseStamped, "board_camera_pose", self._on_seen, any_way)
        self.offer("~/reset", self._on_reset)
        self.warn_of_unknown_parameters()

    def _on_joint(self, msg: JointState) -> None:
        stamp = decode_stamp(msg.header.stamp)
        if not stamp:
            raise Dropped(
                "no_stamp", "the stamps of joint_states are 0: what sends them must set it"
            )
        angle = decode_joint(msg, self.settings.joint or self.table.joint)
        if jump := self._joint.add(stamp, angle, self.settings.max_speed):
            raise Dropped("joint_jumped", jump)
        assert self._joint.angle is not None
        angle = self._joint.angle
        self._angles[stamp] = angle
        while len(self._angles) > _REMEMBERED:
            del self._angles[next(iter(self._angles))]
        pose = self.table.camera_at(angle)
        self.send("camera_pose", encode_camera_pose(pose, stamp, self.settings.object_frame))
        self.measure_latency(stamp)

    def _on_seen(self, msg: PoseStamped) -> None:
        """What the camera saw; compared with the angle of that time."""
        stamp = decode_stamp(msg.header.stamp)
        if msg.header.frame_id != self.settings.object_frame:
            raise Dropped("pose_frame", f"board_camera_pose is in frame '{msg.header.frame_id}'")
        pose = decode_pose(msg)
        stamps = np.array(sorted(self._angles))
        if not len(stamps) or not stamps[0] <= stamp <= stamps[-1]:
            raise Dropped("no_joint_state", f"no joint_states around {stamp * 1e-9:.3f} s")
        angles = [self._angles[int(s)] for s in stamps]
        angle = float(
            np.interp(float(stamp - stamps[0]), (stamps - stamps[0]).astype(float), angles)
        )
        self._apart = self._watch.add(angle, pose)

    def _on_reset(self) -> str:
        self._watch = EncoderWatch(self.table)
        self._angles.clear()
        self._joint = JointWatch()
        self._apart = None
        return "ready for a new scan"

    def problems(self, counts: Counter[str]) -> Iterator[tuple[Level, str]]:
        """What keeps poses from coming, or makes them wrong."""
        if not counts["joint_states"]:
            yield Level.WARN, f"no angles on {self.publishers_text('joint_states')}"
        if doubt := self._joint.doubt():
            yield Level.WARN, doubt
        found = self._watch.diagnosis(np.deg2rad(self.settings.slip_tolerance))
        if found is not None:
            yield Level.ERROR, f"{found[0]}: {found[1]}"

    def figures(self) -> dict[str, Any]:
        """Where the joint is, and how far from what is seen."""
        values: dict[str, Any] = {}
        if self._joint.angle is not None:
            values["joint angle deg"] = round(float(np.rad2deg(self._joint.angle)), 2)
            values["turned deg"] = round(float(np.rad2deg(self._joint.turned)), 1)
            sense = np.sign(self.table.ratio * self._joint.turned)
            values["sense of turn"] = {1: "forwards", -1: "backwards"}.get(int(sense), "stands")
        if self._apart is not None:
            values["board minus encoder deg"] = round(float(np.rad2deg(self._apart)), 2)
        return values


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(TurntablePoseNode)


if __name__ == "__main__":
    sys.exit(main())
