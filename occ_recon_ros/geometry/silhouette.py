"""A true rim point projects inside or on every other silhouette.

Points far from an outline take the signed distance of their cell of its grid. For those near it
the cell names a sample close by; a step or two along the outline lead to the nearest one, whose
tangent tells, or beside a corner its distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import numpy as np

from .arrays import Array, Index
from .compiled import compiled
from .contours import Contours
from .outline_map import OutlineMap


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
        (px,) = Silhouettes([self]).outside_px(points)
        return px * self.contours.radians_per_pixel


class Silhouettes:
    """Those of S views, one after the other in the same arrays: points are held against all of
    them by one loop.

    Args:
        members: the silhouettes.

    Attributes:
        asked: which of them, in the order that points are held against them.
    """

    def __init__(self, members: Sequence[Silhouette]) -> None:
        self.members = list(members)
        self.asked: Index = np.arange(len(self.members))

    def without(self, member: Silhouette) -> Silhouettes:
        """All but one, if it is there."""
        return self.ordered(np.flatnonzero([other is not member for other in self.members]))

    def ordered(self, asked: Index) -> Silhouettes:
        """Some of them, in that order."""
        if len(asked):
            _ = self._arrays  # once for all
        some = copy(self)
        some.asked = asked
        return some

    @cached_property
    def _arrays(self) -> tuple[Array, ...]:
        """For the compiled loops: of each view what takes points to its grid, (3, 4); rows and
        columns of the grid, its step, and pixels to a cell; where its cells and its samples begin;
        and the cells, places and loops of all."""
        maps = [silhouette.map for silhouette in self.members]
        pixels = [s.map.width / s.contours.radians_per_pixel for s in self.members]
        grids = [(*m.shape, m.step, px) for m, px in zip(maps, pixels, strict=True)]
        counts = [(len(m.cells), len(m.place)) for m in maps]
        return (
            np.array([np.column_stack([m.rotation, m.shift]) for m in maps]),
            np.array(grids),
            np.cumsum([(0, 0), *counts], axis=0),
            np.concatenate([m.cells for m in maps]),
            np.concatenate([m.place for m in maps]),
            np.concatenate([m.loop for m in maps]),
        )

    def outside_px(self, points: Array) -> Array:
        """(S, n) how far points (n, 3) project outside each, px; NaN where nothing is known."""
        found = np.full((len(self.asked), len(points)), np.nan)
        if len(found):
            compiled("geometry.outline_kernels").outside(points, self.asked, self._arrays, found)
        return found

    def worst_px(self, points: Array, most: float) -> Array:
        """(n,) how far points (n, 3) project outside the worst, px; -inf where nothing is known.
        A point that one shows to be outside by more than ``most`` is not held against others."""
        found = np.full(len(points), -np.inf)
        if len(self.asked):
            loops = compiled("geometry.outline_kernels")
            loops.worst(points, self.asked, self._arrays, most, found)
        return found

    def first_inside(self, centre: Array, T: Array, depth: Array, most: float) -> Index:
        """(k,) the first of some depths on each ray whose point none shows to be outside by more
        than ``most`` px, -1 where there is none.

        Args:
            centre: (3,) of the rays, metres.
            T: (k, 3) their directions.
            depth: (depths, k) metres; those that are not positive do not count.
            most: px.
        """
        loops = compiled("geometry.outline_kernels")
        first: Index = loops.first_inside(centre, T, depth, self.asked, self._arrays, most)
        return first
