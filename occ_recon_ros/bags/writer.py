"""Writing a rosbag2, all of it or nothing."""

import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_typestore

from msg_adapters import serialise
from occ_recon_ros.errors import UserError, writing
from occ_recon_ros.streams.topics import TYPE_NAMES

from .image_names import KEY, names_text
from .places import work_beside
from .told_of_masks import KEY as MASKS
from .told_of_masks import told_text

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}


class BagWriter:
    """Takes messages; made by ``new_bag``.

    Attributes:
        counts: of the messages, by topic.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self.counts: Counter[str] = Counter()

    def put(self, topic: str, message: Any, stamp_ns: int) -> None:
        """Append one message of a topic of the nodes."""
        self.write(topic, TYPE_NAMES[topic], stamp_ns, serialise(message))

    def write(self, topic: str, msgtype: str, stamp_ns: int, cdr: bytes) -> None:
        """Append one serialised message; a topic is declared by its first."""
        self.counts[topic] += 1
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=self._typestore
            )
        self._writer.write(self._connections[topic], stamp_ns, cdr)

    def name_images(self, names: Mapping[int, str]) -> None:
        """Say which files images came from, by stamp (ns): once, all of them."""
        if names:
            self._writer.set_custom_data(KEY, names_text(names))

    def tell_of_masks(self, told: Mapping[str, Any]) -> None:
        """Say what is to be thought of the masks, as ``read_told`` reads it: once."""
        if told:
            self._writer.set_custom_data(MASKS, told_text(told))

    def flush(self) -> None:
        """Put what is written so far where it stays if this process is killed."""
        storage = self._writer.storage
        if isinstance(storage, McapWriter):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
        elif isinstance(storage, Sqlite3Writer):
            storage.conn.commit()


def choose_storage(path: Path, storage: str | None) -> str:
    """Storage of a new bag: as asked for, else by the suffix of its name, else mcap.

    Raises:
        UserError: an unknown storage, or one that contradicts the suffix.
    """
    by_suffix = {suffix: name for name, suffix in SUFFIXES.items()}.get(path.suffix)
    if storage is not None and storage not in STORAGES:
        raise UserError(f"unknown storage '{storage}': use one of {', '.join(STORAGES)}")
    if storage and by_suffix and storage != by_suffix:
        raise UserError(f"{path.name} names a {by_suffix} file: leave --storage {storage} out")
    return storage or by_suffix or "mcap"


def refuse_bag(path: Path, storage: str, overwrite: bool) -> None:
    """Keep a bag that is there, if nobody has said that it may be replaced, and all else.

    Raises:
        UserError: the path exists (unless ``overwrite``, and then only if it is a bag).
    """
    if not path.exists():
        return
    if not overwrite:
        raise UserError(f"{path} exists already: choose another name or add --overwrite")
    single_file = path.suffix == SUFFIXES[storage]
    if path.is_dir() if single_file else not (path / "metadata.yaml").is_file():
        raise UserError(f"{path} exists and is not such a bag: choose another name")


@contextmanager
def new_bag(path: Path, storage: str, overwrite: bool = False) -> Iterator[BagWriter]:
    """A bag that appears under its name when the block ends well, and not before.

    A path that ends in .mcap or .db3 becomes that one file, as every reader takes it; any
    other becomes a folder with metadata.yaml, as ``ros2 bag record`` writes it.

    Raises:
        UserError: as ``refuse_bag``, or it cannot be written.
    """
    single_file = path.suffix == SUFFIXES[storage]
    refuse_bag(path, storage, overwrite)
    with work_beside(path, ".part") as work:
        folder = work / path.name
        with Writer(folder, version=9, storage_plugin=STORAGES[storage]) as writer:
            yield BagWriter(writer)
        if single_file:
            next(folder.glob(f"*{SUFFIXES[storage]}")).replace(path)
        else:
            _put(folder, path)


@contextmanager
def growing_bag(path: Path, storage: str, overwrite: bool = False) -> Iterator[BagWriter]:
    """A bag that is there from the first message on: what a killed process has flushed stays.

    An .mcap file or a folder has its name at once; a .db3 file, which has its journal beside
    it, is in a folder NAME.part until it is whole. A block that ends with a UserError leaves
    everything as it was; one that fails otherwise (a full disk) leaves what was written.

    Raises:
        UserError: as ``new_bag``.
    """
    single_file = path.suffix == SUFFIXES[storage]
    folder = path.with_name(f"{path.name}.part") if single_file else path
    if folder != path and folder.exists():
        raise UserError(f"{folder} is what an interrupted recording left: move it away")
    refuse_bag(path, storage, overwrite)
    replaced = path.with_name(f"{path.name}.replaced")
    with writing(path.parent):
        if path.exists():
            path.rename(replaced)
        path.parent.mkdir(parents=True, exist_ok=True)
        writer = Writer(folder, version=9, storage_plugin=STORAGES[storage])
        writer.open()
    (file,) = folder.glob(f"*{SUFFIXES[storage]}")
    if single_file and storage == "mcap":
        file = file.replace(path)
    try:
        yield BagWriter(writer)
    except UserError:
        writer.abort()
        _remove(folder)
        _remove(path)
        if replaced.exists():
            replaced.rename(path)
        raise
    finally:
        if writer.storage is not None:
            writer.close()
    if single_file:
        file.replace(path)
        _remove(folder)
    _remove(replaced)


def _put(folder: Path, path: Path) -> None:
    """Put a folder in the place of another. Whatever comes between, one of them is there."""
    with work_beside(path, ".replaced") as beside:
        old = beside / path.name
        try:
            if path.exists():
                path.rename(old)
            folder.rename(path)
        finally:
            if old.exists() and not path.exists():
                old.rename(path)


def _remove(path: Path) -> None:
    """A bag of ours, file or folder."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
