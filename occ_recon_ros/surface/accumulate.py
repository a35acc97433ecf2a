"""The surface as it grows: one strip a rim."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..geometry import Rim, Status
from .colour import ViewColours
from .growing import GrowingArray
from .strip import Strip
from .zipping import zip_rims

_MOST_WAITING = 8  # rims kept whose previous rim has not come


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
        self._last: _Placed | None = None
        self._waiting: list[_Placed] = []
        self._placed: dict[int, NDArray[np.int64]] = {}
        self._frame_id = ""

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self._triangles)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that grow with the surface."""
        arrays = (self._points, self._normals, self._sigma, self._triangles)
        return sum(a.nbytes for a in arrays) + sum(v.nbytes for v in self._placed.values())

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
        if rim.stamp_ns in self._placed:
            raise ValueError("a rim of this stamp has come before")
        placed = self._place(rim)
        before = len(self._triangles)
        last = self._last
        if last is not None and rim.prev_stamp_ns in (0, last.rim.stamp_ns):
            self._join(placed, last)
        elif rim.prev_stamp_ns:
            self._waiting = [*self._waiting, placed][-_MOST_WAITING:]
        for other in [w for w in self._waiting if w.rim.prev_stamp_ns == rim.stamp_ns]:
            self._join(other, placed)
            self._waiting.remove(other)
        self._last = placed
        return self._flat(self._triangles.rows[before:], rim.stamp_ns)

    def revise(self, rim: Rim) -> int:
        """Take away the triangles of points that are no longer good.

        Args:
            rim: as it was added, but for its status.

        Returns:
            How many of its points are given up; 0 for a rim that has not changed.

        Raises:
            ValueError: no rim of this stamp and number of rows was added.
        """
        vertex = self._placed.get(rim.stamp_ns)
        if vertex is None or len(vertex) != len(rim):
            raise ValueError("no rim of this stamp with as many rows has come before")
        wrong = (vertex >= 0) & (rim.status != Status.GOOD)
        gone = np.zeros(len(self._points), bool)
        gone[vertex[wrong]] = True
        self._triangles.keep(~gone[self._triangles.rows].any(axis=1))
        vertex[wrong] = -1
        return int(np.count_nonzero(wrong))

    def whole(self) -> Strip:
        """The whole surface in the flat form."""
        stamp = self._last.rim.stamp_ns if self._last else 0
        self._hide_behind_all()
        return self._flat(self._triangles.rows, stamp)

    def mesh(self) -> trimesh.Trimesh:
        """The whole surface with shared vertices, those without a triangle left out."""
        self._hide_behind_all()
        used, faces = np.unique(self._triangles.rows, return_inverse=True)
        return trimesh.Trimesh(
            vertices=self._points.rows[used],
            faces=faces.reshape(-1, 3),
            vertex_normals=self._normals.rows[used],
            vertex_colors=self._colours(used),
            process=False,
        )

    def _hide_behind_all(self) -> None:
        """Renew what hides what, for strips to come as well: it would cost each of them more
        the larger the surface is."""
        if self.colours:
            self.colours.hide_behind(self._points.rows[self._triangles.rows])

    def _colours(self, vertices: NDArray[np.int64]) -> NDArray[np.uint8] | None:
        if not self.colours:
            return None
        return self.colours.of(self._points.rows[vertices], self._normals.rows[vertices])

    def _place(self, rim: Rim) -> _Placed:
        good = rim.status == Status.GOOD
        vertex = np.full(len(rim), -1, np.int64)
        vertex[good] = len(self._points) + np.arange(np.count_nonzero(good))
        self._points.append(rim.points[good])
        self._normals.append(rim.normals[good])
        self._sigma.append(rim.depth_sigma[good])
        self._placed[rim.stamp_ns] = vertex
        return _Placed(rim, vertex)

    def _join(self, placed: _Placed, previous: _Placed) -> None:
        triangles = zip_rims(placed.rim, previous.rim, self.settings.longest_step)
        self._triangles.append(np.concatenate([placed.vertex, previous.vertex])[triangles])

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


@dataclass(frozen=True, eq=False)
class _Placed:
    """A rim and the vertex number of each of its rows (-1 where it is not good)."""

    rim: Rim
    vertex: NDArray[np.int64]
