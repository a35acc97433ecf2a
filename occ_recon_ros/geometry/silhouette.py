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

from .compiled import compiled
from .contours import Contours
from .outline_map import FARTHEST, FIRST_ROW, WALKS, OutlineMap

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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
        """How far points project outside the outline.

        Exact in the grid's cells (a 192nd of the silhouette's longer side) that the outline
        runs through, and outside nearer to it than half a cell; elsewhere to about a cell,
        and only roughly beyond the outline's surroundings.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside; NaN for NaN, for points behind the camera, and
            beyond a gap of the outline, where nothing is known.
        """
        found = np.full(len(points), np.nan)
        self.raise_outside(points, found, self.map.width)
        return found

    def raise_outside(self, points: Array, found: Array, unit: float, most: float = np.inf) -> None:
        """Raise (n,) in place to how far points are outside, where they are not known to be
        outside of another by more than that; NaN there: nothing is known yet.

        Args:
            points: (n, 3) as of ``outside``.
            found: (n,) float64, in the unit; written.
            unit: so many to a cell.
            most: what is farther outside is out anyway.
        """
        loops, map_ = compiled(), self.map
        if loops:
            loops.raise_to_outline(points, *map_.arrays, unit, most, found)
            return
        left = np.flatnonzero(~(found > most))
        found[left] = np.fmax(found[left], in_cells(points.take(left, axis=0), map_) * unit)

    @cached_property
    def pixels(self) -> float:
        """To a cell."""
        return self.map.width / self.contours.radians_per_pixel


def outside_px(points: Array, silhouettes: Sequence[Silhouette]) -> Array:
    """(S, n) how far points (n, 3) project outside each of S silhouettes, px; NaN where nothing
    is known."""
    found = np.full((len(silhouettes), len(points)), np.nan)
    for silhouette, row in zip(silhouettes, found, strict=True):
        silhouette.raise_outside(points, row, silhouette.pixels)
    return found


def worst(px: Array) -> Array:
    """(n,) of (S, n): how far outside the worst of S silhouettes; -inf where none knows."""
    found: Array = np.fmax.reduce(px, axis=0, initial=-np.inf)
    return found


def worst_px(points: Array, silhouettes: Sequence[Silhouette], most: float = np.inf) -> Array:
    """(n,) how far points (n, 3) project outside the worst of the silhouettes, px; -inf where
    nothing is known. A point that one shows to be outside by more than ``most`` is not held
    against others: those that refute many come first at best."""
    found = np.full(len(points), -np.inf)
    for silhouette in silhouettes:
        silhouette.raise_outside(points, found, silhouette.pixels, most)
    return found


def in_cells(points: Array, map_: OutlineMap) -> Array:
    """(n,) how far points (n, 3) are outside, in cells: the NumPy form of
    ``kernels.raise_to_outline``."""
    x, y, z = map_.rotation @ points.T + map_.shift[:, None]
    z = np.where(z > 0, z, np.nan)
    x, y = x / z, y / z
    rows, columns = map_.shape
    # Points off the grid, and unknown ones, go to its edge.
    i, j = np.fmin(np.fmax(x, 0), rows - 1), np.fmin(np.fmax(y, 0), columns - 1)
    cell = i.astype(np.intp) * columns + j.astype(np.intp)
    found = map_.cells.take(cell)
    result = found + np.hypot(x - i, y - j)
    near = np.flatnonzero(found >= FIRST_ROW)
    row = (found[near] - FIRST_ROW).astype(np.intp)
    result[near] = _near(map_, x[near], y[near], row)
    return result


def _near(map_: OutlineMap, x: Array, y: Array, row: Index) -> Array:
    """(k,) signed distance in cells of points near the outline.

    Args:
        map_: of the outline.
        x, y: where each lies.
        row: (k,) a sample near to each.
    """
    places, ahead = map_.samples["place"], map_.samples["ahead"]
    across, along, move = _from_tangent(places, x, y, row)
    todo = np.flatnonzero(move)
    for walk in range(WALKS):
        there = ahead[row[todo], move[todo] + FARTHEST] + row[todo]
        found = _from_tangent(places, x[todo], y[todo], there)
        nearer = found[0] ** 2 + found[1] ** 2 < across[todo] ** 2 + along[todo] ** 2
        todo = todo[nearer]
        row[todo] = there[nearer]
        across[todo], along[todo], move[todo] = (part[nearer] for part in found)
        if walk + 1 < WALKS:
            todo = todo[move[todo] != 0]
    # Beside a corner the distance to it counts, and both its edges tell the side.
    past = np.flatnonzero(np.abs(along) > map_.step)
    corner = places[row[past]]
    side = (x[past] - corner[:, 0]) * corner[:, 5] + (y[past] - corner[:, 1]) * corner[:, 6]
    across[past] = np.copysign(np.hypot(across[past], along[past]), side)
    return across


def _from_tangent(places: Array, x: Array, y: Array, row: Index) -> tuple[Array, Array, Index]:
    """(k,) how far points lie from the tangents at samples, positive outside; how far along
    them, the way the outline is walked (N x T); and so many samples that is, at most
    ``FARTHEST``."""
    place = places.take(row, axis=0)
    x, y, nx, ny = x - place[:, 0], y - place[:, 1], place[:, 2], place[:, 3]
    along = x * ny - y * nx
    move = np.clip(along * place[:, 4], -FARTHEST, FARTHEST)
    return x * nx + y * ny, along, np.rint(move).astype(np.intp)
