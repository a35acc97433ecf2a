"""Poses of other stamps than the images', and of other messages: each image has its own."""

import numpy as np
import pytest
from recordings import FRAMES, later, write_all
from rosbags.typesys import Stores, get_typestore

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.poses import PoseReading
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.errors import UserError

MS = 1_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
POSE = "/camera_pose"


def moved(messages, topic, ns):
    """The messages, of which those of a topic have later stamps."""
    return [later(m, ns) if m.topic == topic else m for m in messages]


def turned(views, truth):
    """Angle of each camera's place around the vertical, against the truth, degrees."""

    def angles(found):
        centres = np.array([camera.centre for camera in found.values()])
        return np.degrees(np.unwrap(np.arctan2(centres[:, 1], centres[:, 0])))

    return angles(views.cameras()) - angles(truth.cameras())


@pytest.mark.parametrize("ns", [50 * MS, -50 * MS, 80 * MS])
def test_poses_that_are_all_late_or_early_lose_no_image(bag, messages, tmp_path, ns):
    views = BagViews(write_all(tmp_path / "bag", moved(messages, POSE, ns)))
    apart = turned(views, BagViews(bag))
    assert len(apart) == FRAMES
    # The camera goes back by 30 degrees in 100 ms, and the circle is not cut short.
    np.testing.assert_allclose(apart, ns / MS * 0.3, atol=1e-4)
    distance = [np.linalg.norm(camera.centre) for camera in views.cameras().values()]
    assert np.ptp(distance) < 1e-9
    (words,) = views.remarks()
    assert f"poses come {abs(ns if ns < 60 * MS else ns - 100 * MS) // MS} ms" in words
    assert "should have its stamp" in words


def test_poses_of_a_lower_rate_than_ten_a_second_serve_too(messages, tmp_path):
    """Images each 100 ms, poses each 300: the usual step says how far apart they may be."""
    slow = [m for k, m in enumerate(messages) if m.topic != POSE or (k // 3) % 3 == 0]
    views = BagViews(write_all(tmp_path / "bag", slow))
    assert len(views.cameras()) == FRAMES
    (words,) = views.remarks()
    assert "8 of 12 images have no pose of their stamp" in words
    assert "poses come" not in words
    told = PoseReading(max_pose_gap_ns=100 * MS)
    few = BagViews(tmp_path / "bag", reading=told)
    assert len(few.cameras()) == 4
    assert "0.3 s apart (--set contour_tracker.max_pose_gap=0.45" in few.remarks()[0]


def test_poses_of_a_higher_rate_are_not_called_late(messages, tmp_path):
    more = [later(m, 60 * MS) for m in messages if m.topic == POSE]
    views = BagViews(write_all(tmp_path / "bag", [*moved(messages, POSE, 10 * MS), *more]))
    assert len(views.cameras()) == FRAMES
    assert "poses come" not in views.remarks()[0]


def test_a_pose_that_is_missing_among_those_of_images_is_not_made_up(messages, tmp_path):
    for gone in (0, 5, FRAMES - 1):
        kept = [m for k, m in enumerate(messages) if m.topic != POSE or k // 3 != gone]
        views = BagViews(write_all(tmp_path / f"bag{gone}", kept))
        assert len(views.cameras()) == FRAMES - 1
        assert "1 have none at all" in views.remarks()[0]


def test_exact_is_exact_and_what_helps_is_said(messages, tmp_path):
    views = BagViews(
        write_all(tmp_path / "bag", moved(messages, POSE, 50 * MS)),
        reading=PoseReading(pose_sync="exact"),
    )
    with pytest.raises(UserError, match=r"contour_tracker\.pose_sync=interpolate"):
        views.remarks()


def test_poses_of_another_clock_are_no_fault_of_masks(messages, tmp_path):
    views = BagViews(write_all(tmp_path / "bag", moved(messages, POSE, 3600 * 10**9)))
    with pytest.raises(UserError, match=r"poses are of 3601.* these of 1.*"):
        views.remarks()


def test_masks_that_have_the_stamp_of_no_image_are_named(messages, tmp_path):
    messages = messages + [m._replace(topic="/mask") for m in messages if m.topic == "/image"]
    views = BagViews(write_all(tmp_path / "bag", moved(messages, "/mask", 7 * MS)))
    with pytest.raises(UserError, match=r"mask has the stamp of no image.* 7 ms later"):
        views.remarks()


def as_covariance(pose):
    both = TYPES["geometry_msgs/msg/PoseWithCovariance"](pose.pose, np.zeros(36))
    return TYPES["geometry_msgs/msg/PoseWithCovarianceStamped"](pose.header, both)


def as_odometry(pose):
    zero = TYPES["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    still = TYPES["geometry_msgs/msg/Twist"](zero, zero)
    twist = TYPES["geometry_msgs/msg/TwistWithCovariance"](still, np.zeros(36))
    both = TYPES["geometry_msgs/msg/PoseWithCovariance"](pose.pose, np.zeros(36))
    return TYPES["nav_msgs/msg/Odometry"](pose.header, "camera", both, twist)


def as_transform(pose):
    p = pose.pose.position
    vector = TYPES["geometry_msgs/msg/Vector3"](p.x, p.y, p.z)
    transform = TYPES["geometry_msgs/msg/Transform"](vector, pose.pose.orientation)
    return TYPES["geometry_msgs/msg/TransformStamped"](pose.header, "camera", transform)


def as_path(pose):
    as_path.poses = [*getattr(as_path, "poses", []), pose]
    return TYPES["nav_msgs/msg/Path"](pose.header, as_path.poses)


@pytest.mark.parametrize("make", [as_covariance, as_odometry, as_transform, as_path])
def test_other_messages_that_hold_a_pose_serve_where_they_are_the_only_ones(
    bag, messages, tmp_path, make
):
    def other(message):
        made = make(STORE.deserialize_cdr(message.cdr, message.msgtype))
        kind = type(made).__msgtype__
        cdr = bytes(STORE.serialize_cdr(made, kind))
        return message._replace(topic="/tracking", msgtype=kind, cdr=cdr)

    found = [other(m) if m.topic == POSE else m for m in messages]
    views, same = BagViews(write_all(tmp_path / "bag", found)), BagViews(bag)
    assert views.remarks() == ["/tracking is taken for /camera_pose"]
    assert views.object_frame() == same.object_frame()
    for camera, wanted in zip(views.cameras().values(), same.cameras().values(), strict=True):
        np.testing.assert_allclose(camera.centre, wanted.centre, atol=1e-12)
        np.testing.assert_allclose(camera.R_camera_object, wanted.R_camera_object, atol=1e-12)
    stamps = [header_stamp_ns(m.cdr) for m in views.messages() if m.topic == POSE]
    assert stamps == [header_stamp_ns(m.cdr) for m in messages if m.topic == POSE]
