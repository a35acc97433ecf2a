"""The files of scans: a folder a scan, in one place and nowhere else."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from ..errors import SettingsError
from ..surface import exported, write_whole
from .body_process import Body

if TYPE_CHECKING:
    import trimesh

_MOST_OWED = 6  # those of three scans
_MOST_GIVEN_UP = 0.5  # of the triangles, by rims that come again: of more, one side is wrong

NAMES = ("mesh", "closed")
"""The surfaces of a scan."""


def check_name(name: str) -> str:
    """A name that is a folder in another and never anything else; "" for one by the clock.

    Raises:
        ValueError: it could lead elsewhere.
    """
    if name in (".", "..") or any(c in name for c in "/\\\0") or len(name.encode()) > 200:
        raise ValueError(f"scan_name: must be a plain name without a path, got {name!r}")
    return name


@dataclass(frozen=True, eq=False)
class Result:
    """What a scan has come to: its surfaces belong together, and are kept or replaced together.

    Attributes:
        scan_id: the scan's name, that of its folder.
    """

    scan_id: str


@dataclass(frozen=True, eq=False)
class Strips:
    """The strips of a scan as they were at a time.

    Attributes:
        mesh: all of them; None where there is no triangle.
        frames: rims that they were made of.
        remark: what is to be said of them, in words; "" for nothing.
    """

    mesh: trimesh.Trimesh | None
    frames: int
    remark: str = ""

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.mesh.faces) if self.mesh is not None else 0

    def unless_given_up(self, after: Strips) -> Strips:
        """Those after rims came again, but these where most of them were given up for those."""
        if len(after) >= _MOST_GIVEN_UP * len(self):
            return after
        left = f"{len(self) - len(after)} of these triangles contradict the last views"
        return replace(self, remark=f"the strips are those before the last rims: {left}")


class ScanFiles:
    """Writes the surfaces of scans.

    Args:
        folder: that holds a folder a scan; ~ is the home folder. It is made when needed.
        suffix: format of the surfaces, as ``SUFFIXES`` has them.

    Raises:
        SettingsError: it is not a folder.
    """

    def __init__(self, folder: str, suffix: str) -> None:
        self.folder = Path(folder).expanduser().absolute()
        self.suffix = suffix
        self._there: dict[str, deque[Result]] = {}  # in a scan's folder: the last, that before
        self._owed: deque[tuple[Result, str, Callable[[], bytes]]] = deque(maxlen=_MOST_OWED)
        self._lock = Lock()
        if not folder or (self.folder.exists() and not self.folder.is_dir()):
            raise SettingsError(
                f"output_dir: {self.folder if folder else repr(folder)} is no folder"
            )

    def unwritable(self) -> str:
        """What keeps all files from being written, "" for nothing."""
        places = (self.folder, *self.folder.parents)
        there = next(place for place in places if os.path.exists(place))
        if os.access(there, os.W_OK | os.X_OK):
            return ""
        return f"output_dir: {there} cannot be written into: no scan can be saved"

    def taken(self, scan_id: str) -> bool:
        """Whether a scan of that name has files."""
        return (self.folder / scan_id).exists()

    def path(self, scan_id: str, name: str) -> Path:
        """Where a surface of a scan is, or goes."""
        return self.folder / check_name(scan_id) / f"{name}{self.suffix}"

    def write(self, result: Result, name: str, data: bytes) -> Path:
        """Write a surface, one of ``NAMES``, whole or not at all. It takes the place of one of
        the same result. Those of another are kept, together, as NAME.previous; what comes late
        goes beside them. From any thread.

        Raises:
            OSError: it cannot be written; names the file or folder.
        """
        with self._lock:
            path = self.path(result.scan_id, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            there = self._there.setdefault(result.scan_id, deque(maxlen=2))
            if result not in there:
                self._keep_previous(result.scan_id)
                there.appendleft(result)
            path = path if there[0] is result else _previous(path)
            return write_whole(path, data, overwrite=True)

    def writer(self, result: Result, strips: Strips, body: Body) -> Callable[[], str]:
        """What writes the strips, if there are some, and the closed body if there is one; it
        returns what was written, in words. To be called from any thread."""

        def write() -> str:
            words = []
            if strips.mesh is not None:
                path = self.write(result, "mesh", exported(strips.mesh, self.suffix))
                words.append(f"{path}: {len(strips)} triangles from {strips.frames} rims")
            if body.data:
                closed = self.write(result, "closed", body.data)
                words.append(f"{closed}: watertight, {body.triangles} triangles")
            return "; ".join(words)

        return write

    def write_or_owe(self, result: Result, name: str, data: Callable[[], bytes]) -> Path:
        """Write a surface of a scan that is over, or keep it until there is room.

        Raises:
            OSError, MemoryError: it waits now.
        """
        try:
            return self.write(result, name, data())
        except (OSError, MemoryError):
            self._owed.append((result, name, data))
            raise

    def write_owed(self) -> Path:
        """Write the first of those that wait.

        Raises:
            OSError, MemoryError: it waits on, behind the others.
        """
        self._owed.rotate(-1)
        result, name, data = self._owed[-1]
        path = self.write(result, name, data())
        self._owed.pop()
        return path

    @property
    def waiting(self) -> int:
        """How many files wait."""
        return len(self._owed)

    @property
    def owed(self) -> int:
        """How many scans have files that wait."""
        return len({result for result, _, _ in self._owed})

    def _keep_previous(self, scan_id: str) -> None:
        paths = [self.path(scan_id, name) for name in NAMES]
        if not any(path.exists() for path in paths):
            return
        for path in paths:
            if path.exists():
                path.replace(_previous(path))
            else:  # that one is of another scan than what is kept now
                _previous(path).unlink(missing_ok=True)


def _previous(path: Path) -> Path:
    return path.with_name(f"{path.stem}.previous{path.suffix}")
