"""The layouts for RViz and Foxglove show what the nodes send, under its names."""

import json

import numpy as np
import pytest
import yaml

from msg_adapters import encode_contours, encode_rim, encode_strip
from occ_recon_ros.geometry import Contours, Rim
from occ_recon_ros.nodes.settings import NODE_SETTINGS
from occ_recon_ros.resources import config_file
from occ_recon_ros.streams.topics import TOPICS, topic
from occ_recon_ros.surface import Strip

SHOWN_BY = {
    "rviz_default_plugins/CameraInfo": {"sensor_msgs/msg/CameraInfo"},
    "rviz_default_plugins/Image": {"sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"},
    "rviz_default_plugins/Marker": {"visualization_msgs/msg/Marker"},
    "rviz_default_plugins/PointCloud2": {"sensor_msgs/msg/PointCloud2"},
    "rviz_default_plugins/Pose": {"geometry_msgs/msg/PoseStamped"},
    "rviz_default_plugins/PoseWithCovariance": {"geometry_msgs/msg/PoseWithCovarianceStamped"},
}
# A word between two nodes, and what is a matter of each tool, are for nobody to look at.
UNSEEN = ("/tf", "reconstructor/turn")
NAMES = {f"/{row.name.lstrip('/')}" for row in TOPICS if not row.name.startswith(UNSEEN)}
OBJECT_FRAME = NODE_SETTINGS["mesher"].object_frame


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load(config_file("turntable.rviz").read_text())["Visualization Manager"]


@pytest.fixture(scope="module")
def foxglove():
    return json.loads(config_file("turntable_foxglove.json").read_text())


@pytest.fixture(scope="module")
def channels():
    """{topic: names of its fields}."""
    one, three = np.zeros(0), np.zeros((0, 3))
    both = {"stamp_ns": 0, "frame_id": "", "loop": np.zeros(0, np.uint16), "centre": np.zeros(3)}
    contours = Contours(**both, T=three, N=three, uv=np.zeros((0, 2)), sigma=one)
    rim = {"points": three, "normals": three, "curvature": one, "depth_sigma": one, "prev": one}
    corners = np.zeros((0, 3, 3), np.float32)
    strip = encode_strip(Strip(0, "", corners, corners, corners[..., 0]))
    found = {
        "contours": encode_contours(contours),
        "rim": encode_rim(Rim(**both, **rim, status=np.zeros(0, np.uint8))),
        **dict.fromkeys(("strip", "mesh", "closed"), strip),
    }
    return {name: {field.name for field in message.fields} for name, message in found.items()}


def row_of(shown):
    return topic(shown if shown in {row.name for row in TOPICS} else shown.removeprefix("/"))


def test_rviz_asks_for_each_topic_as_it_is_sent(rviz):
    for display in rviz["Displays"]:
        if "Topic" not in display:
            continue
        asked, row = display["Topic"], row_of(display["Topic"]["Value"])
        assert row.type_name in SHOWN_BY[display["Class"]]
        assert asked["Reliability Policy"] == ("Reliable" if row.reliable else "Best Effort")
        assert asked["Durability Policy"] == ("Transient Local" if row.latched else "Volatile")
        assert asked["Depth"] >= row.depth
    assert rviz["Global Options"]["Fixed Frame"] == OBJECT_FRAME


def test_rviz_shows_every_topic_that_it_can(rviz):
    shown = {d["Topic"]["Value"] for d in rviz["Displays"] if "Topic" in d}
    known = set().union(*SHOWN_BY.values())
    assert shown == {f"/{row.name}" for row in TOPICS if row.type_name in known}


def test_channels_that_colour_points_are_fields_of_the_message(rviz, foxglove, channels):
    used = [
        (d["Topic"]["Value"][1:], d["Channel Name"])
        for d in rviz["Displays"]
        if d.get("Color Transformer") == "Intensity"
    ]
    clouds = foxglove["configById"]["3D!surface"]["topics"]
    used += [(name[1:], how["colorField"]) for name, how in clouds.items() if "colorField" in how]
    assert len(used) >= 4
    for name, channel in used:
        assert channel in channels[name]


def test_foxglove_shows_every_topic(foxglove):
    panels = foxglove["configById"]
    three = panels["3D!surface"]
    shown = set(three["topics"])
    for panel in panels.values():
        mode = panel.get("imageMode") or {}
        shown |= {mode.get("imageTopic"), mode.get("calibrationTopic")}
        shown |= {panel.get("topicPath"), panel.get("topicToRender")}
    assert shown - {None} == NAMES
    assert three["followTf"] == OBJECT_FRAME


def test_foxglove_places_each_panel_once(foxglove):
    placed = []

    def walk(tree):
        if isinstance(tree, str):
            placed.append(tree)
            for tab in foxglove["configById"][tree].get("tabs", ()):
                walk(tab["layout"])
        else:
            walk(tree["first"])
            walk(tree["second"])

    walk(foxglove["layout"])
    assert sorted(placed) == sorted(foxglove["configById"])
