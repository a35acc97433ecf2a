"""Bags that others wrote: every storage, compression and way of splitting is read alike."""

from pathlib import Path

import cv2
import pytest
import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rclpy.serialization import deserialize_message, serialize_message
from recordings import FRAMES, write_all
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CompressedImage, Image

from msg_adapters import decode_image
from occ_recon_ros.bags.reader import open_bag
from occ_recon_ros.errors import UserError

STORE = get_typestore(Stores.ROS2_JAZZY)
ROSBAG2 = [
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    (StoragePlugin.MCAP, CompressionMode.FILE),
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
]


def by_mcap(path: Path, messages, **options) -> Path:
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=200_000, **options)
        writer.start("ros2", "another tool")
        channels = {}
        for topic, msgtype, time_ns, cdr in messages:
            if topic not in channels:
                definition = STORE.generate_msgdef(msgtype, ros_version=2)[0].encode()
                schema = writer.register_schema(msgtype, "ros2msg", definition)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], time_ns, cdr, time_ns)
        writer.finish()
    return path


def contents(path: Path):
    bag = open_bag(path)
    assert bag.lost == ""
    return [(m.topic, m.msgtype, m.time_ns, m.cdr) for m in bag.messages(list(bag.types))]


@pytest.mark.parametrize(("storage", "compression"), ROSBAG2)
def test_rosbag2(messages, tmp_path, storage, compression):
    bag = write_all(tmp_path / "bag", messages, storage, compression)
    assert contents(bag) == [tuple(message) for message in messages]


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("use_chunking", [True, False])
def test_mcap_without_metadata(messages, tmp_path, compression, use_chunking):
    bag = tmp_path / "bag.mcap"
    by_mcap(bag, messages, compression=compression, use_chunking=use_chunking)
    assert contents(bag) == [tuple(message) for message in messages]


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_split_bag(messages, tmp_path, storage):
    """As rosbag2 splits one: files side by side, and one metadata.yaml that lists them."""
    third = len(messages) // 3
    parts = [messages[i * third : (i + 1) * third] for i in range(3)]
    bag = tmp_path / "bag"
    bag.mkdir()
    metadata = {}
    for i, part in enumerate(parts):
        folder = write_all(tmp_path / f"bag_{i}", part, storage)
        one = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        (name,) = one["relative_file_paths"]
        (folder / name).rename(bag / name)
        metadata = metadata or {**one, "relative_file_paths": [], "files": [], "message_count": 0}
        metadata["relative_file_paths"].append(name)
        metadata["files"] += one["files"]
        metadata["message_count"] += one["message_count"]
    for topic in metadata["topics_with_message_count"]:
        topic["message_count"] *= 3
    with (bag / "metadata.yaml").open("w") as stream:
        yaml.dump({"rosbag2_bagfile_information": metadata}, stream)
    assert contents(bag) == [tuple(message) for message in messages]


@pytest.mark.parametrize("storage", StoragePlugin)
def test_compressed_messages_are_read_without_the_metadata_that_tells_of_it(
    messages, tmp_path, storage
):
    folder = write_all(tmp_path / "bag", messages, storage, CompressionMode.MESSAGE)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.iterdir()
    assert contents(file) == contents(folder) == [tuple(message) for message in messages]


def test_a_bag_of_ros_1_is_named_with_what_converts_it(messages, tmp_path):
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(UserError, match=r"ROS 1 bag: rosbags-convert --src .*a\.bag --dst .*jazzy"):
        open_bag(tmp_path / "a.bag")


def test_files_compressed_otherwise_are_named(tmp_path):
    (tmp_path / "bag.db3.lz4").write_bytes(b"packed")
    with pytest.raises(UserError, match=r"holds bag\.db3\.lz4.*lz4 -d.*the \.db3 file"):
        open_bag(tmp_path)


def test_compressed_images_under_other_names(replay, messages, expected, tmp_path):
    """PNG loses nothing: the surface is the same. There is no tf, and there are other topics."""

    def compressed(message):
        image = deserialize_message(message.cdr, Image)
        png = cv2.imencode(".png", decode_image(image))[1]
        small = CompressedImage(header=image.header, format="mono8; png compressed")
        small.data.frombytes(png.tobytes())
        cdr = serialize_message(small)
        return message._replace(
            topic="/cam/image_raw/compressed",
            msgtype="sensor_msgs/msg/CompressedImage",
            cdr=cdr,
        )

    names = {"/camera_info": "/cam/camera_info", "/camera_pose": "/arm/pose"}
    others = [m._replace(topic="/elsewhere/camera_info") for m in messages if "info" in m.topic]
    found = [
        compressed(m) if m.topic == "/image" else m._replace(topic=names[m.topic]) for m in messages
    ]
    bag = by_mcap(tmp_path / "bag.mcap", found + others, compression=CompressionType.LZ4)
    out = tmp_path / "out"
    remaps = {**names, "/image/compressed": "/cam/image_raw/compressed"}
    arguments = [f"--remap={source}:={target}" for target, source in remaps.items()]
    code, text, err = replay(bag, out, *arguments)
    assert (code, err) == (0, "")
    assert f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims" in text
    assert (out / "rims.ply").read_bytes() == expected
