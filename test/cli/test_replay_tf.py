"""A recording that holds /tf in place of poses, and what is wrong with some."""

import numpy as np
import pytest
from recordings import write_all
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.poses import PoseReading
from occ_recon_ros.bags.views import BagViews

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
TF = "tf2_msgs/msg/TFMessage"


def transform(R, t, sec, nanosec, parent, child):
    q, t = Rotation.from_matrix(R).as_quat(), np.asarray(t, float)
    header = TYPES["std_msgs/msg/Header"](
        TYPES["builtin_interfaces/msg/Time"](sec, nanosec), parent
    )
    where = TYPES["geometry_msgs/msg/Transform"](
        TYPES["geometry_msgs/msg/Vector3"](*t), TYPES["geometry_msgs/msg/Quaternion"](*q)
    )
    stamped = TYPES["geometry_msgs/msg/TransformStamped"](header, child, where)
    return bytes(STORE.serialize_cdr(TYPES[TF]([stamped]), TF))


ARM = Rotation.from_euler("xyz", [0.4, -0.3, 1.0]).as_matrix(), np.array([0.2, -0.1, 0.3])


def with_tf(messages, optical="camera_optical_frame", skip=lambda k: False):
    """The messages with the poses as transforms: the table in the world, the camera on an arm
    that stands; the table's come half a step off the images' stamps."""
    kept = [m for m in messages if m.topic != "/camera_pose"]
    poses = [m for m in messages if m.topic == "/camera_pose"]
    R_arm, t_arm = ARM
    first = poses[0]
    arm = transform(R_arm, t_arm, 0, 0, "world", optical)
    found = [first._replace(topic="/tf_static", msgtype=TF, cdr=arm)]
    for k, message in enumerate(poses):
        decoded = STORE.deserialize_cdr(message.cdr, message.msgtype)
        p, q, stamp = decoded.pose.position, decoded.pose.orientation, decoded.header.stamp
        R = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        # Of the table in the world: arm . (camera in table)^-1
        R_table = R_arm @ R.T
        t_table = t_arm - R_table @ [p.x, p.y, p.z]
        if not skip(k):
            cdr = transform(R_table, t_table, stamp.sec, stamp.nanosec, "world", "turntable")
            found.append(message._replace(topic="/tf", msgtype=TF, cdr=cdr))
    return sorted([*kept, *found], key=lambda m: m.time_ns)


def rims(path):
    head, _, body = (path / "rims.ply").read_bytes().partition(b"end_header\n")
    return head, np.frombuffer(body, np.float32).reshape(-1, 8)


def test_the_same_rims_come_of_tf_as_of_poses(replay, messages, expected, tmp_path) -> None:
    bag = write_all(tmp_path / "tf", with_tf(messages))
    code, _, err = replay(bag, tmp_path / "out")
    assert code in (0, 3), err
    head, found = rims(tmp_path / "out")
    (tmp_path / "rims.ply").write_bytes(expected)
    wanted_head, wanted = rims(tmp_path)
    assert head == wanted_head
    np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=2e-5)


def test_the_object_frame_that_is_named_is_that_of_all_nodes(replay, messages, tmp_path) -> None:
    plate = [
        m._replace(cdr=m.cdr.replace(b"turntable\0", b"plattform\0")) for m in with_tf(messages)
    ]
    bag = write_all(tmp_path / "tf", plate)
    name = "--set=contour_tracker.object_frame=plattform"
    code, out, err = replay(bag, tmp_path / "out", name)
    assert code in (0, 3), err
    assert "12 contours" in out


def test_the_widest_gap_between_transforms_is_that_of_the_tracker(messages, tmp_path) -> None:
    few = with_tf(messages, skip=lambda k: k % 2 and k < 11)
    bag = write_all(tmp_path / "tf", few)
    assert len(BagViews(bag).cameras()) == 7
    reading = PoseReading(max_pose_gap_ns=250_000_000)
    assert len(BagViews(bag, reading=reading).cameras()) == 12


def test_an_image_without_transforms_around_it_is_dropped_by_name(
    replay, messages, tmp_path
) -> None:
    bag = write_all(tmp_path / "tf", with_tf(messages, skip=lambda k: k == 5))
    code, out, err = replay(bag, tmp_path / "out")
    assert code in (0, 3), err
    assert "no_camera_pose" in out


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: with_tf(m, optical="other"), "'camera_optical_frame'"),
        (lambda m: [x for x in with_tf(m) if x.topic != "/tf"], "'turntable'"),
    ],
    ids=["frame of the image unknown", "frame of the object unknown"],
)
def test_frames_that_do_not_meet_are_named(replay, messages, tmp_path, make, words) -> None:
    bag = write_all(tmp_path / "tf", make(messages))
    code, _, err = replay(bag, tmp_path / "out")
    assert code == 2
    assert words in err
    assert "object_frame" in err
    assert err.count("\n") == 1
