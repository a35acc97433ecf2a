"""The growing surface in pieces, so that a page is sent what is new and no more."""

from collections.abc import Iterator
from dataclasses import dataclass

from ..surface import Strip
from .patch import Patch, joined, merged

_PIECES = 16
"""So many pieces of one size become one piece of the next: the page then draws few things,
and each triangle is sent again but once for each size."""
_GROWTH = 0.25
"""Share of the whole that may come in pieces before the whole is sent again: for each new
triangle 1 / 0.25 = 4 old ones at most are then sent, however long the scan is."""
_QUIET_S = 1.0


@dataclass(frozen=True)
class Change:
    """A piece to be shown under a name, or taken away if it is None."""

    name: str
    patch: Patch | None


class LiveSurface:
    """Strips as they come, and now and then the whole surface in their place.

    Strips show at once what is new; the whole is what the surface is after rims were taken
    back, or a second turn has renewed it.
    """

    def __init__(self) -> None:
        self.whole: Patch | None = None
        self._mesh: Strip | None = None
        self._waiting: list[Patch] = []
        self._shown: dict[str, Patch] = {}
        self._gone: list[str] = []
        self._last_strip_s = float("-inf")
        self._turns = 0

    def add(self, patch: Patch, now_s: float) -> None:
        """A strip has come."""
        self._last_strip_s = now_s
        if len(patch):
            self._waiting.append(patch)

    def replace(self, mesh: Strip) -> None:
        """The whole surface has come; empty: there is none any more."""
        self._mesh = mesh

    def clear(self) -> None:
        """A new scan begins."""
        self._gone += self._shown
        self._shown, self._waiting = {}, []
        self.whole = self._mesh = None

    def latest(self) -> Patch | None:
        """The whole surface as it came last, or the strips so far; None if there are none."""
        if self._mesh is not None and len(self._mesh):
            return merged(self._mesh)
        strips = [*self._shown.values(), *self._waiting]
        return self.whole or (joined(strips) if strips else None)

    def changes(self, now_s: float) -> Iterator[Change]:
        """What has to change on the page since this was last asked."""
        yield from (Change(name, None) for name in self._gone)
        self._gone = []
        if self._mesh is not None and self._whole_is_due(now_s):
            yield from self._show_whole(self._mesh)
            self._mesh = None
        elif self._waiting:
            patch, self._waiting = joined(self._waiting), []
            yield from self._show_piece(patch, 0)

    def again(self) -> Iterator[Change]:
        """All that is shown, to be shown anew."""
        yield from (Change(name, patch) for name, patch in self._shown.items())

    def _whole_is_due(self, now_s: float) -> bool:
        if self.whole is None or self._mesh is None or not len(self._mesh):
            return True
        pieces = [p for name, p in self._shown.items() if name.startswith("piece")]
        triangles = sum(map(len, pieces + self._waiting))
        quiet = now_s - self._last_strip_s >= _QUIET_S
        return quiet or triangles >= _GROWTH * len(self.whole)

    def _show_piece(self, patch: Patch, size: int) -> Iterator[Change]:
        names = [f"piece_{size}_{k}" for k in range(_PIECES)]
        free = next((name for name in names if name not in self._shown), None)
        if free is not None:
            yield self._show(free, patch)
            return
        # The large one first, so that there is no moment without them.
        yield from self._show_piece(joined([*(self._shown[n] for n in names), patch]), size + 1)
        for name in names:
            del self._shown[name]
            yield Change(name, None)

    def _show_whole(self, mesh: Strip) -> Iterator[Change]:
        # Pieces of rims that are not in it yet stay. The old whole goes last, so that
        # there is no moment without any.
        before = [
            name
            for name, patch in self._shown.items()
            if name.startswith("whole") or patch.stamp_ns <= mesh.stamp_ns or not len(mesh)
        ]
        self._waiting = [p for p in self._waiting if p.stamp_ns > mesh.stamp_ns and len(mesh)]
        self.whole = merged(mesh) if len(mesh) else None
        if self.whole is not None:
            self._turns += 1
            yield self._show(f"whole_{self._turns % 2}", self.whole)
        for name in before:
            if self.whole is None or name != f"whole_{self._turns % 2}":
                del self._shown[name]
                yield Change(name, None)

    def _show(self, name: str, patch: Patch) -> Change:
        self._shown[name] = patch
        return Change(name, patch)
