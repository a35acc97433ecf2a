"""Messages that never came are said, those that nobody sent are not."""

import numpy as np
from rclpy.node import Node
from rig import SECOND, Rig, told, views
from sensor_msgs.msg import Image, JointState

from msg_adapters import Level, encode_image
from msg_adapters.header import encode_header
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.nodes.viewer import ViewerNode
from occ_recon_ros.poses.axis import Turntable, turntable_to_yaml


def test_images_that_are_lost_are_a_warning(ros):
    node = ros.start(ContourTrackerNode)
    rig = ros.start(Rig)
    ros.spin_until(rig.image.get_subscription_count, what="the node")
    rig.send(views()[0], SECOND, parts=("image",))
    ros.spin_until(lambda: len(node._pairing) == 1, what="the first image")
    for k in range(30):  # more than its queue holds
        rig.send(views()[0], (k + 2) * SECOND, parts=("image",))
    said = told(ros, rig, node, "messages of /image were lost")
    assert said.level == Level.WARN
    lost = int(said.values["dropped lost_image"])
    assert lost > 0
    assert f"{lost} messages of /image were lost: they come faster than" in said.message


def test_joint_states_that_are_lost_are_a_warning(ros, tmp_path):
    axis = tmp_path / "axis.yaml"
    axis.write_text(
        turntable_to_yaml(
            Turntable(np.zeros(3), np.eye(3)[2], CameraPose(np.eye(3), np.array([0.5, 0, 0])))
        )
    )
    node = ros.start(TurntablePoseNode, params={"axis": str(axis)})
    rig = ros.start(Rig)
    joints = rig.create_publisher(JointState, "joint_states", 500)
    ros.spin_until(joints.get_subscription_count, what="the node")
    for k in range(300):
        stamp = encode_header(SECOND + k * SECOND // 100, "")
        joints.publish(JointState(header=stamp, name=["table"], position=[0.01 * k]))
        if not k:
            ros.spin_until(lambda: node._angles, what="the first angle")
    told(ros, rig, node, "messages of /joint_states were lost")


def test_a_second_camera_that_goes_leaves_no_loss_behind(ros):
    node = ros.start(ContourTrackerNode)
    rig = ros.start(Rig)
    second = ros.start(Node, "second")
    other = second.create_publisher(Image, "image", rig.image.qos_profile)
    ros.spin_until(lambda: rig.image.get_subscription_count() and other.get_subscription_count())
    numbers = dict.fromkeys((rig.image, other), 0)

    def send(publisher, k):
        publisher.publish(encode_image(views()[0][1], k * SECOND, "camera"))
        numbers[publisher] += 1
        ros.spin_until(lambda: node.loss.last("image") == numbers[publisher], what="the image")

    for k in range(1, 31):
        send(rig.image, k)
    for k in range(31, 34):
        send(other, k)
        send(rig.image, k + 100)
    ros.end(second)
    ros.spin_until(lambda: node.publishers_of("image") == 1, what="the end of the second")
    for k in range(200, 203):
        send(rig.image, k)
    assert node.drops["lost_image"] == 0


def test_many_publishers_of_diagnostics_are_right(ros):
    node = ros.start(ViewerNode, params={"port": 0})
    rig = ros.start(Rig)
    ros.start(ContourTrackerNode)
    ros.spin_until(lambda: node.loss.restarts["/diagnostics"], what="the other's reports")
    rig.reports.clear()
    ros.spin_until(lambda: "/viewer" in rig.reports, what="a report of the viewer")
    assert rig.reports["/viewer"].message == "OK"
