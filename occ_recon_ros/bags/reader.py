"""Reading a rosbag2, also one that breaks off."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2 import Reader

from occ_recon_ros.errors import UserError

from .image_names import read_names
from .salvage import BagMessage, is_cut, read_until_damage, storage_files, unpacked
from .told_of_masks import read_told

__all__ = ["Bag", "BagMessage", "open_bag"]

_ROS1 = b"#ROSBAG V"


@dataclass
class Bag:
    """A recording: a folder with metadata.yaml, or a bare .mcap or .db3 file.

    Attributes:
        path: where it is.
        types: message type of each topic.
        counts: number of whole messages of each topic.
        lost: a sentence on what could not be read, "" if nothing is missing. More may be
            added while messages are read.
        damaged: read file by file up to the damage, not by index.
        change: what is made of each message that is read.
    """

    path: Path
    types: dict[str, str]
    counts: Counter[str]
    lost: str = ""
    damaged: bool = field(default=False, repr=False)
    change: Callable[[BagMessage], BagMessage] = field(default=lambda message: message, repr=False)

    @cached_property
    def names(self) -> dict[int, str]:
        """Names of the files that images came from, by stamp (ns); none where nobody said."""
        return {} if self.damaged else read_names(self.path)

    @cached_property
    def told_of_masks(self) -> dict[str, Any]:
        """What is to be thought of its masks, as ``read_told``; nothing where nobody said."""
        return {} if self.damaged else read_told(self.path)

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Messages of some topics in order of recording. May be called again."""
        return map(self.change, self._recorded(topics))

    def _recorded(self, topics: Collection[str]) -> Iterator[BagMessage]:
        if self.damaged:
            for file in storage_files(self.path):
                yield from (m for m in _readable(file) if m.topic in topics)
            return
        with Reader(self.path) as reader:
            chosen = [c for c in reader.connections if c.topic in topics]
            messages = reader.messages(chosen) if chosen else iter(())
            read: Counter[str] = Counter()
            # The readers raise whatever their parser stumbles over.
            try:
                for connection, time_ns, cdr in messages:
                    read[connection.topic] += 1
                    yield unpacked(
                        BagMessage(connection.topic, connection.msgtype, time_ns, bytes(cdr))
                    )
            except Exception as error:
                missing = sum(self.counts[topic] - read[topic] for topic in topics)
                self.lost = f"{self.path} is damaged, {missing} messages are lost: {error}"


def open_bag(path: Path) -> Bag:
    """Find out what a bag holds.

    Raises:
        UserError: not there, not a bag, or nothing in it is whole.
    """
    if not path.exists():
        raise UserError(f"bag {path} does not exist: make one with 'occ-recon import'")
    try:
        with Reader(path) as reader:
            types = {c.topic: c.msgtype for c in reader.connections}
            counts: Counter[str] = Counter()
            for connection in reader.connections:
                counts[connection.topic] += connection.msgcount
    except Exception as error:  # of many kinds: whatever the parser stumbles over
        return _open_damaged(path, error)
    if any(is_cut(file) for file in storage_files(path)):
        return _open_damaged(path, EOFError("the file is cut off"))
    return Bag(path, types, counts)


def _open_damaged(path: Path, reason: Exception) -> Bag:
    files = storage_files(path)
    if not files:
        raise UserError(f"{path} {_no_bag(path)}") from None
    bag = Bag(path, {}, Counter(), damaged=True)
    breaks: list[str] = []
    for file in files:
        for message in _readable(file, breaks):
            bag.types[message.topic] = message.msgtype
            bag.counts[message.topic] += 1
    read = bag.counts.total()
    if not read:
        raise UserError(f"{path} holds no whole message ({reason}): record or copy it again")
    recorded = _recorded_count(path)
    if recorded is not None and recorded > read:
        bag.lost = f"{recorded - read} of {recorded} messages are lost"
    elif breaks:
        bag.lost = f"what came after the first {read} messages is lost"
    if breaks:
        bag.lost += ": " + "; ".join(breaks)
    return bag


def _is_ros1(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(_ROS1)) == _ROS1


def _no_bag(path: Path) -> str:
    """What is wrong with what holds no file of a rosbag2, and what to do."""
    if _is_ros1(path):
        new = path.with_suffix("")
        return (
            f"is a ROS 1 bag: rosbags-convert --src {path} --dst {new} --dst-typestore ros2_jazzy "
            f"makes a rosbag2 of it, {new}"
        )
    packed = [] if path.is_file() else sorted([*path.glob("*.mcap.*"), *path.glob("*.db3.*")])
    if packed:
        names = ", ".join(file.name for file in packed[:3])
        return (
            f"holds {names}, compressed by other means than zstd, or without metadata.yaml: unpack "
            f"it (lz4 -d, zstd -d), and give the {packed[0].suffixes[-2]} file"
        )
    if (path / "cameras.json").exists():
        return f"is a folder of images: make a bag of it first, occ-recon import {path} BAG"
    return "is not a rosbag2: give a folder with metadata.yaml, a .mcap or a .db3 file"


def _readable(file: Path, breaks: list[str] | None = None) -> Iterator[BagMessage]:
    """The whole messages of a file; where it breaks off goes to ``breaks``."""
    count = 0
    try:
        for message in read_until_damage(file):
            count += 1
            yield message
    except Exception as error:
        if breaks is not None:
            why = str(error) or type(error).__name__
            breaks.append(f"{file.name} breaks off after {count} messages ({why})")


def _recorded_count(path: Path) -> int | None:
    """Number of messages that metadata.yaml tells of, if there is one that does."""
    try:
        content = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
        return int(content["rosbag2_bagfile_information"]["message_count"])
    except Exception:  # no metadata is one of the ways a bag is damaged
        return None
