"""The nodes send and hear what the one table of topics says, with the quality it promises."""

from collections import defaultdict

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from msg_adapters import message_type
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.nodes.viewer import ViewerNode
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.poses import BoardSpec, board_to_yaml
from occ_recon_ros.poses.axis import Turntable, turntable_to_yaml
from occ_recon_ros.streams.topics import TOPICS, TYPE_NAMES, Topic
from occ_recon_ros.viewer.page import Page

EVERY_NODE_HAS = {"/rosout", "/parameter_events"}
NAMESPACE = "/rig7"


@pytest.fixture
def nodes(ros, monkeypatch, tmp_path):
    """All nodes, with all that their parameters can make them hear."""
    monkeypatch.setattr(Page, "viewers", 1)
    space = {"namespace": NAMESPACE}
    started = [
        ros.start(kind, **space)
        for kind in (ContourTrackerNode, ReconstructorNode, VirtualTurntableNode)
    ]
    started.append(ros.start(MesherNode, params={"color": True}, **space))
    started.append(ros.start(ViewerNode, params={"port": 0}, **space))
    board, axis = tmp_path / "board.yaml", tmp_path / "axis.yaml"
    board.write_text(board_to_yaml(BoardSpec()))
    straight = CameraPose(np.eye(3), np.zeros(3))
    axis.write_text(turntable_to_yaml(Turntable(np.zeros(3), np.eye(3)[2], straight)))
    started.append(ros.start(BoardPoseNode, params={"board": str(board)}, **space))
    started.append(ros.start(TurntablePoseNode, params={"axis": str(axis)}, **space))
    # /tf is heard only where a parameter asks for it, and tf2_msgs is there.
    rows = {f"{NAMESPACE}/{row.name}" if row.name[0] != "/" else row.name for row in TOPICS}
    rows -= {"/tf", "/tf_static"}
    observer = started[0]
    ros.spin_until(
        lambda: rows <= {name for name, _ in observer.get_topic_names_and_types()},
        what="all topics",
    )
    return started


def ends(nodes, way):
    """{(topic, node): what the middleware says of that end}, of our own nodes."""
    found = defaultdict(dict)
    look = {
        "sends": nodes[0].get_publishers_info_by_topic,
        "hears": nodes[0].get_subscriptions_info_by_topic,
    }[way]
    for topic, _ in nodes[0].get_topic_names_and_types():
        if topic not in EVERY_NODE_HAS:
            for end in look(topic):
                if end.node_namespace != NAMESPACE:  # one of another test that was killed
                    continue
                found[topic.removeprefix(f"{NAMESPACE}/"), end.node_name] = end
    return found


def table(attribute):
    return {
        (row.name, node): row for row in TOPICS for node in getattr(row, attribute) if node != "rig"
    }


@pytest.mark.parametrize(("way", "attribute"), [("sends", "sources"), ("hears", "readers")])
def test_every_end_is_in_the_table_and_the_table_is_there(ros, nodes, way, attribute):
    wanted = table(attribute)
    ros.spin_until(lambda: wanted.keys() <= ends(nodes, way).keys(), what="all ends")
    found = ends(nodes, way)
    assert found.keys() <= wanted.keys()
    for key, end in found.items():
        row = wanted[key]
        assert end.topic_type == row.type_name, key
        assert end.qos_profile.reliability.name == ("RELIABLE" if row.reliable else "BEST_EFFORT")
        assert end.qos_profile.durability.name == ("TRANSIENT_LOCAL" if row.latched else "VOLATILE")


def test_as_many_messages_wait_as_the_table_says(nodes):
    """The middleware does not tell others the depth of a queue."""
    sent, heard = table("sources"), table("readers")
    for node in nodes:
        for end in node.publishers:
            key = end.topic_name.removeprefix(f"{NAMESPACE}/"), node.get_name()
            if key in sent:
                assert end.qos_profile.depth == sent[key].depth, key
        for end in node.subscriptions:
            key = end.topic_name.removeprefix(f"{NAMESPACE}/"), node.get_name()
            if key in heard:
                assert end.qos_profile.depth >= heard[key].depth, key


def test_the_types_of_the_table_exist_and_no_name_comes_twice():
    for row in TOPICS:
        if row.type_name.startswith("tf2_msgs/"):  # which pip has no wheels of
            assert row.type_name in get_typestore(Stores.ROS2_JAZZY).types
            continue
        assert isinstance(message_type(row.type_name), type)
    assert len({row.name for row in TOPICS}) == len(TOPICS)


def test_a_recording_holds_what_a_rig_sends():
    assert TYPE_NAMES.keys() == {
        f"/{row.name.lstrip('/')}" for row in TOPICS if "rig" in row.sources
    }
    assert all(isinstance(row, Topic) for row in TOPICS)
