"""What a node heard of a scan, kept on disk, so that it can go on after a crash.

A node that hears the same messages again ends in the same state. So the checkpoint is the
messages themselves, each appended once: the cost of a frame does not grow with the scan, and
nothing of the insides of a node is written. A record is whole or it does not count (its CRC
tells), and what a killed process has written stays.
"""

import errno
import fcntl
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from occ_recon_ros.errors import SettingsError

_MAGIC = b"occ_recon checkpoint 2 "
_RECORD = struct.Struct("<II")  # length and CRC-32 of the bytes that follow


class CheckpointFile:
    """The serialised messages of one scan in one file.

    Args:
        path: the file. One that is there is gone on with if ``resume``, else it is kept
            beside it as ``.previous``.
        node: name of the node it belongs to.
        every: after so many messages they are forced onto the disk. A killed process loses
            none; a power cut loses at most these.
        resume: go on with the scan in the file.

    Attributes:
        messages: how many it holds.
        lost: a sentence on what could not be read, "" if nothing is missing.

    Raises:
        SettingsError: the file is none of this node, is in use, or cannot be written.
    """

    def __init__(self, path: Path, node: str, every: int, resume: bool) -> None:
        self.path = path.expanduser().absolute()
        self.messages = 0
        self.lost = ""
        self._every = every
        self._previous = self.path.with_name(f"{self.path.name}.previous")
        self._header = _MAGIC + node.encode() + b"\n"
        self._end = len(self._header)
        try:
            self._file = self._open(resume)
        except OSError as error:
            raise SettingsError(f"checkpoint {self.path}: {error.strerror}") from None

    def _open(self, resume: bool) -> BinaryIO:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        known = self.path.exists() and self.path.stat().st_size > 0
        # Held open as long as the node lives.
        file = open(self.path, "r+b" if known else "w+b", buffering=0)  # noqa: SIM115
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise SettingsError(f"checkpoint {self.path} is in use by another node") from None
        if known and resume:
            self._refuse_foreign(file)
            return file
        if known:
            self.path.replace(self._previous)
            file.close()
            return self._open(resume)
        file.write(self._header)
        _sync(file, self.path.parent)
        return file

    def _refuse_foreign(self, file: BinaryIO) -> None:
        if file.read(len(self._header)) != self._header:
            file.close()
            name = self._header[len(_MAGIC) :].decode().strip()
            raise SettingsError(f"{self.path} is not a checkpoint of {name}, or of another version")

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return os.fstat(self._file.fileno()).st_size

    def read_share(self, size: int) -> float:
        """How much of so many bytes has been read."""
        return self._end / max(size, 1)

    def read(self) -> Iterator[bytes]:
        """The messages, in the order they came; to be read to the end before ``append``.

        What follows the last whole one (a write that a power cut broke off) is cut away.
        """
        self._file.seek(self._end)
        size = os.fstat(self._file.fileno()).st_size
        while (message := self._next()) is not None:
            self.messages += 1
            yield message
        if self._end < size:
            self.lost = (
                f"{self.path}: what came after the first {self.messages} messages is not whole "
                "and is lost"
            )
            self._file.truncate(self._end)
        self._file.seek(self._end)

    def _next(self) -> bytes | None:
        head = self._file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return None
        length, crc = _RECORD.unpack(head)
        message = self._file.read(length)
        if not length or len(message) < length or zlib.crc32(message) != crc:
            return None
        self._end += _RECORD.size + length
        return bytes(message)

    def append(self, message: bytes) -> None:
        """Add a message.

        Raises:
            OSError: it cannot be written; the file is as before.
        """
        record = _record(message)
        try:
            _write(self._file, record)
            self.messages += 1
            if self.messages % self._every == 0:
                os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            raise
        self._end += len(record)

    def clear(self) -> None:
        """A new scan begins; the one before is kept beside it as ``.previous``."""
        if self.messages:
            self.rotate()

    def ends_with(self, message: bytes) -> bool:
        """Whether the last message is this one."""
        record = _record(message)
        self._file.seek(max(self.size - len(record), 0))
        return bool(self._file.read(len(record)) == record)

    def rotate(self) -> None:
        """Begin anew; what is there is kept beside it as ``.previous``."""
        old = self._file
        self.path.replace(self._previous)
        self._file = self._open(resume=False)
        old.close()
        self._end, self.messages = len(self._header), 0

    def compact(self, needed: Callable[[bytes], bool]) -> None:
        """Leave out what a resumed node would only forget again.

        Args:
            needed: whether a message is still of use.

        Raises:
            OSError: it cannot be written; the file is as before.
        """
        path = self.path.with_name(f"{self.path.name}.new")
        kept, end = 0, len(self._header)
        try:
            with open(path, "w+b", buffering=0) as file:
                file.write(self._header)
                for message in self._records():
                    if needed(message):
                        _write(file, _record(message))
                        kept, end = kept + 1, end + _RECORD.size + len(message)
                os.fsync(file.fileno())
                fcntl.flock(file, fcntl.LOCK_EX)
                handle = os.dup(file.fileno())  # the lock goes with it
            path.replace(self.path)
        except OSError:
            path.unlink(missing_ok=True)
            self._file.seek(self._end)
            raise
        self._file.close()
        self._file = os.fdopen(handle, "r+b", buffering=0)
        self.messages, self._end = kept, end
        self._file.seek(self._end)

    def _records(self) -> Iterator[bytes]:
        """All whole messages of the file, from the start."""
        self._file.seek(len(self._header))
        for _ in range(self.messages):
            length, _crc = _RECORD.unpack(self._file.read(_RECORD.size))
            yield bytes(self._file.read(length))

    def sync(self) -> None:
        """Force onto the disk what is there."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let go of the file."""
        if not self._file.closed:
            self._file.close()


def _record(message: bytes) -> bytes:
    return _RECORD.pack(len(message), zlib.crc32(message)) + message


def _write(file: BinaryIO, record: bytes) -> None:
    if file.write(record) != len(record):
        raise OSError(errno.ENOSPC, "the disk is full")


def _sync(file: BinaryIO, folder: Path) -> None:
    """Force a new file, and its name, onto the disk."""
    os.fsync(file.fileno())
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
