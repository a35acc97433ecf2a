"""A camera_info that is sent once, before or among the images, or with other stamps than theirs."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rig import SECOND, Rig, told, views
from sensor_msgs.msg import CameraInfo

from msg_adapters import encode_camera_info
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.poses import BoardSpec, board_to_yaml

STEP = SECOND // 10


class LatchingRig(Rig):
    """Says once what its camera is like, for whoever comes later."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.destroy_publisher(self.info)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.info = self.create_publisher(CameraInfo, "camera_info", kept)
        self.info.publish(encode_camera_info(views()[0][0], 0, "camera"))


def connected(ros, rig, *ends):
    ros.spin_until(lambda: all(end.get_subscription_count() for end in ends), what="ends")


@pytest.mark.parametrize("stamp", [0, SECOND, 10 * SECOND, 10 * SECOND + 1000])
def test_one_message_serves_all_images(ros, stamp):
    node, rig = ros.start(ContourTrackerNode), ros.start(Rig)
    connected(ros, rig, rig.image, rig.info, rig.pose)
    rig.info.publish(encode_camera_info(views()[0][0], stamp, "camera"))
    ros.spin_until(lambda: node._pairing._info is not None, what="camera_info")
    for k in range(5):
        rig.send(views()[k], 10 * SECOND + k * STEP, parts=("pose", "image"))
    ros.spin_until(lambda: len(rig.stamps("contours")) == 5, what="contours of all")
    assert not node.drops


@pytest.mark.slow
@pytest.mark.parametrize("kind", [ContourTrackerNode, BoardPoseNode])
def test_one_that_was_sent_before_the_node_came_is_asked_for(ros, tmp_path, kind):
    board = tmp_path / "board.yaml"
    board.write_text(board_to_yaml(BoardSpec()))
    rig = ros.start(LatchingRig)
    node = ros.start(kind, params={"board": str(board)} if kind is BoardPoseNode else {})
    ros.spin_until(lambda: node._pairing._info is not None, what="camera_info")
    for k in range(4):
        rig.send(views()[k], 10 * SECOND + k * STEP, parts=("pose", "image"))
    if kind is BoardPoseNode:
        assert "camera_info" not in told(ros, rig, node, "no image has a pose").message
    else:
        ros.spin_until(lambda: len(rig.stamps("contours")) == 4, what="contours of all")
        assert not node.drops


def test_where_poses_are_missing_these_are_named(ros):
    node, rig = ros.start(ContourTrackerNode), ros.start(Rig)
    connected(ros, rig, rig.image, rig.info, rig.pose)
    rig.info.publish(encode_camera_info(views()[0][0], 0, "camera"))
    ros.spin_until(lambda: node._pairing._info is not None, what="camera_info")
    rig.reports.clear()
    for k in range(5):
        rig.send(views()[k], 10 * SECOND + k * STEP, parts=("image",))
    told(ros, rig, node, "images arrive but no camera_pose on")
