"""The surface as it grows: one strip a rim."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..geometry import Rim, Status
from .colour import ViewColours
from .growing import GrowingArray
from .path import CameraPath, rim_centre
from .strip import Strip
from .zipping import zip_rims

_MOST_WAITING = 8  # rims kept whose previous rim has not come
_FEW = 50_000  # triangles that are not worth clearing up for


@dataclass(frozen=True)
class SurfaceSettings:
    """How rims are joined."""

    longest_step: float = field(
        default=8.0,
        metadata={
            "doc": "Longest step between neighbours on a rim that is still one piece of "
            "surface, as a multiple of that rim's median step.",
            "low": 1.0,
            "high": 1000.0,
        },
    )


class Surface:
    """Rims joined to strips; vertices and triangles in growing arrays.

    A rim names the frame before it (``prev_stamp_ns``). When that rim has come, the
    strip between them is made. The first rim of a scan waits for its own: that of the
    frame before comes last, when the turn is finished.

    Where the camera passes again, the new strips take the place of the old ones: a second
    turn renews the surface, with finer steps it refines it, and it stays one layer. What is
    given up is only marked, and swept out when it is as much as what is left. Vertices and
    triangles therefore take at most four times the memory of those of one turn, however
    many turns there are.
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
        self._strips: dict[int, _Joined] = {}
        self._last: _Placed | None = None
        self._waiting: list[_Placed] = []
        self._placed: dict[int, _Placed] = {}
        self._replaced: set[int] = set()
        self._frame_id = ""

    def __len__(self) -> int:
        """Number of triangles."""
        return self._count

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that grow with the surface."""
        arrays = (self._points, self._normals, self._sigma, self._triangles, self._alive)
        return sum(a.nbytes for a in arrays) + sum(p.nbytes for p in self._placed.values())

    def add(self, rim: Rim) -> Strip:
        """Join a rim to the one before it, and to one that waited for it.

        Returns:
            The triangles that were added, perhaps none.

        Raises:
            ValueError: the rim is in another frame than those before, or its stamp has
                come before (see ``revise``).
        """
        if self._last is not None and rim.frame_id != self._frame_id:
            raise ValueError(f"rim in frame '{rim.frame_id}', surface in '{self._frame_id}'")
        self._frame_id = rim.frame_id
        if rim.stamp_ns in self._placed or rim.stamp_ns in self._replaced:
            raise ValueError("a rim of this stamp has come before")
        self._sweep_out()
        placed = self._place(rim)
        before = len(self._triangles)
        last = self._last
        self._last = placed
        if last is not None and rim.prev_stamp_ns in (0, last.stamp_ns):
            self._join(placed, last)
        elif rim.prev_stamp_ns:
            self._waiting.append(placed)
            if len(self._waiting) > _MOST_WAITING:
                self._let_go(self._waiting.pop(0))
        for other in [w for w in self._waiting if w.waits_for == rim.stamp_ns]:
            self._waiting.remove(other)
            self._join(other, placed)
        return self._flat(self._triangles.rows[before:], rim.stamp_ns)

    def revise(self, rim: Rim) -> int:
        """Take a rim anew: points may be given up, moved, or good for the first time, and
        links to the rim before given up.

        Args:
            rim: of a stamp that was added, with as many rows.

        Returns:
            How many of its points and links have changed; 0 for a rim in whose place there
            are others by now.

        Raises:
            ValueError: no rim of this stamp and number of rows was added.
        """
        if rim.stamp_ns in self._replaced:
            return 0
        placed = self._placed.get(rim.stamp_ns)
        if placed is None or len(placed.vertex) != len(rim):
            raise ValueError("no rim of this stamp with as many rows has come before")
        was, good = placed.vertex >= 0, rim.status == Status.GOOD
        same = was & good
        same[same] = (self._points.rows[placed.vertex[same]] == rim.points[same]).all(axis=1)
        relinked = np.isfinite(placed.prev) != np.isfinite(rim.prev)
        if placed.rim is not None:
            placed.rim = rim
        if (good & ~same).any() or relinked.any():
            self._renew(placed, rim, good & ~same)
        else:
            self._give_up(placed, was & ~good)
        return int(np.count_nonzero((was | good) & ~same | relinked))

    def _give_up(self, placed: _Placed, wrong: NDArray[np.bool_]) -> None:
        gone = placed.vertex[wrong]
        for strip in (self._strips[number] for number in placed.strips):
            rows = np.arange(strip.start, strip.end)
            touched = np.isin(self._triangles.rows[rows], gone).any(axis=1)
            self._kill(rows[touched])
        placed.vertex[wrong] = -1

    def _renew(self, placed: _Placed, rim: Rim, new: NDArray[np.bool_]) -> None:
        """Give rows of a rim new points, and zip it anew with the same rims."""
        placed.vertex[rim.status != Status.GOOD] = -1
        placed.vertex[new] = self._vertices(rim, new)
        placed.prev = rim.prev.astype(np.float32)
        for number in placed.strips:
            strip = self._strips[number]
            self._kill(np.arange(strip.start, strip.end))
            strip.start, strip.end = self._zip(*strip.ends)

    def replaced(self, stamp_ns: int) -> bool:
        """Whether a rim is no longer part of the surface: the camera has passed again."""
        return stamp_ns in self._replaced

    def whole(self) -> Strip:
        """The whole surface in the flat form."""
        triangles = self._all_triangles()
        return self._flat(triangles, self._last.stamp_ns if self._last else 0)

    def mesh(self) -> trimesh.Trimesh:
        """The whole surface with shared vertices, those without a triangle left out."""
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

    def _place(self, rim: Rim) -> _Placed:
        good = rim.status == Status.GOOD
        vertex = np.full(len(rim), -1, np.int64)
        vertex[good] = self._vertices(rim, good)
        prev = rim.prev.astype(np.float32)
        placed = _Placed(rim, rim.stamp_ns, rim_centre(rim), vertex, rim.loop, prev)
        self._placed[rim.stamp_ns] = placed
        return placed

    def _vertices(self, rim: Rim, rows: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Numbers of new vertices for the points of some rows."""
        first = len(self._points)
        self._points.append(rim.points[rows])
        self._normals.append(rim.normals[rows])
        self._sigma.append(rim.depth_sigma[rows])
        return np.arange(first, len(self._points))

    def _join(self, placed: _Placed, previous: _Placed) -> None:
        """Add the strip between two rims, in the place of those that it passes over."""
        if placed.rim is None or previous.rim is None:
            return
        passed = self._path.passed_again(previous.centre, placed.centre)
        ends = (placed, previous)
        start, stop = self._zip(*ends)
        number = self._path.add(previous.centre, placed.centre)
        self._strips[number] = _Joined(start, stop, ends)
        for end in ends:
            end.strips.append(number)
        for other in passed:
            self._take_out(other)
        for end in ends:
            self._let_go(end)

    def _zip(self, placed: _Placed, previous: _Placed) -> tuple[int, int]:
        """Add the triangles between two rims; where they are among all."""
        rim, before = (end.rim or self._recalled(end) for end in (placed, previous))
        triangles = zip_rims(rim, before, self.settings.longest_step)
        start = len(self._triangles)
        self._triangles.append(np.concatenate([placed.vertex, previous.vertex])[triangles])
        self._alive.append(np.ones(len(triangles), np.bool_))
        self._count += len(triangles)
        return start, start + len(triangles)

    def _recalled(self, placed: _Placed) -> Rim:
        """A rim that was let go, as far as the surface has it: its good points and how they
        link."""
        good = placed.vertex >= 0
        points, normals = np.full((2, len(good), 3), np.nan)
        points[good] = self._points.rows[placed.vertex[good]]
        normals[good] = self._normals.rows[placed.vertex[good]]
        unknown = np.full(len(good), np.nan)
        return Rim(
            stamp_ns=placed.stamp_ns,
            frame_id=self._frame_id,
            points=points,
            normals=normals,
            curvature=unknown,
            depth_sigma=unknown,
            loop=placed.loop,
            prev=placed.prev.astype(np.float64),
            status=np.where(good, Status.GOOD, Status.NO_CORRESPONDENT).astype(np.uint8),
        )

    def _take_out(self, number: int) -> None:
        strip = self._strips.pop(number)
        self._path.remove(number)
        self._kill(np.arange(strip.start, strip.end))
        for end in strip.ends:
            end.strips.remove(number)
            self._let_go(end)

    def _let_go(self, placed: _Placed) -> None:
        """Keep of a rim only what is still needed."""
        if placed is self._last or placed in self._waiting:
            return
        if len(placed.strips) != 1:
            placed.rim = None
        if not placed.strips and placed.stamp_ns in self._placed:
            del self._placed[placed.stamp_ns]
            self._replaced.add(placed.stamp_ns)

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


@dataclass(eq=False)
class _Placed:
    """A rim in the surface: the vertex of each of its rows (-1 where it is not good), their
    loop and place in the rim before, the camera centre, the strips that end at it; the rim
    itself as long as one may still come."""

    rim: Rim | None
    stamp_ns: int
    centre: NDArray[np.float64]
    vertex: NDArray[np.int64]
    loop: NDArray[np.uint16]
    prev: NDArray[np.float32]
    strips: list[int] = field(default_factory=list)

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays, without the rim."""
        return self.vertex.nbytes + self.loop.nbytes + self.prev.nbytes

    @property
    def waits_for(self) -> int:
        """Stamp of the rim before it."""
        return self.rim.prev_stamp_ns if self.rim else 0


@dataclass(eq=False)
class _Joined:
    """A strip: its rows among the triangles, and the rims that it joins."""

    start: int
    end: int
    ends: tuple[_Placed, _Placed]
