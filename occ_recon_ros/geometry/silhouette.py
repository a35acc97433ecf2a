"""A true rim point projects inside or on every other silhouette."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .contours import Contours

Array = NDArray[np.float64]

_CELLS = 40  # across the longer side of the silhouette
_NEAR = 0.4  # cells: as far as linear interpolation may be off beside a corner


class Silhouette:
    """The inside and outside of one view's contours.

    Works on the plane at distance 1 across the middle viewing direction. A coarse grid of
    signed distances answers for points far from the outline, and the nearest sample's
    tangent plane for those near it. The grid is made when it is first asked.

    Args:
        contours: the outline, of at least one sample; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours

    @cached_property
    def _map(self) -> _DistanceMap:
        return _DistanceMap(self.contours)

    def outside(self, points: Array) -> Array:
        """How far points project outside the outline.

        Exact nearer to the outline than 0.4 of a grid cell (a 40th of the silhouette),
        to a fraction of a cell farther away, and only roughly beyond its surroundings.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside, NaN for NaN and for points behind the camera.
        """
        return self._map.outside(points)


class _DistanceMap:
    """What a silhouette works out once: axes of the plane, grid, tangents."""

    def __init__(self, contours: Contours) -> None:
        self._centre = contours.centre
        middle = contours.T.mean(axis=0)
        middle = middle / np.linalg.norm(middle)
        across = np.eye(3)[np.argmin(np.abs(middle))]
        x = np.cross(middle, across)
        x = x / np.linalg.norm(x)
        self._axes = np.stack([x, np.cross(middle, x), middle])
        self._plane = self._onto_plane(contours.T)
        normals = contours.N @ self._axes[:2].T
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        steps = np.linalg.norm(self._plane[contours.next_row] - self._plane, axis=1)
        step = float(np.median(steps))
        low, high = self._plane.min(axis=0), self._plane.max(axis=0)
        self._cell = float((high - low).max()) / _CELLS or 1.0
        self._low = low - 1.5 * self._cell
        shape = np.ceil((high - self._low) / self._cell).astype(int) + 2
        at = np.stack(np.meshgrid(*(np.arange(s) for s in shape), indexing="ij"), axis=-1)
        cells = self._low + at.reshape(-1, 2) * self._cell
        self._near = _Tangents(self._plane, self._normals, step)
        # For the grid, samples half a cell apart say enough.
        stride = max(1, int(self._cell / (2 * step))) if step > 0 else 1
        few = _Tangents(self._plane[::stride], self._normals[::stride], stride * step)
        self._grid = few.signed_distance(cells).reshape(shape)

    def outside(self, points: Array) -> Array:
        """(n,) as ``Silhouette.outside``."""
        plane = self._onto_plane(points - self._centre)
        result = self._coarse(plane)
        near = np.abs(result) < _NEAR * self._cell
        result[near] = self._near.signed_distance(plane[near])
        return np.where(np.isfinite(plane[:, 0]), result, np.nan)

    def _coarse(self, plane: Array) -> Array:
        """(n,) signed distance between grid points, linear; off the grid, that of its
        edge and the way to it."""
        cell = np.nan_to_num((plane - self._low) / self._cell)
        on_grid = np.clip(cell, 0, np.array(self._grid.shape) - 1.001)
        off = np.hypot(*(cell - on_grid).T) * self._cell
        i, j = on_grid.astype(np.intp).T
        f, g = (on_grid - np.floor(on_grid)).T
        near = self._grid[i, j] * (1 - g) + self._grid[i, j + 1] * g
        far = self._grid[i + 1, j] * (1 - g) + self._grid[i + 1, j + 1] * g
        return near * (1 - f) + far * f + off

    def _onto_plane(self, ray: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = ray @ self._axes[2]
            return (ray @ self._axes[:2].T) / np.where(ahead > 0, ahead, np.nan)[:, None]


class _Tangents:
    """Distance to an outline by the tangents at its samples.

    Args:
        plane: (m, 2) samples.
        normals: (m, 2) their outward unit normals.
        step: their usual distance.
    """

    def __init__(self, plane: Array, normals: Array, step: float) -> None:
        self._plane, self._normals, self._step = plane, normals, step
        self._tree = cKDTree(plane, balanced_tree=False, compact_nodes=False)

    def signed_distance(self, points: Array) -> Array:
        """(n,) distance of (n, 2) points, negative inside, NaN for NaN."""
        known = np.isfinite(points).all(axis=1)
        result = np.full(len(points), np.nan)
        distance, row = self._tree.query(points[known])
        step = points[known] - self._plane[row]
        across = np.einsum("nk,nk->n", step, self._normals[row])
        # Past the end of the tangent (beside a corner) it says too little.
        past = distance**2 - across**2 > self._step**2
        result[known] = np.where(past, np.copysign(distance, across), across)
        return result
