"""Frontier points: where the rims of two views cross, so that both see one surface point.

There the epipolar plane is tangent to the surface, and the angle in the pencil of planes
through the baseline turns back along both contours (Boyer and Berger 1997, section 2.1:
multiple points). The two contours must turn back at the same angle, whatever the shape
of the surface: by how much they do not is a measure of the error of the poses.
"""

from dataclasses import dataclass

import numpy as np

from .arrays import Array, lengths
from .compiled import compiled
from .contours import Contours
from .correspondence import Pencil

_REACH = 6  # samples on either side that must run towards and away from the turn
# Least squares for phi = c0 + c1 s + c2 s^2 over the reach.
_PARABOLA = np.linalg.pinv(np.vander(np.arange(-_REACH, _REACH + 1), 3, increasing=True))
_MOST_APART = 0.02  # rad between the angles of two turns that may be the same point
_NORMALS = 0.9  # least product of their normals, above what the view turns


@dataclass(frozen=True)
class FrontierPoints:
    """k frontier points of two views.

    Attributes:
        row: (k,) float64, position (fractional row) on the first view's contours.
        points: (k, 3) float64, metres: midway between the two rays where they are nearest.
        error: (k,) float64, radians: how far the two turns lie apart in the pencil, as
            seen from the first view; zero for exact poses and contours.
    """

    row: Array
    points: Array
    error: Array

    def __len__(self) -> int:
        return len(self.row)


def frontier_points(pencil: Pencil) -> FrontierPoints:
    """Find and match the frontier points of two views.

    Turns of the same kind (the angle's maximum or minimum) are matched to the nearest
    angle, each at most once, where the normals agree.

    Returns:
        FrontierPoints, perhaps none.
    """
    none = np.zeros(0)
    empty = FrontierPoints(none, np.zeros((0, 3)), none)
    if not pencil.defined:
        return empty
    contours, other = pencil.contours, pencil.other
    row, angle, kind = _turns(contours, pencil.here.phi)
    row_i, angle_i, kind_i = _turns(other, pencil.there.phi)
    if not len(row) or not len(row_i):
        return empty
    apart = np.abs(angle[:, None] - angle_i)
    N = contours.normals_at(*contours.split(row))
    N_i = other.normals_at(*other.split(row_i))
    possible = (kind[:, None] == kind_i) & (N @ N_i.T > _NORMALS)
    apart = np.where(possible & (apart < _MOST_APART), apart, np.inf)
    # Each the nearest of the other: a match in order, never two to one.
    i = np.arange(len(row))
    j = np.argmin(apart, axis=1)
    mutual = np.isfinite(apart[i, j]) & (np.argmin(apart, axis=0)[j] == i)
    i, j = i[mutual], j[mutual]
    T = contours.directions_at(*contours.split(row[i]))
    T_i = other.directions_at(*other.split(row_i[j]))
    axis = (other.centre - contours.centre) / pencil.baseline
    lever = lengths(np.cross(T, axis))
    points = _between(contours.centre, T, other.centre, T_i)
    error = (angle[i] - angle_i[j]) * lever
    met = np.isfinite(points).all(axis=1)
    return FrontierPoints(row[i][met], points[met], error[met])


def _turns(contours: Contours, phi: Array) -> Array:
    """(3, k) where the angle turns back along the loops: row position, angle there, and 1 (maximum)
    or -1, by a parabola through the neighbours."""
    turns: Array = compiled().turns(phi, contours.loop_starts, contours.linked, _PARABOLA)
    return turns


def _between(C: Array, T: Array, C_i: Array, T_i: Array) -> Array:
    """(k, 3) midpoints of the shortest links between pairs of rays, not finite if parallel."""
    cos = np.einsum("nk,nk->n", T, T_i)
    base = C_i - C
    along, along_i = T @ base, T_i @ base
    with np.errstate(divide="ignore", invalid="ignore"):
        det = 1 - cos**2
        d = (along - cos * along_i) / det
        d_i = (cos * along - along_i) / det
        middle: Array = (C + d[:, None] * T + C_i + d_i[:, None] * T_i) / 2
    return middle
