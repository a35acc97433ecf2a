"""A small scan: a folder of rendered images, and bags of any make."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras

FRAMES = 12


class Recorded(NamedTuple):
    """One message of a bag."""

    topic: str
    msgtype: str
    time_ns: int
    cdr: bytes


def write_folder(path: Path) -> None:
    """A vase in a full turn of 12 views of 160 x 120 pixels."""
    path.mkdir()
    settings = TurntableSettings(
        frames=FRAMES, step=2 * np.pi / FRAMES, width=160, height=120, focal_px=250
    )
    vase, frames = make_object("vase"), []
    for i, camera in enumerate(turntable_cameras(settings)):
        assert cv2.imwrite(str(path / f"{i}.png"), render(vase, camera))
        frames.append(
            {
                "file": f"{i}.png",
                "width": camera.width,
                "height": camera.height,
                "K": camera.K.tolist(),
                "R": camera.R_camera_object.tolist(),
                "t": camera.t_camera_object.tolist(),
            }
        )
    (path / "cameras.json").write_text(json.dumps({"unit_in_metres": 1.0, "frames": frames}))


def read_all(bag: Path) -> list[Recorded]:
    """All messages of a bag."""
    with Reader(bag) as reader:
        return [Recorded(c.topic, c.msgtype, t, bytes(raw)) for c, t, raw in reader.messages()]


def write_all(
    bag: Path,
    messages: Iterable[Recorded],
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """A folder bag of messages, in the order of their times."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(bag, version=9, storage_plugin=storage)
    if compression != CompressionMode.NONE:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, msgtype, time_ns, cdr in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(connections[topic], time_ns, cdr)
    return bag


def changed(message: Recorded, change: Callable) -> Recorded:
    """A message with some of its fields changed in place by a function."""
    store = get_typestore(Stores.ROS2_JAZZY)
    decoded = store.deserialize_cdr(message.cdr, message.msgtype)
    change(decoded)
    return message._replace(cdr=bytes(store.serialize_cdr(decoded, message.msgtype)))


def later(message: Recorded, ns: int) -> Recorded:
    """With a later stamp, recorded at the same time."""

    def move(msg):
        stamp = msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec + ns
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 10**9)

    return changed(message, move)
