"""turntable_pose over its real topics: angles in, poses out, and an encoder that lies."""

from collections import Counter

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rig import SECOND, Rig
from scenes import looking_at
from sensor_msgs.msg import JointState

from msg_adapters import Level, decode_pose
from msg_adapters.header import encode_header
from msg_adapters.pose import encode_camera_pose
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.poses.axis import Turntable, turntable_to_yaml
from occ_recon_ros.poses.projection import difference

TILT = np.deg2rad(20)
AXIS = np.array([np.sin(TILT), 0.0, np.cos(TILT)])
POINT = np.array([0.01, -0.02, 0.005])
TABLE = Turntable(
    POINT - (POINT @ AXIS) * AXIS,
    AXIS,
    looking_at(np.array([0.5, 0.1, 0.3]), np.zeros(3), focal_px=600, size=(640, 480)).pose,
    ratio=-1.0,
    joint="table",
)


class EncoderRig(Rig):
    """Sends angles, and poses that a board would give."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.joints = self.create_publisher(JointState, "joint_states", 100)
        self.seen = self.create_publisher(PoseStamped, "board_camera_pose", 100)
        self.poses = {}
        self.create_subscription(PoseStamped, "camera_pose", self._on_pose, 100)

    def _on_pose(self, msg):
        self.poses[msg.header.stamp.sec] = decode_pose(msg)

    def turn(self, second, angle, names=("table",), positions=None):
        self.joints.publish(
            JointState(
                header=encode_header(second * SECOND, ""),
                name=list(names),
                position=[float(angle)] if positions is None else positions,
            )
        )


@pytest.fixture
def axis(tmp_path):
    path = tmp_path / "axis.yaml"
    path.write_text(turntable_to_yaml(TABLE))
    return str(path)


@pytest.fixture
def started(ros, axis):
    node = ros.start(TurntablePoseNode, params={"axis": axis})
    rig = ros.start(EncoderRig)
    ros.spin_until(
        lambda: rig.joints.get_subscription_count() and rig.seen.get_subscription_count(),
        what="the node",
    )
    return ros, node, rig


def test_the_camera_goes_around_the_axis_the_other_way_than_the_table(started) -> None:
    ros, node, rig = started
    for second, angle in ((10, 0.0), (11, 0.4), (12, np.pi)):
        rig.turn(second, angle)
        ros.spin_until(lambda s=second: s in rig.poses, what="a pose")
    assert difference(rig.poses[10], TABLE.camera_at_zero) == pytest.approx(np.zeros(6), abs=1e-9)
    # A point that the table carries by +phi about the axis stays where the camera sees it.
    X = np.array([0.03, 0.05, 0.1])
    phi = TABLE.ratio * 0.4
    K = np.cross(np.eye(3), AXIS)
    R = np.eye(3) + np.sin(phi) * K + (1 - np.cos(phi)) * K @ K
    carried = TABLE.point + R @ (X - TABLE.point)
    in_camera = TABLE.camera_at_zero.R_object_camera.T @ (carried - TABLE.camera_at_zero.centre)
    later = rig.poses[11]
    assert later.R_object_camera.T @ (X - later.centre) == pytest.approx(in_camera, abs=1e-9)
    assert not node.drops


HOSTILE = {
    "bad_angle": {"angle": float("nan")},
    "no_joint": {"angle": 0.3, "names": ("other",)},
    "no_stamp": {"angle": 0.3, "second": 0},
    "bad_joint_states": {"angle": 0.3, "positions": []},
    "joint_jumped": {"angle": 300.0},
    "bad_joint_states (negative stamp)": {"angle": 0.3, "second": -5},
}


@pytest.mark.parametrize("reason", HOSTILE)
def test_what_tells_no_angle_is_a_named_drop(started, reason) -> None:
    ros, node, rig = started
    rig.turn(10, 0.0)
    ros.spin_until(lambda: 10 in rig.poses, what="a pose")
    arguments = {"second": 11} | HOSTILE[reason]
    if arguments["second"] < 0:
        message = JointState(name=["table"], position=[0.3])
        message.header.stamp.sec = -5
        rig.joints.publish(message)
    else:
        rig.turn(**arguments)
    ros.spin_until(lambda: node.drops.total(), what="a drop")
    assert dict(node.drops) == {reason.split(" ")[0]: 1}
    rig.turn(200, 0.1)
    ros.spin_until(lambda: 200 in rig.poses, what="the next pose")


LIES = {
    "encoder_reversed": lambda angle: -angle,
    "encoder_slips": lambda angle: angle + np.deg2rad(4) * (angle > 0.5),
    "encoder_stands": lambda angle: 0.0,
    "encoder_ratio": lambda angle: 0.5 * angle,
    "encoder_zero": lambda angle: angle + np.deg2rad(30),
}


@pytest.mark.parametrize("name", LIES)
def test_an_encoder_that_lies_is_told_of_where_a_board_is_seen(started, name) -> None:
    ros, _, rig = started
    for k in range(9):
        angle, second = 0.15 * k, 10 + k
        rig.turn(second, LIES[name](angle))
        ros.spin_until(lambda s=second: s in rig.poses, what="a pose")
        truth = TABLE.camera_at(angle)
        rig.seen.publish(encode_camera_pose(truth, second * SECOND, "turntable"))
    ros.spin_until(
        lambda: "/turntable_pose" in rig.reports and name in rig.reports["/turntable_pose"].message,
        what="words in the diagnostics",
    )


def test_an_encoder_that_is_right_is_not_blamed(started) -> None:
    ros, node, rig = started
    for k in range(9):
        rig.turn(10 + k, 0.15 * k)
        ros.spin_until(lambda s=10 + k: s in rig.poses, what="a pose")
        truth = TABLE.camera_at(0.15 * k + 0.002 * (-1) ** k)
        rig.seen.publish(encode_camera_pose(truth, (10 + k) * SECOND, "turntable"))
    rig.reports.clear()
    ros.spin_until(lambda: "/turntable_pose" in rig.reports, what="a report")
    assert "encoder" not in rig.reports["/turntable_pose"].message
    told = node.figures()
    assert told["sense of turn"] == "backwards"
    assert told["joint angle deg"] == pytest.approx(np.rad2deg(1.2), abs=0.01)
    assert told["turned deg"] == pytest.approx(np.rad2deg(1.2), abs=0.1)
    assert abs(told["board minus encoder deg"]) < 0.2


@pytest.mark.parametrize("sense", [1, -1])
def test_a_joint_that_begins_anew_at_half_a_turn_does_not_jump(started, sense) -> None:
    ros, node, rig = started
    for k in range(14):
        angle = sense * 0.5 * k
        rig.turn(10 + k, (angle + np.pi) % (2 * np.pi) - np.pi)
        ros.spin_until(lambda s=10 + k: s in rig.poses, what="a pose")
        apart = difference(rig.poses[10 + k], TABLE.camera_at(angle))
        assert apart == pytest.approx(np.zeros(6), abs=1e-9)
    assert not node.drops
    assert node.figures()["turned deg"] == pytest.approx(np.rad2deg(sense * 6.5), abs=0.1)
    assert not list(node.problems(Counter(joint_states=1)))


DEGREES = {  # at 6 degrees a second, and faster than max_speed
    "makes 57 turns a minute": 2.0,
    "jumps with each message": 0.05,
    "goes from 0 to 100 in even steps": 20.0,
}


@pytest.mark.parametrize("words", DEGREES)
def test_angles_in_degrees_are_a_doubt(started, words) -> None:
    ros, node, rig = started
    step = 10.0 if "even" in words else 12.0
    for k in range(11):
        stamp = int((10 + DEGREES[words] * k) * SECOND)
        rig.joints.publish(
            JointState(header=encode_header(stamp, ""), name=["table"], position=[step * k])
        )
    ros.spin_until(lambda: node._joint._new == 11, what="the angles")
    (problem,) = node.problems(Counter(joint_states=1))
    assert problem[0] == Level.WARN
    assert f"the joint {words}: are its angles degrees?" in problem[1]
    assert not list(node.problems(Counter(joint_states=1)))  # nothing has come since
    rig.turn(3000, 0.0)
    rig.turn(3001, 0.1)
    ros.spin_until(lambda: 3001 in rig.poses, what="a pose")
    told = [text for _, text in node.problems(Counter(joint_states=1))]
    assert "jumps" not in str(told)


def test_a_table_that_goes_on_turning_is_in_no_doubt(started) -> None:
    ros, node, rig = started
    for k in range(40):
        rig.turn(10 + k, 0.6 * k)
    ros.spin_until(lambda: len(node._joint._came) == 40, what="the angles")
    assert not list(node.problems(Counter(joint_states=1)))


def test_without_its_axis_the_node_says_how_to_make_one(ros, tmp_path) -> None:
    with pytest.raises(SettingsError, match="calibrate axis"):
        ros.start(TurntablePoseNode, params={"axis": str(tmp_path / "none.yaml")})


@pytest.mark.slow
def test_as_a_program_of_its_own(ros, axis) -> None:
    ros.program("-m", "occ_recon_ros.nodes.turntable_pose", "--ros-args", "-p", f"axis:={axis}")
    rig = ros.start(EncoderRig)
    ros.spin_until(rig.joints.get_subscription_count, timeout=180, what="the program")
    for second in range(10, 30):
        rig.turn(second, 0.1)
        try:
            ros.spin_until(lambda: rig.poses, timeout=2)
            break
        except AssertionError:
            continue
    assert rig.poses
