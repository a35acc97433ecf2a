"""A true rim point projects inside or on every other silhouette.

Points far from an outline take the signed distance of their cell of its grid. For those near it
the cell names a sample close by; a step or two along the outline lead to the nearest one, whose
tangent tells, or beside a corner its distance.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from .arrays import Array
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
        loops = compiled("geometry.outline_kernels")
        loops.raise_to_outline(points, *self.map.arrays, unit, most, found)

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
