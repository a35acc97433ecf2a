"""record: what the rig publishes is in the bag, however the recording ends."""

import re
import signal
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from mcap.reader import make_reader
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from recordings import FRAMES, changed, read_all
from sensor_msgs.msg import CameraInfo, Image

from occ_recon_ros.bags.reader import open_bag
from occ_recon_ros.bags.salvage import read_until_damage

PROGRAM = "import sys; from occ_recon_ros.cli import main; sys.exit(main(sys.argv[1:]))"
TYPES = {"/image": Image, "/camera_info": CameraInfo, "/camera_pose": PoseStamped}


class Rig:
    """Publishes recorded messages, to one recorder, without losing any."""

    def __init__(self, ros, messages, names):
        node = ros.start(Node, "rig")
        self.ros = ros
        self.messages = messages
        self.publishers = {
            topic: node.create_publisher(kind, names.get(topic, topic), QoSProfile(depth=50))
            for topic, kind in TYPES.items()
        }

    def play(self):
        heard = [publisher.get_subscription_count for publisher in self.publishers.values()]
        self.ros.spin_until(lambda: all(count() for count in heard), what="the recorder")
        for message in self.messages:
            self.publishers[message.topic].publish(message.cdr)
        for publisher in self.publishers.values():
            assert publisher.wait_for_all_acked(Duration(seconds=120))


@pytest.fixture
def recorder(ros):
    return lambda *arguments: ros.command("record", *arguments)


def ended(child, number):
    child.send_signal(number)
    out, err = child.communicate(timeout=120)
    return child.returncode, out, err


def by_topic(messages):
    return Counter(message.topic for message in messages)


def contents(messages, topic):
    """Messages without what padding happens to hold."""
    return [changed(m, lambda content: None).cdr for m in messages if m.topic == topic]


@pytest.mark.slow
def test_a_recording_gives_the_same_surface_as_the_rig_did(
    ros, replay, messages, expected, tmp_path
):
    names = {"/image": "/rig/image_raw", "/camera_pose": "/arm"}
    bag = tmp_path / "scan.mcap"
    # In two words each: rcl takes such a rule for its own, wherever it meets one.
    remaps = [word for topic, name in names.items() for word in ("--remap", f"{name}:={topic}")]
    child = ros.program("-c", PROGRAM, "record", bag, *remaps, stderr=subprocess.PIPE)
    Rig(ros, messages, names).play()
    code, out, err = ended(child, signal.SIGINT)
    assert code == 0, err
    assert out == f"{bag}: /camera_info {FRAMES}, /camera_pose {FRAMES}, /image {FRAMES}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["scan.mcap"]
    with bag.open("rb") as stream:
        statistics = make_reader(stream).get_summary().statistics
    assert statistics.message_count == 3 * FRAMES
    code, _, err = replay(bag, tmp_path / "out")
    assert code == 0, err
    assert "WARN" not in err  # what is logged at all hangs on the contexts of this process
    assert (tmp_path / "out" / "rims.ply").read_bytes() == expected


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["scan"], ["scan.db3"]])
def test_every_make_of_bag(ros, recorder, messages, tmp_path, arguments):
    bag = tmp_path / arguments[0]
    child = recorder(bag, *arguments[1:])
    Rig(ros, messages, {}).play()
    code, _, err = ended(child, signal.SIGTERM)
    assert code == 0, err
    assert [path.name for path in tmp_path.iterdir()] == [bag.name]
    got = read_all(bag)
    assert by_topic(got) == by_topic(messages)
    for topic in TYPES:
        assert contents(got, topic) == contents(messages, topic)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["scan.mcap"], ["scan", "--storage=sqlite3"]])
def test_a_killed_recorder_leaves_what_came(ros, recorder, messages, tmp_path, arguments):
    bag = tmp_path / arguments[0]
    child = recorder(bag, *arguments[1:])
    Rig(ros, messages, {}).play()

    def written():
        found = []
        files = [bag] if bag.is_file() else bag.glob("*.db3")
        try:
            for file in files:
                found += read_until_damage(file)
        except Exception:  # the end of a file that grows
            pass
        return by_topic(found)

    ros.spin_until(lambda: written() == by_topic(messages), what="the messages on the disk")
    child.kill()
    child.communicate()
    assert open_bag(bag).counts == by_topic(messages)


def test_a_recording_does_not_touch_what_is_there(command, tmp_path):
    bag = tmp_path / "scan.mcap"
    bag.write_text("precious")
    code, _, err = command("record", bag)
    assert code == 2
    assert "exists already" in err
    assert bag.read_text() == "precious"


@pytest.mark.slow
def test_a_recording_of_nothing_says_what_was_missing(ros, recorder, messages, tmp_path):
    rig = Rig(ros, messages, {"/image": "/cam"})
    bag = tmp_path / "scan"
    child = recorder(bag, "--remap=/cam:=/camera_info")
    ros.spin_until(lambda: rig.publishers["/camera_pose"].get_subscription_count())
    refused = "/cam is sensor_msgs/msg/Image, not sensor_msgs/msg/CameraInfo"
    assert any(refused in line for line in child.stderr)
    code, out, err = ended(child, signal.SIGINT)
    assert (code, out) == (2, ""), err
    line = err.splitlines()[-1]
    assert "error: nothing was recorded: nothing on /image (publishers: none)" in line
    assert refused in line
    assert re.search(r"nothing on /camera_pose \(publishers: (/rig|unknown)\)", line)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_recording_without_a_topic_that_was_asked_for_is_an_error(
    ros, recorder, messages, tmp_path
):
    bag = tmp_path / "scan.mcap"
    child = recorder(bag, "--remap", "/cam/image_raw:=/image")
    rig = Rig(ros, messages[:6], {})
    heard = rig.publishers["/camera_pose"].get_subscription_count
    ros.spin_until(heard, what="the recorder")
    pose = next(message for message in messages if message.topic == "/camera_pose")
    rig.publishers["/camera_pose"].publish(pose.cdr)
    assert rig.publishers["/camera_pose"].wait_for_all_acked(Duration(seconds=120))
    code, out, err = ended(child, signal.SIGINT)
    assert (code, out) == (2, ""), err
    assert (
        f"error: {bag} holds /camera_pose 1, but nothing on /cam/image_raw (publishers: none)"
        in err.splitlines()[-1]
    )
    assert open_bag(bag).counts == {"/camera_pose": 1}


def test_remaps_that_make_no_sense(command, tmp_path):
    for remap, words in {"/a:=/b": "/b is none of", "/a": "FROM:=TO"}.items():
        code, _, err = command("record", tmp_path / "bag", "--remap", remap)
        assert code == 2
        assert words in err
    assert not Path(tmp_path / "bag").exists()
