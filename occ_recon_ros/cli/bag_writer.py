"""Writing a rosbag2, all of it or nothing."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .errors import UserError

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}


class BagWriter:
    """Takes serialised messages; made by ``new_bag``."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}

    def write(self, topic: str, msgtype: str, stamp_ns: int, cdr: bytes) -> None:
        """Append one message; a topic is declared by its first."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=self._typestore
            )
        self._writer.write(self._connections[topic], stamp_ns, cdr)


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


@contextmanager
def new_bag(path: Path, storage: str, overwrite: bool = False) -> Iterator[BagWriter]:
    """A bag that appears under its name when the block ends well, and not before.

    A path that ends in .mcap or .db3 becomes that one file, as every reader takes it; any
    other becomes a folder with metadata.yaml, as ``ros2 bag record`` writes it.

    Raises:
        UserError: the path exists (unless ``overwrite``, and then only if it is a bag), or
            cannot be written.
    """
    single_file = path.suffix == SUFFIXES[storage]
    _refuse_existing(path, single_file, overwrite)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    except OSError as error:
        raise UserError(f"cannot write to {path.parent}: {error.strerror}") from None
    try:
        folder = work / path.name
        with Writer(folder, version=9, storage_plugin=STORAGES[storage]) as writer:
            yield BagWriter(writer)
        if single_file:
            next(folder.glob(f"*{SUFFIXES[storage]}")).replace(path)
        else:
            if path.exists():
                path.rename(work / "replaced")
            folder.rename(path)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _refuse_existing(path: Path, single_file: bool, overwrite: bool) -> None:
    if not path.exists():
        return
    if not overwrite:
        raise UserError(f"{path} exists already: choose another name or add --overwrite")
    if path.is_dir() if single_file else not (path / "metadata.yaml").is_file():
        raise UserError(f"{path} exists and is not such a bag: choose another name")
