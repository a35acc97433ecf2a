"""Whether a rim and its neighbour lie on one smooth surface.

Where a piece of surface is hidden in a partner, the piece that hides it is met in its
place. The crossing is then too far, and depth and radius of curvature run away together,
which no silhouette need contradict. But the rim of the other partner, known already,
knows better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .matching import nearest_column, object_radius
from .rim import Rim, Status
from .triple import Estimate, Partner

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_APART = 0.03  # radii of the object
_SIGMAS = 4.0
_LONG = 2.0  # times the median link
_HOLLOW = 1 / 16  # an arc over half a rad is so far from the middle of its chord, in chords


def breaks(
    partner: Partner, found: Estimate, rim: Rim, blur: float, column: Index | None = None
) -> NDArray[np.bool_]:
    """Samples that do not lie on one smooth surface with a neighbouring rim.

    Between two views the surface turns like a circle, to second order: it touches both rays
    as far from where they cross, so that depth = d + (d_other - depth of the other).

    Args:
        partner: the neighbouring view, for all n samples.
        found: what is known of the samples.
        rim: of the neighbouring view.
        blur: what the directions of rays may be wrong by, rad.
        column: (n,) of the candidates there; None takes those nearest to the points.

    Returns:
        (n,) bool, False where the neighbour says nothing, or where its own surface is the
        flatter one.
    """
    pencil = partner.pencil
    if not partner.candidates.valid.size:
        return np.zeros(len(found.depth), bool)
    if column is None:
        column = nearest_column(pencil, partner.candidates, found.depth, found.curvature)
    cross, at = partner.cross.column(column), partner.candidates.column(column)
    row, fraction = at.row[:, 0], at.fraction[:, 0]
    after = pencil.other.next_row[row]
    known = at.valid[:, 0] & (rim.status[row] == Status.GOOD) & (rim.status[after] == Status.GOOD)
    depths = np.linalg.norm(rim.points - pencil.other.centre, axis=1)
    theirs = (1 - fraction) * depths[row] + fraction * depths[after]
    apart = np.abs(found.depth - (cross.d + cross.d_other - theirs))
    size = object_radius(pencil.contours, found.depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        most = _APART * size + _SIGMAS * found.sigma + blur * cross.d / np.abs(cross.sin)
        return known & (apart > most) & (np.abs(found.curvature) < np.abs(rim.curvature[row]))


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
        away = np.linalg.norm(self.middle - contours.centre, axis=1)
        return _HOLLOW * self.length / (away * contours.radians_per_pixel)


def long_links(points: Array, before: Rim, prev: Array, after: Index) -> Links:
    """Links so long that they may lead over to another piece of surface.

    One leg steps behind the other, and the outline that was the one's is the other's: both
    points are right, and nearly alike in ray and normal. But a view from the side sees
    the gap that the link crosses.

    Args:
        points: (n, 3) of a rim.
        before: the rim before it, m rows.
        prev: (n,) positions in that, NaN where there is none.
        after: (m,) the next row on its loop.
    """
    rows = np.flatnonzero(np.isfinite(prev) & np.isfinite(points[:, 0]))
    row = np.minimum(prev[rows].astype(np.intp), len(before) - 1)  # the last, and all of a step
    part = (prev[rows] - row)[:, None]
    there = (1 - part) * before.points[row] + part * before.points[after[row]]
    length = np.linalg.norm(points[rows] - there, axis=1)
    known = np.isfinite(length)
    usual = np.median(length[known]) if known.any() else 0.0
    long = known & (length > _LONG * usual)
    return Links(rows[long], 0.5 * (points[rows] + there)[long], length[long])
