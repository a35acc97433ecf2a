"""Links between consecutive rims that may lead over to another piece of surface."""

from dataclasses import dataclass

import numpy as np

from .arrays import Array, Index, lengths
from .contours import Contours
from .rim import Rim

_LONG = 2.0  # median links between rims: a longer one may lead to another piece of surface
_HOLLOW = 1 / 16  # an arc over half a rad is so far from the middle of its chord, in chords


@dataclass(frozen=True)
class Links:
    """Some links between a rim and the one before it.

    Attributes:
        rows: (m,) intp, of the rim.
        middle: (m, 3) float64, between the two points, metres.
        length: (m,) float64, metres.
    """

    rows: Index
    middle: Array
    length: Array

    def hollow_px(self, contours: Contours) -> Array:
        """(m,) how far outside an outline the middles may be on one piece of surface, px:
        where it is hollow its chords are outside."""
        away = lengths(self.middle - contours.centre)
        return _HOLLOW * self.length / (away * contours.radians_per_pixel)


def long_links(points: Array, before: Rim, prev: Array, previous: Contours) -> Links:
    """Links so long that they may lead over to another piece of surface.

    One leg steps behind the other, and the outline that was the one's is the other's: both
    points are right, and nearly alike in ray and normal. But a view from the side sees
    the gap that the link crosses.

    Args:
        points: (n, 3) of a rim.
        before: the rim before it.
        prev: (n,) positions in that, NaN where there is none.
        previous: the contours of that.
    """
    rows = np.flatnonzero(np.isfinite(prev) & np.isfinite(points[:, 0]))
    here = points.take(rows, axis=0)
    there = previous.at(before.points, *previous.split(prev[rows]))
    length = lengths(here - there)
    known = np.isfinite(length)
    usual = np.median(length[known]) if known.any() else 0.0
    long = known & (length > _LONG * usual)
    return Links(rows[long], 0.5 * (here[long] + there[long]), length[long])
