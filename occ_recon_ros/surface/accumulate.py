"""The surface as it grows: one strip a rim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..geometry import Rim, Status
from ..geometry.settings import setting
from .colour import ViewColours
from .growing import GrowingArray
from .path import CameraPath, Step, whole
from .placed import Joined, PlacedRim, mean_known
from .stamps import StampRuns
from .strip import Strip
from .zipping import zip_rims

if TYPE_CHECKING:
    import trimesh

_MOST_LOOSE = 1000  # rims kept that are joined to none (so far)
_FEW = 50_000  # triangles that are not worth clearing up for
_STILL = 2e-4  # of the distance to the object: a camera that moved less has not moved
_TOUCH = 0.05  # of a step: less of it in common with another is an end that they share
_AS_GOOD = 0.9  # of the triangles that are there


@dataclass(frozen=True)
class SurfaceSettings:
    """How rims are joined."""

    longest_step: float = setting(
        8.0,
        "Longest step between neighbours on a rim that is still one piece of "
        "surface, as a multiple of that rim's median step.",
        within=(1.0, 1000.0),
    )


class Surface:
    """Rims joined to strips; vertices and triangles in growing arrays.

    A rim names the frame before it (``prev_stamp_ns``). When both have come, in whatever
    order, the strip between them is made.

    Where the camera passes again, new strips take the place of the old ones that they pass
    over from end to end: a second turn renews the surface, with finer steps it refines it,
    and it stays one layer. A strip that would bring less surface than is there (a coarser
    step, a leap back to the start of a short scan, a rim that is mostly hidden) is left out.
    What is given up is only marked, and swept out when it is as much as what is left.
    Vertices and triangles therefore take at most four times the memory of those of one turn,
    however many turns there are.
    """

    def __init__(
        self, settings: SurfaceSettings | None = None, colours: ViewColours | None = None
    ) -> None:
        """Args: colours: views that give the surface its colour, None for none."""
        self.settings = settings or SurfaceSettings()
        self.colours = colours
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._points = GrowingArray(3, np.float64)
        self._normals = GrowingArray(3, np.float64)
        self._sigma = GrowingArray(0, np.float64)
        self._triangles = GrowingArray(3, np.int64)
        self._alive = GrowingArray(0, np.bool_)
        self._count = 0
        self._path = CameraPath()
        self._strips: dict[int, Joined] = {}
        self._last: PlacedRim | None = None
        self._placed: dict[int, PlacedRim] = {}
        self._loose: dict[int, PlacedRim] = {}
        self._over = StampRuns()
        self._frame_id = ""

    def __len__(self) -> int:
        """Number of triangles."""
        return self._count

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that grow with the surface."""
        arrays = (self._points, self._normals, self._sigma, self._triangles, self._alive)
        return sum(a.nbytes for a in arrays) + sum(p.nbytes for p in self._placed.values())

    @property
    def last_stamp_ns(self) -> int | None:
        """The latest stamp of the rims that it is made of; None without any."""
        return max(self._placed, default=None)

    def __contains__(self, stamp_ns: int) -> bool:
        """Whether a rim of this stamp is part of the surface, or was."""
        return stamp_ns in self._placed or stamp_ns in self._over

    def replaced(self, stamp_ns: int) -> bool:
        """Whether a rim is no longer part of the surface: the camera has passed again."""
        return stamp_ns in self._over

    def add(self, rim: Rim) -> Strip:
        """Join a rim to the one before it, and those to it that waited for it.

        Returns:
            The triangles that were added, perhaps none.

        Raises:
            ValueError: the rim is in another frame than those before, its stamp has come
                before (see ``revise``), or it names itself as the one before it.
        """
        if self._last is not None and rim.frame_id != self._frame_id:
            raise ValueError(f"rim in frame '{rim.frame_id}', surface in '{self._frame_id}'")
        if rim.stamp_ns in self:
            raise ValueError("a rim of this stamp has come before")
        if rim.stamp_ns == rim.prev_stamp_ns:
            raise ValueError("a rim cannot be the one before itself")
        self._frame_id = rim.frame_id
        self._sweep_out()
        before = len(self._triangles)
        followers = [p for p in self._placed.values() if p.prev_stamp_ns == rim.stamp_ns]
        self._last = placed = self._place(rim)
        self._join_to_previous(placed)
        for other in followers:
            self._join(other, placed)
        while len(self._loose) > _MOST_LOOSE:
            self._forget(next(iter(self._loose.values())))
        return self._flat(self._triangles.rows[before:], rim.stamp_ns)

    def revise(self, rim: Rim) -> int:
        """Take a rim anew: points may be given up, moved, or good for the first time, links to
        the rim before given up, and that rim be another (the turn has closed).

        Args:
            rim: of a stamp that was added, with as many rows.

        Returns:
            How many of its points and links have changed; 0 for a rim in whose place there
            are others by now.

        Raises:
            ValueError: no rim of this stamp and number of rows was added.
        """
        if self.replaced(rim.stamp_ns):
            return 0
        placed = self._placed.get(rim.stamp_ns)
        if placed is None or len(placed.vertex) != len(rim):
            raise ValueError("no rim of this stamp with as many rows has come before")
        was, good = placed.vertex >= 0, rim.status == Status.GOOD
        same = was & good
        same[same] = (self._points.rows[placed.vertex[same]] == rim.points[same]).all(axis=1)
        elsewhere = rim.prev_stamp_ns != placed.prev_stamp_ns
        relinked = (np.isfinite(placed.prev) != np.isfinite(rim.prev)) | elsewhere
        if elsewhere:
            self._unjoin(placed)
            placed.prev_stamp_ns = rim.prev_stamp_ns
        if (good & ~same).any() or relinked.any():
            self._renew(placed, rim, good & ~same)
        else:
            self._give_up(placed, was & ~good)
        if elsewhere:
            self._join_to_previous(placed)
        return int(np.count_nonzero((was | good) & ~same | relinked))

    def _give_up(self, placed: PlacedRim, wrong: NDArray[np.bool_]) -> None:
        gone = placed.vertex[wrong]
        for strip in (self._strips[number] for number in placed.strips):
            rows = np.arange(strip.start, strip.end)
            touched = np.isin(self._triangles.rows[rows], gone).any(axis=1)
            self._kill(rows[touched])
        placed.vertex[wrong] = -1

    def _renew(self, placed: PlacedRim, rim: Rim, new: NDArray[np.bool_]) -> None:
        """Give rows of a rim new points, and zip it anew with the same rims."""
        placed.vertex[rim.status != Status.GOOD] = -1
        placed.vertex[new] = self._vertices(rim, new)
        placed.prev = rim.prev.astype(np.float32)
        for number in placed.strips:
            strip = self._strips[number]
            self._kill(np.arange(strip.start, strip.end))
            strip.start, strip.end = self._append(self._zip(*strip.ends))

    def whole(self) -> Strip:
        """The whole surface in the flat form."""
        triangles = self._all_triangles()
        return self._flat(triangles, self._last.stamp_ns if self._last else 0)

    def mesh(self) -> trimesh.Trimesh:
        """The whole surface with shared vertices, those without a triangle left out."""
        import trimesh  # here: nodes that make no mesh start half a second sooner

        used, faces = np.unique(self._all_triangles(), return_inverse=True)
        return trimesh.Trimesh(
            vertices=self._points.rows[used],
            faces=faces.reshape(-1, 3),
            vertex_normals=self._normals.rows[used],
            vertex_colors=self._colours(used),
            process=False,
        )

    def _all_triangles(self) -> NDArray[np.int64]:
        triangles = self._triangles.rows[self._alive.rows]
        # Strips to come use this as well: to renew it for each would cost the more the
        # larger the surface is.
        if self.colours:
            self.colours.hide_behind(self._points.rows[triangles])
        return triangles

    def _colours(self, vertices: NDArray[np.int64]) -> NDArray[np.uint8] | None:
        if not self.colours:
            return None
        return self.colours.of(self._points.rows[vertices], self._normals.rows[vertices])

    def _place(self, rim: Rim) -> PlacedRim:
        good = rim.status == Status.GOOD
        vertex = np.full(len(rim), -1, np.int64)
        vertex[good] = self._vertices(rim, good)
        # NaN without good points: beside nothing then.
        ahead = rim.points[good].sum(axis=0) / max(np.count_nonzero(good), 1) - rim.centre
        placed = PlacedRim(
            stamp_ns=rim.stamp_ns,
            prev_stamp_ns=rim.prev_stamp_ns,
            frame_id=rim.frame_id,
            centre=rim.centre,
            distance=float(np.linalg.norm(ahead)) if good.any() else float("nan"),
            vertex=vertex,
            loop=rim.loop,
            prev=rim.prev.astype(np.float32),
        )
        self._placed[rim.stamp_ns] = self._loose[rim.stamp_ns] = placed
        return placed

    def _vertices(self, rim: Rim, rows: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Numbers of new vertices for the points of some rows."""
        first = len(self._points)
        self._points.append(rim.points[rows])
        self._normals.append(rim.normals[rows])
        self._sigma.append(rim.depth_sigma[rows])
        return np.arange(first, len(self._points))

    def _join_to_previous(self, placed: PlacedRim) -> None:
        if placed.prev_stamp_ns is None:
            return
        previous = self._placed.get(placed.prev_stamp_ns)
        if previous is not None:
            self._join(placed, previous)

    def _join(self, placed: PlacedRim, previous: PlacedRim) -> None:
        """Add the strip between two rims, in the place of those that it passes over, unless
        it brings less than these."""
        ends = (placed, previous)
        step = Step(previous.centre, placed.centre, mean_known(placed.distance, previous.distance))
        if step.length < _STILL * step.distance:
            return
        triangles = self._zip(*ends)
        old, common = self._path.beside(step)
        counts = self._sizes(old)
        part = np.diff(common.theirs, axis=1)[:, 0]
        touched, inside = part > _TOUCH, part >= 1 - _TOUCH
        all_inside = bool((inside | ~touched).all())
        # Where it goes the very way of others it has to bring as much; where the places are
        # others, near enough: else old and new ones would lie side by side.
        there = counts[inside].sum() if all_inside else _AS_GOOD * (part @ counts)
        enough = len(triangles) >= there
        if whole(common.own) and not enough:
            for end in ends:
                self._let_go(end)
            return
        start, stop = self._append(triangles)
        number = self._path.add(step)
        self._strips[number] = Joined(start, stop, ends)
        for end in ends:
            end.strips.append(number)
            self._loose.pop(end.stamp_ns, None)
        for k in np.flatnonzero(touched):
            if (all_inside and enough and inside[k]) or self._outdone(old[k]):
                self._take_out(old[k])

    def _outdone(self, number: int) -> bool:
        """Whether later or finer strips together pass over a strip from end to end and bring
        as much."""
        step = self._path.step(number)
        others, common = self._path.beside(step)
        finer = [k > number or self._path.step(k).length < _AS_GOOD * step.length for k in others]
        share = np.diff(common.theirs, axis=1)[:, 0]
        brought = (share * self._sizes(others))[finer].sum()
        enough = brought >= _AS_GOOD * self._sizes([number])[0]
        return bool(enough) and whole(common.own[finer])

    def _sizes(self, numbers: list[int]) -> NDArray[np.int64]:
        """How many triangles strips have."""
        strips = (self._strips[number] for number in numbers)
        alive = self._alive.rows
        return np.array([np.count_nonzero(alive[s.start : s.end]) for s in strips], np.int64)

    def _zip(self, placed: PlacedRim, previous: PlacedRim) -> NDArray[np.int64]:
        """The triangles between two rims."""
        rim, before = (
            end.recalled(self._points.rows, self._normals.rows) for end in (placed, previous)
        )
        triangles = zip_rims(rim, before, self.settings.longest_step)
        return np.concatenate([placed.vertex, previous.vertex])[triangles]

    def _append(self, triangles: NDArray[np.int64]) -> tuple[int, int]:
        """Add triangles; where they are among all."""
        start = len(self._triangles)
        self._triangles.append(triangles)
        self._alive.append(np.ones(len(triangles), np.bool_))
        self._count += len(triangles)
        return start, start + len(triangles)

    def _unjoin(self, placed: PlacedRim) -> None:
        """Take out the strip to the rim before, if there is one."""
        for number in list(placed.strips):
            if self._strips[number].ends[0] is placed:
                self._take_out(number)

    def _take_out(self, number: int) -> None:
        strip = self._strips.pop(number)
        self._path.remove(number)
        self._kill(np.arange(strip.start, strip.end))
        for end in strip.ends:
            end.strips.remove(number)
            self._let_go(end)

    def _let_go(self, placed: PlacedRim) -> None:
        """Forget a rim in whose place there are others, unless it may still be joined: the
        next to it, or it to the one before, which has not come."""
        if placed.strips or placed.stamp_ns not in self._placed:
            return
        before = placed.prev_stamp_ns
        if placed is self._last or (before is not None and before not in self):
            self._loose[placed.stamp_ns] = placed
        else:
            self._forget(placed)

    def _forget(self, placed: PlacedRim) -> None:
        del self._placed[placed.stamp_ns]
        self._loose.pop(placed.stamp_ns, None)
        self._over.add(placed.stamp_ns, self._placed)

    def _kill(self, rows: NDArray[np.intp]) -> None:
        alive = self._alive.rows
        self._count -= int(np.count_nonzero(alive[rows]))
        alive[rows] = False

    def _sweep_out(self) -> None:
        """Drop what was given up, once it is as much as what is left."""
        alive = self._alive.rows.copy()
        if len(alive) - self._count <= max(self._count, _FEW):
            return
        place = np.concatenate([[0], np.cumsum(alive)])
        for strip in self._strips.values():
            strip.start, strip.end = int(place[strip.start]), int(place[strip.end])
        self._triangles.keep(alive)
        self._alive.keep(alive)
        used = np.zeros(len(self._points) + 1, bool)
        for placed in self._placed.values():
            used[placed.vertex] = True
        used = used[:-1]
        number = np.append(np.cumsum(used) - 1, -1)
        for array in (self._points, self._normals, self._sigma):
            array.keep(used)
        self._triangles.rows[:] = number[self._triangles.rows]
        for placed in self._placed.values():
            placed.vertex = number[placed.vertex]

    def _flat(self, triangles: NDArray[np.int64], stamp_ns: int) -> Strip:
        rgb = None
        if self.colours:
            used, corner = np.unique(triangles, return_inverse=True)
            colours = self._colours(used)
            rgb = None if colours is None else colours[corner.reshape(-1, 3)]
        return Strip(
            stamp_ns=stamp_ns,
            frame_id=self._frame_id,
            corners=self._points.rows.take(triangles, axis=0).astype(np.float32),
            normals=self._normals.rows.take(triangles, axis=0).astype(np.float32),
            depth_sigma=self._sigma.rows.take(triangles).astype(np.float32),
            rgb=rgb,
        )
