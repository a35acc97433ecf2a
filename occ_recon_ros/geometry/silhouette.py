"""A true rim point projects inside or on every other silhouette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .contours import Contours

Array = NDArray[np.float64]

_CELLS = 64  # across the longer side of the silhouette


class Silhouette:
    """The inside and outside of one view's contours.

    Works on the plane at distance 1 across the middle viewing direction. A coarse grid of
    signed distances answers for points far from the outline, and the nearest sample's
    tangent plane for those near it.

    Args:
        contours: the outline, of at least one sample; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours
        middle = contours.T.mean(axis=0)
        middle = middle / np.linalg.norm(middle)
        across = np.eye(3)[np.argmin(np.abs(middle))]
        x = np.cross(middle, across)
        x = x / np.linalg.norm(x)
        self._axes = np.stack([x, np.cross(middle, x), middle])
        self._plane = self._onto_plane(contours.T)
        normals = contours.N @ self._axes[:2].T
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._tree = cKDTree(self._plane)
        low, high = self._plane.min(axis=0), self._plane.max(axis=0)
        self._cell = float((high - low).max()) / _CELLS or 1.0
        self._low = low - 1.5 * self._cell
        shape = np.ceil((high - self._low) / self._cell).astype(int) + 2
        at = np.stack(np.meshgrid(*(np.arange(s) for s in shape), indexing="ij"), axis=-1)
        cells = self._low + at.reshape(-1, 2) * self._cell
        self._grid = self._signed_distance(cells).reshape(shape)

    def outside(self, points: Array) -> Array:
        """How far points project outside the outline.

        Exact near the outline; farther than two grid cells (a 32nd of the silhouette)
        from it, to half a cell.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside, NaN for NaN and for points behind the camera.
        """
        ray = points - self.contours.centre
        plane = self._onto_plane(ray)
        cell = np.nan_to_num((plane - self._low) / self._cell, nan=0.0) + 0.5
        inside_grid = np.clip(cell.astype(np.int64), 0, np.array(self._grid.shape) - 1)
        result = self._grid[inside_grid[:, 0], inside_grid[:, 1]]
        # A point off the grid is at least that far outside.
        beyond = np.linalg.norm(cell - 0.5 - inside_grid, axis=1) * self._cell
        result = np.where(beyond > self._cell, np.maximum(result, beyond), result)
        near = np.abs(result) < 2 * self._cell
        result[near] = self._signed_distance(plane[near])
        return np.where(np.isfinite(plane).all(axis=1), result, np.nan)

    def _onto_plane(self, ray: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = ray @ self._axes[2]
            return (ray @ self._axes[:2].T) / np.where(ahead > 0, ahead, np.nan)[:, None]

    def _signed_distance(self, plane: Array) -> Array:
        """(n,) distance to the outline, by the tangent at the nearest sample."""
        known = np.isfinite(plane).all(axis=1)
        result = np.full(len(plane), np.nan)
        distance, row = self._tree.query(plane[known])
        step = plane[known] - self._plane[row]
        across = np.einsum("nk,nk->n", step, self._normals[row])
        # Beyond the end of the tangent (a corner, a grid point far away) it says too little.
        result[known] = np.where(
            distance > 2 * np.abs(across), np.copysign(distance, across), across
        )
        return result
