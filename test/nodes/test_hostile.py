"""Hostile streams: whatever comes, the nodes go on, and a good scan is a good scan."""

import copy
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from file_changes import FileChanges
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rig import SECOND, scan, views
from sensor_msgs.msg import CompressedImage, Image
from spoilers import SPOILERS
from std_srvs.srv import SetBool, Trigger

from msg_adapters import encode_camera_info, encode_image, encode_jpeg, encode_pose

EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "4"))
"""Streams of 500 messages each; HOSTILE_EXAMPLES=20 sends ten thousand, and half as many of 16
bits."""
OTHERS = {".ros", "tmp"}
"""Where ROS and everybody writes, in the home folder and in the root."""
LENGTH, MESSAGES = 280, 500
FRAMES = 8

numbers = st.integers(0, 2**32 - 1)


ELSEWHERE = [
    "../elsewhere",
    "/etc/elsewhere",
    "/elsewhere",
    "..",
    "a/../../elsewhere",
    "~/elsewhere",
]


class Hostile:
    """Publishes good messages, spoilt ones, and good ones late, twice, in a wrong order or never.

    Attributes:
        lost: the share of messages that are never sent.
    """

    def __init__(self, graph, clouds, frames):
        self.graph = graph
        rig = graph.rig
        self.clouds, self.views = clouds, frames
        self.lost = 0.0
        self.held = []
        self.sent = 0
        cloud = type(clouds["contours"][0])
        self.publishers = {"image": rig.image, "info": rig.info, "pose": rig.pose}
        self.publishers |= {t: rig.create_publisher(cloud, t, 100) for t in ("contours", "rim")}
        packed = rig.create_publisher(CompressedImage, "image/compressed", rig.image.qos_profile)
        self.publishers["compressed"] = packed
        nodes = ("contour_tracker", "reconstructor", "mesher")
        names = [f"{node}/reset" for node in nodes] + ["mesher/save", "mesher/finish"]
        self.triggers = [rig.create_client(Trigger, name) for name in names]
        names = ("contour_tracker/pause", "mesher/pause")
        self.pauses = [rig.create_client(SetBool, name) for name in names]
        self.parameters = rig.create_client(SetParameters, "mesher/set_parameters")

    def ask(self, rng):
        """Call some service, or ask for files elsewhere, without waiting for the answer."""
        way = rng.integers(4)
        if way == 0:
            name = ["scan_name", "output_dir"][rng.integers(2)]
            value = ELSEWHERE[rng.integers(len(ELSEWHERE))]
            wish = Parameter(name, value=value).to_parameter_msg()
            self.parameters.call_async(SetParameters.Request(parameters=[wish]))
        elif way == 1:
            pause = self.pauses[rng.integers(len(self.pauses))]
            pause.call_async(SetBool.Request(data=bool(rng.integers(2))))
        else:
            self.triggers[rng.integers(len(self.triggers))].call_async(Trigger.Request())

    def go_on(self):
        """Nobody is paused any more."""
        for pause in self.pauses:
            assert self.graph.ros.call(pause, SetBool.Request(data=False)).success

    def masks(self, given):
        """Let there be someone who publishes masks, or not: the tracker waits for those."""
        if "mask" in self.publishers:
            self.graph.rig.destroy_publisher(self.publishers.pop("mask"))
        if given:
            qos = self.graph.rig.image.qos_profile
            self.publishers["mask"] = self.graph.rig.create_publisher(Image, "mask", qos)
        self.graph.ros.spin_until(lambda: self.graph.tracker.count_publishers("mask") == given)

    def message(self, topic, frame, stamp):
        camera, pixels = self.views[frame]
        if topic in self.clouds:
            msg = copy.deepcopy(self.clouds[topic][frame % len(self.clouds[topic])])
        elif topic == "image":
            msg = encode_image(pixels, 0, "camera")
        elif topic == "mask":
            msg = encode_image(np.uint8(255) * (views()[frame][1] < 128), 0, "camera")
        elif topic == "compressed":
            msg = encode_jpeg(views()[frame][1], 0, "camera")
        elif topic == "info":
            msg = encode_camera_info(camera, 0, "camera")
        else:
            msg = encode_pose(camera, 0, "turntable")
        msg.header.stamp.sec, msg.header.stamp.nanosec = stamp
        return msg

    def send(self, topic, frame, stamp, spoil, rng, copies):
        """One message, or for "frame" those of an image, of which one may be spoilt."""
        topics = (topic,)
        if topic == "frame":
            image = "compressed" if rng.random() < 0.1 else "image"
            topics = [t for t in ("info", "pose", "mask", image) if t in self.publishers]
            if rng.random() < 0.5:
                rng.shuffle(topics)
        spoilt = topics[rng.integers(len(topics))] if spoil else None
        for name in topics:
            msg = self.message(name, frame, stamp)
            if name == spoilt:
                SPOILERS[name](msg, rng)
            for _ in range(copies):
                self.publish(name, msg, rng)

    def publish(self, name, msg, rng):
        """Now, later or never; perhaps also one that is late."""
        fate = rng.random()
        if fate < self.lost:
            return
        if fate > 0.95:
            self.held.append((name, msg))
        else:
            self.sent += 1
            self.publishers[name].publish(msg)
        if self.held and rng.random() < 0.05:
            self.release(int(rng.integers(len(self.held))))

    def release(self, number):
        name, msg = self.held.pop(number)
        if name in self.publishers:
            self.sent += 1
            self.publishers[name].publish(msg)


stamps = st.one_of(
    st.tuples(st.integers(0, 400), st.sampled_from([0, 100_000_000])),
    st.tuples(st.integers(-(2**31), 2**31 - 1), numbers),
)
actions = st.tuples(
    st.sampled_from(["frame", "frame", "frame", *SPOILERS]),
    st.integers(0, FRAMES - 1),
    stamps,
    st.booleans(),
    st.integers(1, 2),
)


def good_scan(graph, start_s, frames):
    """The triangles of a good scan after a reset of all nodes."""
    rig = graph.rig
    for node in ("contour_tracker", "reconstructor", "mesher"):
        assert graph.ros.call(*rig.trigger(f"{node}/reset")).success
    graph.settle(5)
    for messages in rig.got.values():
        messages.clear()
    scan(graph.ros, rig, frames[:FRAMES], start_s=start_s)
    return rig.triangles(start_s)


def calmed(graph, frames):
    """A graph that has made a good scan, and the triangles of it."""
    triangles = good_scan(graph, 1000, frames)
    clouds = {topic: list(graph.rig.got[topic]) for topic in ("contours", "rim")}
    return Hostile(graph, clouds, frames), triangles


def looks(graph, count):
    for _ in range(count):
        graph.ros.executor.spin_once(timeout_sec=0)


@pytest.fixture
def calm(graph):
    return calmed(graph, views())


@pytest.fixture
def deep(make_graph, transforms):
    """Images of 16 bits, a region of interest, and poses by /tf."""
    roi = {"roi_x": 20, "roi_y": 10, "roi_width": 280, "roi_height": 220}
    graph = make_graph({"tracker": {"pose_source": "tf", **roi}})
    return calmed(graph, [(camera, np.uint16(257) * pixels) for camera, pixels in views()])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["calm", "deep"])
def test_no_stream_stops_a_node_or_spoils_a_later_scan(kind, request, tmp_path):
    hostile, triangles = request.getfixturevalue(kind)
    graph = hostile.graph
    output = graph.mesher.keeper.files.folder
    # A look in vain takes as long as a message; but of two streams alone some waits must come.
    go_on = partial(graph.work, 6) if kind == "calm" else partial(looks, graph, 6)
    changes = FileChanges(tmp_path, tmp_path.parent, Path.home(), Path("/etc"), Path("/"))

    @settings(
        max_examples=EXAMPLES if kind == "calm" else EXAMPLES // 2,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(
        st.lists(actions, min_size=LENGTH, max_size=LENGTH),
        st.integers(0, 2**32 - 1),
        st.floats(0, 0.5),
        st.booleans(),
    )
    def attack(stream, seed, lost, masks):
        rng = np.random.default_rng(seed)
        hostile.lost = lost
        hostile.masks(masks)
        for k, (topic, frame, stamp, spoil, copies) in enumerate(stream):
            if topic == "frame" and rng.random() < 0.5:
                stamp = (500 + k, 0)  # as they should be, now and then
            if masks or topic != "mask":
                hostile.send(topic, frame, stamp, spoil, rng, copies)
            if rng.random() < 0.02:
                hostile.ask(rng)
            go_on()
        while hostile.held:
            hostile.release(0)
            go_on()
        hostile.masks(False)
        graph.work(330, wait=0.05)
        hostile.go_on()
        for node in (graph.tracker, graph.reconstructor, graph.mesher):
            assert not node.drops["internal_error"], node.get_name()
        np.testing.assert_array_equal(good_scan(graph, 5_000_000, hostile.views), triangles)

    attack()
    assert hostile.sent > EXAMPLES * MESSAGES // 2
    met = set(graph.tracker.drops + graph.reconstructor.drops + graph.mesher.drops)
    assert {"bad_image", "bad_camera_info", "bad_contours", "bad_rim", "no_object"} <= met
    if kind == "deep":
        assert "bad_tf" in met
    else:
        assert {"bad_camera_pose", "pose_frame", "no_image", "no_camera_info"} <= met
        assert {"bad_mask", "no_mask", "duplicate", "out_of_order", "empty_contours"} <= met
    written = {path for path in changes.seen() if path.name not in OTHERS}
    changes.close()
    assert list(output.glob("*/mesh.ply"))
    assert written == {output}


def test_after_hostility_a_bag_that_starts_earlier_is_a_new_scan_without_a_reset(calm):
    hostile, triangles = calm
    graph, rng = hostile.graph, np.random.default_rng(0)
    for k in range(300):
        topic = ["frame", "contours", "rim", "image"][k % 4]
        stamp = (2000 + int(rng.integers(0, 300)), 0)
        hostile.send(topic, k % FRAMES, stamp, bool(rng.integers(2)), rng, 1 + k % 2)
        graph.settle(3)
    hostile.send("frame", 0, (5000, 0), False, rng, 1)
    graph.work(1000, wait=0.05)
    for messages in graph.rig.got.values():
        messages.clear()
    for k, view in enumerate(views()[:FRAMES]):
        stamp = 500 * SECOND + k * SECOND // 10
        graph.rig.send(view, stamp)
        graph.settle(12)
        if k >= 2:  # so many are put aside until it is clear that time went back
            graph.ros.spin_until(lambda s=stamp: s in graph.rig.stamps("contours"))
    graph.ros.spin_until(lambda: graph.reconstructor.figures()["frames"] == FRAMES)
    assert graph.ros.call(*graph.rig.trigger("reconstructor/finish")).success
    wanted = {500 * SECOND + k * SECOND // 10 for k in range(FRAMES)}
    graph.ros.spin_until(lambda: wanted <= graph.rig.stamps("strip"))
    np.testing.assert_array_equal(graph.rig.triangles(500), triangles)
