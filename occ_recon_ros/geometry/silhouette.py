"""A true rim point projects inside or on every other silhouette.

Points far from an outline take the signed distance of their cell of its grid. For those near it
the cell names a sample close by; a step or two along the outline lead to the nearest one, whose
tangent tells, or beside a corner its distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .outline_map import OutlineMap

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_WALKS = 2  # moves along the outline towards the sample nearest to a point
_FARTHEST = 5  # samples, of a move
_SPARE = 48  # silhouettes kept ready that are not asked just now


class Silhouette:
    """The inside and outside of one view's contours. The map is made when it is first asked.

    Args:
        contours: the outline, of at least one sample; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours

    @cached_property
    def map(self) -> OutlineMap:
        """The outline on its grid."""
        return OutlineMap(self.contours)

    def outside(self, points: Array) -> Array:
        """(n,) as ``SilhouetteBank.outside``."""
        found: Array = SilhouetteBank().outside(points, [self])[0]
        return found


class SilhouetteBank:
    """Silhouettes side by side in common arrays, so that points are held against several at
    once. Each is put in when it is first asked; of too many, those not asked now go."""

    def __init__(self) -> None:
        self._slots: dict[Silhouette, int] = {}
        self._samples: dict[str, NDArray] = {}
        self._cells: dict[str, NDArray] = {}

    def outside_px(self, points: Array, silhouettes: Sequence[Silhouette]) -> Array:
        """(n,) how far points (n, 3) project outside the worst of the silhouettes, px; -inf
        where nothing is known."""
        worst = np.full(len(points), -np.inf)
        if len(points) and silhouettes:
            pixels = np.array([s.contours.radians_per_pixel for s in silhouettes])
            worst = np.fmax(
                worst, np.fmax.reduce(self.outside(points, silhouettes) / pixels[:, None])
            )
        return worst

    def outside(self, points: Array, silhouettes: Sequence[Silhouette]) -> Array:
        """How far points project outside each outline.

        Exact in the grid's cells (a 192nd of the silhouette's longer side) that the outline
        runs through, and outside nearer to it than half a cell; elsewhere to about a cell,
        and only roughly beyond the outline's surroundings.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.
            silhouettes: S of them.

        Returns:
            (S, n) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside; NaN for NaN, for points behind the camera, and
            beyond a gap of the outline, where nothing is known.
        """
        slot = self._ready(silhouettes)[:, None]
        maps = [s.map for s in silhouettes]
        rotation = np.concatenate([m.rotation for m in maps])
        place = rotation @ points.T + np.concatenate([m.shift for m in maps])[:, None]
        z = place[2::3]
        if not z.min(initial=1.0) > 0:
            z = np.where(z > 0, z, np.nan)
        x, y = place[0::3] / z, place[1::3] / z
        rows, columns = np.array([m.shape for m in maps]).T[:, :, None]
        # Points off the grid, and unknown ones, go to its edge.
        i, j = np.fmin(np.fmax(x, 0), rows - 1), np.fmin(np.fmax(y, 0), columns - 1)
        cell = i.astype(np.intp) * columns + j.astype(np.intp)
        cell += slot * self._cells["far"].shape[1]
        result = self._cells["far"].take(cell)
        off = np.flatnonzero((x != i) | (y != j))
        if len(off):
            result.flat[off] += np.hypot(x - i, y - j).flat[off]
        row = self._cells["nearest"].take(cell)
        near = np.flatnonzero(row >= 0)
        if len(near):
            step = np.array([m.step for m in maps]).take(near // len(points))
            row = row.take(near) + slot.take(near // len(points)) * self._samples["x"].shape[1]
            result.flat[near] = self._near(x.take(near), y.take(near), row, step)
        result *= np.array([[m.width] for m in maps])
        return result

    def _ready(self, silhouettes: Sequence[Silhouette]) -> Index:
        """The slots of silhouettes, put in where they are not there yet."""
        new = [s for s in silhouettes if s not in self._slots]
        if len(self._slots) + len(new) > len(silhouettes) + _SPARE:
            asked = set(silhouettes)
            self._slots = {s: k for s, k in self._slots.items() if s in asked}
        free = iter(sorted(set(range(len(self._slots) + len(new))) - set(self._slots.values())))
        for one in new:
            self._slots[one] = next(free)
            _put(self._samples, self._slots[one], one.map.samples)
            _put(self._cells, self._slots[one], one.map.cells)
        return np.array([self._slots[s] for s in silhouettes])

    def _near(self, x: Array, y: Array, row: Index, step: Array) -> Array:
        """(k,) signed distance in cells of points near outlines.

        Args:
            x, y: where each lies.
            row: (k,) of the common samples, one near to each.
            step: (k,) the usual distance of the samples.
        """
        samples = {name: values.ravel() for name, values in self._samples.items()}
        stride = self._samples["x"].shape[1]
        across, along = _from_tangent(samples, x, y, row)
        for _ in range(_WALKS):
            there = _moved(samples, row, along, stride)
            there_across, there_along = _from_tangent(samples, x, y, there)
            nearer = there_across**2 + there_along**2 < across**2 + along**2
            row = np.where(nearer, there, row)
            across = np.where(nearer, there_across, across)
            along = np.where(nearer, there_along, along)
        # Beside a corner the distance to it counts, and both its edges tell the side.
        past = np.flatnonzero(np.abs(along) > step)
        row = row[past]
        side = (x[past] - samples["x"].take(row)) * samples["corner_x"].take(row)
        side += (y[past] - samples["y"].take(row)) * samples["corner_y"].take(row)
        across[past] = np.copysign(np.hypot(across[past], along[past]), side)
        return across


def _put(arrays: dict[str, NDArray], slot: int, values: dict[str, NDArray]) -> None:
    """Write arrays (k,) into rows of common ones, which grow as they need."""
    for name, value in values.items():
        old = arrays.get(name, np.zeros((0, 0), value.dtype))
        if slot >= old.shape[0] or len(value) > old.shape[1]:
            shape = max(old.shape[0], slot + 8), max(old.shape[1], len(value) * 5 // 4)
            arrays[name] = np.zeros(shape, value.dtype)
            arrays[name][: old.shape[0], : old.shape[1]] = old
        arrays[name][slot, : len(value)] = value


def _from_tangent(
    samples: dict[str, NDArray], x: Array, y: Array, row: Index
) -> tuple[Array, Array]:
    """(k,) how far points lie from the tangents at samples, positive outside, and how far
    along them, the way the outline is walked (N x T)."""
    x, y = x - samples["x"].take(row), y - samples["y"].take(row)
    nx, ny = samples["nx"].take(row), samples["ny"].take(row)
    return x * nx + y * ny, x * ny - y * nx


def _moved(samples: dict[str, NDArray], row: Index, along: Array, stride: int) -> Index:
    """(k,) the samples that lie so far on from others along their loops."""
    with np.errstate(invalid="ignore"):  # a sample alone has no normal
        move = np.rint(np.clip(along / samples["length"].take(row), -_FARTHEST, _FARTHEST))
    move = np.nan_to_num(move).astype(np.intp)
    first = samples["first"].take(row) + row // stride * stride
    moved: Index = first + (row - first + move) % samples["count"].take(row)
    return moved
