"""What the file system itself tells of changes in folders: Linux' inotify."""

import ctypes
import os
import struct
from pathlib import Path

_MODIFY, _MOVED_FROM, _MOVED_TO, _CREATE, _DELETE = 0x2, 0x40, 0x80, 0x100, 0x200
_CHANGES = _MODIFY | _MOVED_FROM | _MOVED_TO | _CREATE | _DELETE
_EVENT = struct.Struct("iIII")
_libc = ctypes.CDLL(None, use_errno=True)


class FileChanges:
    """From now on, whatever is written, made, moved or deleted in some folders (not below them),
    by whomever."""

    def __init__(self, *folders: Path) -> None:
        self._handle = _libc.inotify_init1(os.O_NONBLOCK)
        self._folders: dict[int, Path] = {}
        for folder in folders:
            watch = _libc.inotify_add_watch(self._handle, os.fsencode(folder), _CHANGES)
            if watch < 0:
                raise OSError(ctypes.get_errno(), f"{folder} cannot be watched")
            self._folders[watch] = folder

    def seen(self) -> set[Path]:
        """The files and folders that have changed so far."""
        paths = set()
        while True:
            try:
                data = os.read(self._handle, 65536)
            except BlockingIOError:
                return paths
            at = 0
            while at < len(data):
                watch, _, _, length = _EVENT.unpack_from(data, at)
                at += _EVENT.size
                name = data[at : at + length].rstrip(b"\0")
                at += length
                if watch in self._folders:
                    paths.add(self._folders[watch] / os.fsdecode(name))

    def close(self) -> None:
        """Watch no longer."""
        os.close(self._handle)
