"""A true rim point projects inside or on every other silhouette.

Points far from an outline take the signed distance of their cell of its grid. For those near it
the cell names a sample close by; a step or two along the outline lead to the nearest one, whose
tangent tells, or beside a corner its distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .outline_map import FARTHEST, OutlineMap

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_WALKS = 2  # moves along the outline towards the sample nearest to a point
_ASKED = 64  # groups of silhouettes that are remembered
_SIFTING = 4000  # points times silhouettes that are tried at once, at least
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


@dataclass(frozen=True)
class _Together:
    """S silhouettes of a bank.

    Attributes:
        rotation, shift: (3 S, 3), (3 S, 1) of their maps.
        rows, columns, width, first_cell: (S, 1) of their grids; and where each begins in the bank.
        step, first_sample: (S,) of their samples; and where those begin.
    """

    rotation: Array
    shift: Array
    rows: Index
    columns: Index
    width: Array
    first_cell: Index
    step: Array
    first_sample: Index

    @staticmethod
    def of(maps: Sequence[OutlineMap], first_cell: Index, first_sample: Index) -> _Together:
        """Of their maps, and where each begins."""
        rows, columns = np.array([m.shape for m in maps]).T[:, :, None]
        return _Together(
            np.concatenate([m.rotation for m in maps]),
            np.concatenate([m.shift for m in maps])[:, None],
            rows,
            columns,
            np.array([[m.width] for m in maps]),
            first_cell[:, None],
            np.array([m.step for m in maps]),
            first_sample,
        )


class SilhouetteBank:
    """Silhouettes side by side in common arrays, so that points are held against several at
    once. Each is put in when it is first asked; of too many, those not asked now go."""

    def __init__(self) -> None:
        self._slots: dict[Silhouette, int] = {}
        self._asked: dict[tuple[Silhouette, ...], _Together] = {}
        self._samples: dict[str, NDArray] = {}
        self._cells: dict[str, NDArray] = {}

    def outside_px(self, points: Array, silhouettes: Sequence[Silhouette]) -> Array:
        """(S, n) how far points (n, 3) project outside each of S silhouettes, px; NaN where
        nothing is known."""
        if not len(points) or not silhouettes:
            return np.full((len(silhouettes), len(points)), np.nan)
        pixels = np.array([s.contours.radians_per_pixel for s in silhouettes])
        found: Array = self.outside(points, silhouettes)
        return found / pixels[:, None]

    def worst_px(self, points: Array, silhouettes: Sequence[Silhouette]) -> Array:
        """(n,) how far points (n, 3) project outside the worst of the silhouettes, px; -inf
        where nothing is known."""
        return worst(self.outside_px(points, silhouettes))

    def inside(self, points: Array, silhouettes: Sequence[Silhouette], most_px: float) -> Mask:
        """(n,) whether points (n, 3) are nowhere farther outside than that. Silhouettes that
        refute many come first at best: what one has refuted is not held against the others."""
        inside, first = np.arange(len(points)), 0
        while first < len(silhouettes) and len(inside):
            few = silhouettes[first : first + max(first, 1 + _SIFTING // len(inside))]
            inside = inside[~(self.worst_px(points[inside], few) > most_px)]
            first += len(few)
        mask = np.zeros(len(points), bool)
        mask[inside] = True
        return mask

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
        some = self._together(silhouettes)
        place = some.rotation @ points.T + some.shift
        z = place[2::3]
        if not z.min(initial=1.0) > 0:
            z = np.where(z > 0, z, np.nan)
        x, y = place[0::3] / z, place[1::3] / z
        # Points off the grid, and unknown ones, go to its edge.
        i, j = np.fmin(np.fmax(x, 0), some.rows - 1), np.fmin(np.fmax(y, 0), some.columns - 1)
        cell = i.astype(np.intp) * some.columns + j.astype(np.intp) + some.first_cell
        result = self._cells["far"].take(cell)
        off = np.flatnonzero((x != i) | (y != j))
        if len(off):
            result.flat[off] += np.hypot(x - i, y - j).flat[off]
        row = self._cells["nearest"].take(cell).ravel()
        near = np.flatnonzero(row >= 0)
        if len(near):
            which = near // len(points)
            row = row.take(near) + some.first_sample.take(which)
            result.flat[near] = self._near(x.take(near), y.take(near), row, some.step.take(which))
        result *= some.width
        return result

    def _together(self, silhouettes: Sequence[Silhouette]) -> _Together:
        """Several silhouettes, of which a rim asks the same ones again and again."""
        key = tuple(silhouettes)
        if key not in self._asked:
            if len(self._asked) >= _ASKED:
                self._asked.clear()
            slot = self._ready(silhouettes)
            self._asked[key] = _Together.of(
                [s.map for s in silhouettes],
                slot * self._cells["far"].shape[1],
                slot * self._samples["ahead"].shape[1],
            )
        return self._asked[key]

    def _ready(self, silhouettes: Sequence[Silhouette]) -> Index:
        """The slots of silhouettes, put in where they are not there yet."""
        new = [s for s in silhouettes if s not in self._slots]
        if new:
            self._asked.clear()
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
        places = self._samples["place"].reshape(-1, self._samples["place"].shape[2])
        ahead = self._samples["ahead"].reshape(-1, 2 * FARTHEST + 1)
        across, along, move = _from_tangent(places, x, y, row)
        todo = np.flatnonzero(move)
        for walk in range(_WALKS):
            there = ahead[row[todo], move[todo] + FARTHEST] + row[todo]
            found = _from_tangent(places, x[todo], y[todo], there)
            nearer = found[0] ** 2 + found[1] ** 2 < across[todo] ** 2 + along[todo] ** 2
            todo = todo[nearer]
            row[todo] = there[nearer]
            across[todo], along[todo], move[todo] = (part[nearer] for part in found)
            if walk + 1 < _WALKS:
                todo = todo[move[todo] != 0]
        # Beside a corner the distance to it counts, and both its edges tell the side.
        past = np.flatnonzero(np.abs(along) > step)
        corner = places[row[past]]
        side = (x[past] - corner[:, 0]) * corner[:, 5] + (y[past] - corner[:, 1]) * corner[:, 6]
        across[past] = np.copysign(np.hypot(across[past], along[past]), side)
        return across


def worst(px: Array) -> Array:
    """(n,) of (S, n): how far outside the worst of S silhouettes; -inf where none knows."""
    found: Array = np.fmax.reduce(px, axis=0, initial=-np.inf)
    return found


def _put(arrays: dict[str, NDArray], slot: int, values: dict[str, NDArray]) -> None:
    """Write arrays (k, ...) into rows of common ones, which grow as they need."""
    for name, value in values.items():
        old = arrays.get(name, np.zeros((0, 0, *value.shape[1:]), value.dtype))
        if slot >= old.shape[0] or len(value) > old.shape[1]:
            shape = max(old.shape[0], slot + 8), max(old.shape[1], len(value) * 5 // 4)
            arrays[name] = np.zeros((*shape, *value.shape[1:]), value.dtype)
            arrays[name][: old.shape[0], : old.shape[1]] = old
        arrays[name][slot, : len(value)] = value


def _from_tangent(places: Array, x: Array, y: Array, row: Index) -> tuple[Array, Array, Index]:
    """(k,) how far points lie from the tangents at samples, positive outside; how far along
    them, the way the outline is walked (N x T); and so many samples that is, at most
    ``FARTHEST``."""
    place = places.take(row, axis=0)
    x, y, nx, ny = x - place[:, 0], y - place[:, 1], place[:, 2], place[:, 3]
    along = x * ny - y * nx
    move = np.clip(along * place[:, 4], -FARTHEST, FARTHEST)
    return x * nx + y * ny, along, np.rint(move).astype(np.intp)
