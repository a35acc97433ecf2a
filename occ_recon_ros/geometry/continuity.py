"""Whether a rim and its neighbour lie on one smooth surface.

Where a piece of surface is hidden in a partner, the piece that hides it is met in its
place. The crossing is then too far, and depth and radius of curvature run away together,
which no silhouette need contradict. But the rim of the other partner, known already,
knows better.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .matching import nearest_column, object_radius
from .rim import Rim, Status
from .triple import Estimate, Partner

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_APART = 0.03  # radii of the object
_SIGMAS = 4.0


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
