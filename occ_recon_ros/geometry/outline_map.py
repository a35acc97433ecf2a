"""Which points of an image plane lie inside an outline, and how far from it.

A grid of cells holds for each cell its distance from the outline and a sample near it.
Points far from the outline take the distance of their cell. For points near it the sample
is where a walk along the outline to the nearest one begins, a step or two away; a search
tree answers where that is in doubt: in cells where the outline is not one simple stretch,
beside corners, and for what seems to be outside. All (2, n) arrays are columns of points.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from .contours import Contours

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_CELLS = 64  # across the longer side of the silhouette
_NEAR = 1.5  # cells between middles: a cell with outline in it and the eight about it
_STRAIGHT = 4.5  # cells: no outline that runs straight on is longer in three by three
_WALKS = 4  # moves along the outline towards the sample nearest to a point


class OutlineMap:
    """What a silhouette works out once: the plane, its samples and the grid.

    The plane is at distance 1 across the middle viewing direction.

    Args:
        contours: m samples, at least one.
    """

    def __init__(self, contours: Contours) -> None:
        self._centre = contours.centre
        middle = contours.T.mean(axis=0)
        middle = middle / np.linalg.norm(middle)
        across = np.eye(3)[np.argmin(np.abs(middle))]
        x = np.cross(middle, across)
        x = x / np.linalg.norm(x)
        self._axes = np.stack([x, np.cross(middle, x), middle])
        self._plane = self._onto_plane(contours.T)
        normals = self._axes[:2] @ contours.N.T
        self._normals = normals / np.hypot(*normals)

        ahead = self._plane[:, contours.next_row] - self._plane
        length = np.hypot(*ahead)
        with np.errstate(invalid="ignore"):
            ahead = ahead / length
        # At a corner the two edges together tell the outer side (their normals' sum).
        along_x, along_y = ahead + ahead[:, contours.previous_row]
        self._corners = np.stack([-along_y, along_x])
        self._step = float(np.median(length)) or 1.0
        self._lengths = np.where(contours.linked & (length > 0), length, self._step)
        count = np.diff(contours.loop_starts)
        self._first, self._count = np.repeat([contours.loop_starts[:-1], count], count, axis=1)

        low, high = self._plane.min(axis=1), self._plane.max(axis=1)
        self._cell = max(float((high - low).max()) / _CELLS, 1.5 * self._step)
        self._low = low - 1.5 * self._cell
        self._shape = tuple(np.ceil((high - self._low) / self._cell).astype(int) + 2)
        self._make_grid(contours)

    def _make_grid(self, contours: Contours) -> None:
        """The grid's arrays, flat: distance of the middle of the cell, a sample near it,
        whether the outline is near, and whether it is entangled there."""
        rows, at = np.arange(len(contours)), self._cells_of(self._plane)
        gaps = self._gaps(contours)
        row, first, last = (np.full(np.prod(self._shape), k) for k in (-1, len(contours), -1))
        row[at] = last[at] = rows
        first[at[::-1]] = rows[::-1]
        blocked = row >= 0
        blocked[gaps] = True

        distance, nearest = distance_transform_edt(~self._grid(blocked), return_indices=True)
        nearest = np.ravel_multi_index(tuple(nearest), self._shape).ravel()
        gap = row[nearest] < 0
        self._row = row[nearest]
        self._near = (distance.ravel() <= _NEAR) & ~gap
        sign = np.where(self._inside(contours), -1.0, 1.0)
        self._far = self._cell * sign * distance.ravel()
        self._far[gap & (self._far > 0)] = np.nan
        span = _spread(self._grid(last), np.maximum) - _spread(self._grid(first), np.minimum)
        self._entangled = span.ravel() * self._step > _STRAIGHT * self._cell

    def _gaps(self, contours: Contours) -> Index:
        """Cells that the chords over gaps of the outline cross."""
        rows = np.flatnonzero(~contours.linked)
        start = self._plane[:, rows]
        chord = self._plane[:, contours.next_row[rows]] - start
        count = (np.hypot(*chord) / self._cell * 2).astype(np.intp) + 1
        edge, place = _repeated(count)
        return self._cells_of(start[:, edge] + (place + 0.5) / count[edge] * chord[:, edge])

    def _inside(self, contours: Contours) -> Mask:
        """Which middles of cells the closed loops enclose, by parity along each line."""
        u, v = (self._plane - self._low[:, None]) / self._cell - 0.5
        to = contours.next_row
        low = np.ceil(np.minimum(u, u[to])).astype(np.intp)
        edge, place = _repeated(np.ceil(np.maximum(u, u[to])).astype(np.intp) - low)
        line = low[edge] + place
        part = (line - u[edge]) / (u[to[edge]] - u[edge])
        crossing = np.ceil(v[edge] + part * (v[to[edge]] - v[edge])).astype(np.intp)
        flips = np.bincount(line * self._shape[1] + crossing, minlength=np.prod(self._shape))
        return (np.cumsum(self._grid(flips), axis=1) % 2 == 1).ravel()

    def _grid(self, cells: NDArray) -> NDArray:
        """Flat cells as rows and columns."""
        return cells.reshape(self._shape)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._plane.T, balanced_tree=False, compact_nodes=False)

    def outside(self, points: Array) -> Array:
        """(n,) as ``Silhouette.outside`` of points (n, 3), metres, object frame."""
        plane = self._onto_plane(points - self._centre)
        known = np.isfinite(plane[0])
        x, y = (plane - self._low[:, None]) / self._cell
        # Points off the grid, and unknown ones, go to its edge.
        i = np.fmin(np.fmax(x, 0), self._shape[0] - 1).astype(np.intp)
        j = np.fmin(np.fmax(y, 0), self._shape[1] - 1).astype(np.intp)
        cell = i * self._shape[1] + j
        result = np.where(known, self._far[cell], np.nan)
        off = np.flatnonzero((x < 0) | (y < 0) | (x > i + 1) | (y > j + 1))
        if len(off):
            result[off] += self._cell * np.hypot(x[off] - i[off] - 0.5, y[off] - j[off] - 0.5)
        near = np.flatnonzero(self._near[cell] & known)
        result[near] = self._signed_distance(plane.take(near, axis=1), cell[near])
        return result

    def _signed_distance(self, points: Array, cell: Index) -> Array:
        """(n,) distance of points (2, n) near the outline, by the nearest sample's tangent."""
        row = self._row[cell]
        todo = np.arange(len(row))
        for _ in range(_WALKS):
            here = row[todo]
            along = self._along(points.take(todo, axis=1), here) / self._lengths[here]
            first = self._first[here]
            with np.errstate(invalid="ignore"):  # a sample alone has no normal
                move = np.rint(along).astype(np.intp)
            row[todo] = first + (here - first + move) % self._count[here]
            todo = todo[move != 0]
        # Beside a concave corner the walk may end on the wrong branch, outside of it.
        across, past = self._from_tangent(points, row)
        doubtful = past | (across > 0.5 * self._step) | self._entangled[cell]
        doubtful[todo] = True
        ask = np.flatnonzero(doubtful)
        if len(ask):
            asked = points.take(ask, axis=1)
            row[ask] = nearest = self._tree.query(asked.T)[1]
            across[ask], past[ask] = self._from_tangent(asked, nearest)
        return self._beside_corners(across, past, points, row)

    def _from_tangent(self, points: Array, row: Index) -> tuple[Array, Mask]:
        """Of points (2, n) and samples: (n,) distance to the tangent, positive outside, and
        whether the point lies past its end (beside a corner), where it says too little."""
        x, y = points - self._plane.take(row, axis=1)
        nx, ny = self._normals.take(row, axis=1)
        across = x * nx + y * ny
        return across, x**2 + y**2 - across**2 > self._step**2

    def _beside_corners(self, across: Array, past: Mask, points: Array, row: Index) -> Array:
        """Distances (n,), those of points past the tangent's end being to the sample."""
        corner = np.flatnonzero(past)
        if len(corner):
            x, y = points.take(corner, axis=1) - self._plane.take(row[corner], axis=1)
            nx, ny = self._corners.take(row[corner], axis=1)
            across[corner] = np.copysign(np.hypot(x, y), x * nx + y * ny)
        return across

    def _along(self, points: Array, row: Index) -> Array:
        """(n,) how far points lie ahead of samples, along the tangent N x T."""
        x, y = points - self._plane.take(row, axis=1)
        nx, ny = self._normals.take(row, axis=1)
        return x * ny - y * nx

    def _cells_of(self, plane: Array) -> Index:
        """(n,) flat indices of the cells of points (2, n) on the grid."""
        i, j = ((plane - self._low[:, None]) / self._cell).astype(np.intp)
        return i * self._shape[1] + j

    def _onto_plane(self, ray: Array) -> Array:
        """(2, n) where rays (n, 3) meet the plane; NaN behind the camera."""
        x, y, ahead = self._axes @ ray.T
        ahead[~(ahead > 0)] = np.nan
        return np.stack([x / ahead, y / ahead])


def _repeated(count: Index) -> tuple[Index, Index]:
    """Each index as often as counted, and which time it is."""
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)


def _spread(grid: Index, extreme: np.ufunc) -> Index:
    """The extreme over each cell and the eight about it."""

    def along(cells: Index) -> Index:
        wide = cells.copy()
        extreme(wide[1:], cells[:-1], out=wide[1:])
        extreme(wide[:-1], cells[1:], out=wide[:-1])
        return wide

    return along(along(grid).T).T
