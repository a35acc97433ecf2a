"""The tracker with pose_source: tf.

pip has no wheels of tf2_msgs, so the messages are handed to the node and not sent.
"""

import pytest
from rig import SECOND, Rig, handed_over, views

from msg_adapters import decode_contours
from msg_adapters.transforms import encode_transform
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode


def test_without_tf2_msgs_the_node_says_what_to_do(ros) -> None:
    with pytest.raises(SettingsError, match="tf2_msgs"):
        ros.start(ContourTrackerNode, params={"pose_source": "tf"})


def test_a_node_that_does_not_start_leaves_nothing_in_the_graph(ros) -> None:
    with pytest.raises(SettingsError):
        ros.start(ContourTrackerNode, params={"pose_source": "tf"})
    rig = ros.start(Rig)
    ros.start(ContourTrackerNode, params={"pose_source": "topic"})
    ros.spin_until(lambda: rig.count_publishers("contours"), what="the one that started")
    settle(ros)
    assert rig.count_subscribers("image") == rig.count_publishers("contours") == 1


@pytest.fixture
def started(ros, transforms):
    node = ros.start(ContourTrackerNode, params={"pose_source": "tf", "max_pose_gap": 0.5})
    rig = ros.start(Rig)
    ros.spin_until(
        lambda: (
            rig.image.get_subscription_count()
            and rig.info.get_subscription_count()
            and rig.count_publishers("contours")
        ),
        what="the tracker",
    )
    return ros, node, rig


def place(node, view, stamp_ns, child="camera", parent="turntable"):
    transform = encode_transform(view[0].pose, stamp_ns, parent, child)
    handed_over(node, transform)


def settle(ros):
    for _ in range(30):
        ros.executor.spin_once(timeout_sec=0.005)


def test_an_image_waits_for_the_transforms_on_both_sides_of_it(started) -> None:
    ros, node, rig = started
    place(node, views()[0], 10 * SECOND)
    rig.send(views()[0], 10 * SECOND + SECOND // 5, parts=("info", "image"))
    settle(ros)
    assert not rig.got["contours"]
    place(node, views()[1], 10 * SECOND + 2 * SECOND // 5)
    ros.spin_until(lambda: rig.got["contours"], what="contours")
    found = decode_contours(rig.got["contours"][0]).centre
    between = views()[0][0].pose.towards(views()[1][0].pose, 0.5)
    assert found == pytest.approx(between.centre, abs=1e-6)
    assert not node.drops


BAD = {
    "tf_gap": (10.0, 11.0, "camera", "max_pose_gap"),
    "tf_early": (10.6, 10.7, "camera", "not known yet"),
    "tf_unconnected": (10.4, 10.6, "elsewhere", "'camera'"),
}


@pytest.mark.slow
@pytest.mark.parametrize("reason", BAD)
def test_an_image_without_a_pose_is_dropped_by_name(started, reason) -> None:
    ros, node, rig = started
    before, after, child, words = BAD[reason]
    for view, at in zip(views(), (before, after), strict=False):
        place(node, view, int(at * SECOND), child)
    rig.send(views()[0], 10 * SECOND + SECOND // 2, parts=("info", "image"))
    settle(ros)
    for k in range(node.settings.sync_queue):  # until it has waited long enough
        rig.send(views()[0], (30 + k) * SECOND, parts=("info", "image"))
        settle(ros)
    assert node.drops == {reason: 1}
    ros.spin_until(
        lambda: any(words in report.message for report in rig.reports.values()),
        what="words in the diagnostics",
    )


def test_garbage_in_tf_is_counted(started) -> None:
    ros, node, rig = started
    bad = encode_transform(views()[0][0].pose, 0, "turntable", "camera")
    bad.transform.rotation.w = float("nan")
    own = encode_transform(views()[0][0].pose, 0, "camera", "camera")
    late = encode_transform(views()[0][0].pose, 0, "turntable", "camera")
    late.header.stamp.sec = -4
    for transform in (bad, own, late):
        handed_over(node, transform)
    assert node.drops["bad_tf"] == 3
    for at in (10.0, 10.2):
        place(node, views()[0], int(at * SECOND))
    rig.send(views()[0], 10 * SECOND, parts=("info", "image"))
    ros.spin_until(lambda: rig.got["contours"], what="contours")


def test_frames_in_a_circle_stop_nothing(started) -> None:
    ros, node, rig = started
    for parent, child in (("a", "camera"), ("b", "a"), ("camera", "b")):
        place(node, views()[0], 10 * SECOND, child, parent)
    rig.send(views()[0], 10 * SECOND, parts=("info", "image"))
    settle(ros)
    for at in (20.0, 20.2):
        place(node, views()[1], int(at * SECOND))
    rig.send(views()[1], 20 * SECOND, parts=("info", "image"))
    ros.spin_until(lambda: rig.got["contours"], what="contours")
