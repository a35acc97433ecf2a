"""What is whole in a bag file that breaks off (full disk, lost power, half a copy)."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.reader import NonSeekingReader

_ZSTD = b"\x28\xb5\x2f\xfd"  # no serialised message begins so


class BagMessage(NamedTuple):
    """One message as recorded: time of recording in nanoseconds, serialised message."""

    topic: str
    msgtype: str
    time_ns: int
    cdr: bytes


def storage_files(path: Path) -> list[Path]:
    """The storage files of a bag in order of recording, whether it has metadata or not."""
    if path.is_file():
        return [path] if path.suffix in (".mcap", ".db3") else []
    found = [*path.glob("*.mcap"), *path.glob("*.db3")]
    return sorted(found, key=lambda file: (_number_at_end(file), file.name))


def is_cut(file: Path) -> bool:
    """Whether an SQLite file is shorter than its header says.

    SQLite may notice only when it comes to the missing pages. mcap needs no such look: its
    index stands at the end.
    """
    if file.suffix != ".db3":
        return False
    with file.open("rb") as stream:
        header = stream.read(100)
    page = int.from_bytes(header[16:18], "big")
    return file.stat().st_size < (65536 if page == 1 else page) * int.from_bytes(
        header[28:32], "big"
    )


def read_until_damage(file: Path) -> Iterator[BagMessage]:
    """Messages in the order they were written, up to the first that is not whole.

    Raises:
        Exception: of many kinds, by the two libraries, where the file breaks off.
    """
    yield from map(unpacked, _read_sqlite3(file) if file.suffix == ".db3" else _read_mcap(file))


def unpacked(message: BagMessage) -> BagMessage:
    """The message, where it is compressed by itself as it was before: of that metadata.yaml alone
    tells, which may be lost."""
    if not message.cdr.startswith(_ZSTD):
        return message
    return message._replace(
        cdr=zstandard.ZstdDecompressor().decompressobj().decompress(message.cdr)
    )


def _read_mcap(file: Path) -> Iterator[BagMessage]:
    with file.open("rb") as stream:
        reader = NonSeekingReader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            msgtype = schema.name if schema is not None else ""
            yield BagMessage(channel.topic, msgtype, message.log_time, message.data)


def _read_sqlite3(file: Path) -> Iterator[BagMessage]:
    connection = sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)
    try:
        # Without it SQLite refuses a file that is shorter than its header says.
        connection.execute("PRAGMA writable_schema = ON")
        rows = connection.execute("SELECT id, name, type FROM topics").fetchall()
        topics = {row[0]: row[1:] for row in rows}
        query = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        for topic, time_ns, cdr in connection.execute(query):
            name, msgtype = topics[topic]
            yield BagMessage(name, msgtype, time_ns, cdr)
    finally:
        connection.close()


def _number_at_end(file: Path) -> int:
    digits = file.stem.rpartition("_")[2]
    return int(digits) if digits.isdigit() else 0
