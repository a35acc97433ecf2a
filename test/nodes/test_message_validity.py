"""What the nodes publish, field by field, as the definitions of the messages ask for it.

`ros2 topic echo`, `ros2 param describe` and RViz see what these tests see, on the wire.
"""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.node import Node
from rig import SECOND, scan, views
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField
from visualization_msgs.msg import Marker

from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.qos import latched, reliable, sensor
from occ_recon_ros.nodes.settings import NODE_SETTINGS
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.poses import BoardSpec, board_to_yaml
from occ_recon_ros.poses.axis import Turntable, turntable_to_yaml

TOPICS = {
    "contours": (PointCloud2, reliable(100)),
    "rim": (PointCloud2, reliable(100)),
    "strip": (PointCloud2, reliable(100)),
    "mesh": (PointCloud2, latched()),
    "mesh_marker": (Marker, latched()),
    "contour_image/compressed": (CompressedImage, reliable(10)),
    "/diagnostics": (DiagnosticArray, reliable(100)),
    "image": (Image, sensor()),
    "camera_info": (CameraInfo, sensor()),
    "camera_pose": (PoseStamped, reliable(100)),
}
FRAMES = 18
POINT = ["x", "y", "z"]
NORMAL = ["normal_x", "normal_y", "normal_z"]
FLOAT, U16, U8, U32 = PointField.FLOAT32, PointField.UINT16, PointField.UINT8, PointField.UINT32
FIELDS = {
    "contours": dict.fromkeys([*POINT, "vp_x", "vp_y", "vp_z", *NORMAL, "u", "v"], FLOAT)
    | {"loop": U16, "sigma": FLOAT},
    "rim": dict.fromkeys([*POINT, *NORMAL, "curvature", "depth_sigma"], FLOAT)
    | {"loop": U16, **dict.fromkeys(["prev", "vp_x", "vp_y", "vp_z"], FLOAT)}
    | {"prev_sec": U32, "prev_nanosec": U32, "status": U8},
    "strip": dict.fromkeys([*POINT, *NORMAL, "depth_sigma"], FLOAT),
    "mesh": dict.fromkeys([*POINT, *NORMAL, "depth_sigma"], FLOAT),
}
SIZES = {FLOAT: 4, U16: 2, U8: 1, U32: 4}
CODES = {FLOAT: "<f4", U16: "<u2", U8: "u1", U32: "<u4"}


class Listener(Node):
    """Keeps every message of every topic."""

    def __init__(self, **kwargs):
        super().__init__("listener", **kwargs)
        self.got = {topic: [] for topic in TOPICS}
        for topic, (kind, qos) in TOPICS.items():
            self.create_subscription(kind, topic, self.got[topic].append, qos)


@pytest.fixture
def start_pose_sources(ros, tmp_path):
    """Starts the nodes that publish poses, each with the file that it needs."""

    def start():
        board, axis = tmp_path / "board.yaml", tmp_path / "axis.yaml"
        board.write_text(board_to_yaml(BoardSpec()))
        straight = CameraPose(np.eye(3), np.zeros(3))
        axis.write_text(turntable_to_yaml(Turntable(np.zeros(3), np.eye(3)[2], straight)))
        ros.start(BoardPoseNode, params={"board": str(board)})
        ros.start(TurntablePoseNode, params={"axis": str(axis)})

    return start


@pytest.fixture
def heard(ros, graph, start_pose_sources):
    """All that is published before, while and after a turn of the virtual turntable."""
    listener = ros.start(Listener)
    ros.spin_until(lambda: listener.count_publishers("mesh_marker"), what="the mesher")
    assert ros.call(*graph.rig.trigger("mesher/reset")).success  # shows the empty surface
    ros.spin_until(lambda: listener.got["mesh"] and listener.got["mesh_marker"], what="nothing")
    size = {"frames": FRAMES, "step": 2 * np.pi / FRAMES, "width": 320, "height": 240}
    by_hand = {**size, "focal_px": 400.0, "frame_rate": 0.0}
    table = ros.start(VirtualTurntableNode, params=by_hand)
    for topic in ("image", "camera_info", "camera_pose"):
        ros.spin_until(lambda t=topic: table.count_subscribers(t) == 2, what=topic)
    for k in range(FRAMES):
        table.publish_frame(k, table.get_clock().now().nanoseconds)
        ros.spin_until(lambda n=k + 1: len(listener.got["contours"]) == n, what="contours")
    ros.spin_until(lambda: len(listener.got["rim"]) == FRAMES - 2, what="rims")
    client = graph.rig.trigger("reconstructor/finish")
    assert ros.call(*client).success
    ros.spin_until(lambda: len(listener.got["strip"]) == FRAMES, what="strips")
    stamp = listener.got["strip"][-1].header.stamp
    for topic in ("mesh", "mesh_marker"):
        ros.spin_until(lambda t=topic: listener.got[t][-1].header.stamp == stamp, what=topic)
    ros.process("viewer", "-p", "port:=0")
    start_pose_sources()
    names = {f"/{name}" for name in NODE_SETTINGS}
    ros.spin_until(
        lambda: names <= {s.name for m in listener.got["/diagnostics"] for s in m.status},
        what="a report of every node",
    )
    return listener.got


def stamps(messages):
    return [(m.header.stamp.sec, m.header.stamp.nanosec) for m in messages]


def values(msg):
    """The records of a cloud, read by nothing but its own fields."""
    layout = {
        "names": [f.name for f in msg.fields],
        "formats": [CODES[f.datatype] for f in msg.fields],
        "offsets": [f.offset for f in msg.fields],
        "itemsize": msg.point_step,
    }
    return np.frombuffer(bytes(msg.data), np.dtype(layout)).reshape(msg.height, msg.width)


def check_cloud(msg, topic):
    assert msg.header.frame_id == "turntable"
    assert msg.is_bigendian is False
    assert msg.row_step == msg.width * msg.point_step
    assert len(msg.data) == msg.row_step * msg.height
    types = {f.name: f.datatype for f in msg.fields}
    assert types == FIELDS[topic]
    assert list(types) == list(FIELDS[topic])
    assert all(f.count == 1 for f in msg.fields)
    ends = [(f.offset, f.offset + SIZES[f.datatype]) for f in msg.fields]
    assert all(end <= start for (_, end), (start, _) in pairwise(ends))
    assert ends[-1][1] <= msg.point_step
    rows = values(msg)
    points = np.stack([rows[axis] for axis in "xyz"])
    assert msg.is_dense is bool(np.isfinite(points).all())
    normals = np.stack([rows[name] for name in NORMAL])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1, atol=1e-5)
    return rows


def test_every_message_is_valid(heard):
    check_input(heard)
    images = stamps(heard["image"])
    for topic in ("contours", "rim"):
        for msg in heard[topic]:
            rows = check_cloud(msg, topic)
            assert msg.height == 1
            assert msg.width > 50
            if topic == "rim":
                assert rows["status"].max() <= 5
                assert np.isfinite(rows["x"][rows["status"] == 0]).all()
    assert stamps(heard["contours"]) == images
    assert sorted(set(stamps(heard["rim"]))) == images
    assert sorted(stamps(heard["strip"])) == images
    for topic in ("strip", "mesh"):
        for msg in heard[topic]:
            check_cloud(msg, topic)
            assert msg.width == 3
            assert msg.is_dense
    first, last = heard["mesh"][0], heard["mesh"][-1]
    assert first.height == 0
    assert last.height == sum(msg.height for msg in heard["strip"]) > 1000
    check_markers(heard["mesh_marker"])
    for msg in heard["contour_image/compressed"]:
        assert msg.header.frame_id == "camera"
        assert msg.format == "jpeg"
        assert cv2.imdecode(np.frombuffer(msg.data, np.uint8), -1).shape == (240, 320, 3)
    assert set(stamps(heard["contour_image/compressed"])) <= set(images)
    assert heard["contour_image/compressed"]
    check_diagnostics(heard["/diagnostics"])


def check_input(heard):
    """What the virtual turntable publishes: a frame's three messages have one stamp."""
    assert stamps(heard["image"]) == stamps(heard["camera_info"]) == stamps(heard["camera_pose"])
    assert len(set(stamps(heard["image"]))) == FRAMES
    for image, info, pose in zip(
        heard["image"], heard["camera_info"], heard["camera_pose"], strict=True
    ):
        assert image.header.frame_id == info.header.frame_id == "camera"
        assert (image.encoding, image.width, image.height) == ("mono8", 320, 240)
        assert image.step >= image.width
        assert len(image.data) == image.step * image.height
        assert (info.width, info.height) == (320, 240)
        K, R, P = (np.reshape(m, shape) for m, shape in zip(
            (info.k, info.r, info.p), ((3, 3), (3, 3), (3, 4)), strict=True
        ))  # fmt: skip
        np.testing.assert_array_equal(K[2], [0, 0, 1])
        np.testing.assert_array_equal(R, np.eye(3))
        np.testing.assert_array_equal(P, np.column_stack([K, np.zeros(3)]))
        assert info.distortion_model == "plumb_bob"
        assert len(info.d) in (0, 5)
        assert pose.header.frame_id == "turntable"
        q, p = pose.pose.orientation, pose.pose.position
        assert abs(np.linalg.norm([q.x, q.y, q.z, q.w]) - 1) < 1e-9
        assert np.linalg.norm([p.x, p.y, p.z]) == pytest.approx(1)


def check_markers(markers):
    for marker in markers:
        assert marker.header.frame_id == "turntable"
        assert (marker.ns, marker.id, marker.type) == ("mesh", 0, Marker.TRIANGLE_LIST)
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)
        q = marker.pose.orientation
        assert (q.x, q.y, q.z, q.w) == (0, 0, 0, 1)
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == (1, 1, 1)
        assert marker.color.a == 1
        assert len(marker.colors) in (0, len(marker.points))
        if marker.action == Marker.ADD:
            assert len(marker.points) >= 3
            assert len(marker.points) % 3 == 0
            points = np.array([(p.x, p.y, p.z) for p in marker.points])
            assert np.isfinite(points).all()
        else:
            assert marker.action == Marker.DELETE
            assert not marker.points
    assert markers[0].action == Marker.DELETE
    assert markers[-1].action == Marker.ADD


def check_diagnostics(arrays):
    levels = {DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR}
    for msg in arrays:
        assert msg.header.stamp.sec > 1e9
        assert len(msg.status) == 1
        status = msg.status[0]
        assert status.level in levels
        assert status.name.startswith("/")
        assert status.message
        assert (status.message == "OK") is (status.level == DiagnosticStatus.OK)
        keys = [item.key for item in status.values]
        assert all(keys)
        assert len(set(keys)) == len(keys)
        assert all(item.value for item in status.values)


@pytest.mark.parametrize("name", NODE_SETTINGS)
def test_parameters_are_described_and_ranged_over_the_services(
    ros, graph, start_pose_sources, name
):
    if name in ("board_pose", "turntable_pose"):
        start_pose_sources()
    elif name == "virtual_turntable":
        ros.start(VirtualTurntableNode, params={"frame_rate": 0.0})
    elif name == "viewer":
        ros.process(name, "-p", "port:=0")

    def ask(kind, service, **request):
        client = graph.rig.create_client(kind, f"/{name}/{service}")
        return ros.call(client, kind.Request(**request))

    listed = ask(ListParameters, "list_parameters").result.names
    ours = [n for n in listed if not n.startswith("qos_overrides.")]
    ours = [n for n in ours if n not in ("use_sim_time", "start_type_description_service")]
    assert set(ours) == set(NODE_SETTINGS[name].__dataclass_fields__)
    descriptors = ask(DescribeParameters, "describe_parameters", names=ours).descriptors
    current = ask(GetParameters, "get_parameters", names=ours).values
    for described, value in zip(descriptors, current, strict=True):
        assert len(described.description) > 10, described.name
        assert described.type == value.type
        if value.type == ParameterType.PARAMETER_DOUBLE:
            (span,) = described.floating_point_range
            assert span.from_value <= value.double_value <= span.to_value
        if value.type == ParameterType.PARAMETER_INTEGER:
            (span,) = described.integer_range
            assert span.from_value <= value.integer_value <= span.to_value
            assert span.step <= 1


def test_a_stamp_of_a_frame_is_that_of_all_that_is_made_of_it(graph):
    scan(graph.ros, graph.rig, views()[:6], start_s=7)
    wanted = {7 * SECOND + k * SECOND // 10 for k in range(6)}
    for topic in ("contours", "rim", "strip"):
        assert graph.rig.stamps(topic) == wanted
