"""A true rim point projects inside or on every other silhouette.

Points far from an outline take the distance of their cell of the grid. For those near it a
walk along the outline, a step or two, finds the nearest sample, whose tangent tells; a search
tree answers where that is in doubt: where the outline is not one simple stretch, beside
corners, and for what seems to be outside.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .outline_map import OutlineMap

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_WALKS = 4  # moves along the outline towards the sample nearest to a point
_SETTLED = 0.75  # steps along the tangent to where that is near enough


class Silhouette:
    """The inside and outside of one view's contours. The map is made when it is first asked.

    Args:
        contours: the outline, of at least one sample; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours

    @cached_property
    def _map(self) -> OutlineMap:
        return OutlineMap(self.contours)

    def outside(self, points: Array) -> Array:
        """How far points project outside the outline.

        Exact in the grid's cells (a 64th of the silhouette's longer side) that the outline
        runs through, and outside nearer to it than half a cell; elsewhere to about a cell,
        and only roughly beyond the outline's surroundings.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside; NaN for NaN, for points behind the camera, and
            beyond a gap of the outline, where nothing is known.
        """
        grid = self._map
        x, y = grid.place(points)
        # Points off the grid, and unknown ones, go to its edge.
        i, j = (np.fmin(np.fmax(v, 0), n - 1) for v, n in zip((x, y), grid.shape, strict=True))
        cell = i.astype(np.intp) * grid.shape[1] + j.astype(np.intp)
        result = grid.far[cell]
        off = np.flatnonzero((x != i) | (y != j))
        if len(off):
            result[off] += np.hypot(x[off] - i[off], y[off] - j[off])
        near = np.flatnonzero(grid.start[cell] >= 0)
        result[near] = self._near(x[near], y[near], cell[near])
        return result * grid.width

    def _near(self, x: Array, y: Array, cell: Index) -> Array:
        """(k,) distance in cells of points near the outline, by the nearest sample's tangent."""
        grid = self._map
        row = grid.start[cell]
        across, along = grid.from_tangent(x, y, row)
        todo = np.flatnonzero(np.abs(along) > _SETTLED * grid.length[row])
        for _ in range(_WALKS):
            if not len(todo):
                break
            here = grid.moved(row[todo], along[todo])
            row[todo] = here
            across[todo], along[todo] = grid.from_tangent(x[todo], y[todo], here)
            todo = todo[np.abs(along[todo]) > _SETTLED * grid.length[here]]
        # Beside a concave corner the walk may end on the wrong branch, outside of it.
        doubtful = (np.abs(along) > grid.step) | (across > 0.5 * grid.step) | grid.entangled[cell]
        doubtful[todo] = True
        ask = np.flatnonzero(doubtful)
        if len(ask):
            x, y = x[ask], y[ask]
            nearest = grid.tree.query(np.stack([x, y], axis=1))[1]
            across[ask] = grid.from_nearest(x, y, nearest)
        return across
