"""Which of the epipolar candidates is the correspondent: both partners decide together.

One plane may meet a contour many times (concave outlines, several loops, a handle before
a body). The order rule has removed the half of them that run the wrong way. Of the
rest, the pair (one candidate in each partner) is kept whose three rays are tangent to
one plausible piece of surface: in front of the cameras, with normals that turn no more
than the view does, and with a radius of curvature no larger than the object's: a match
to another piece of the outline needs a far larger one. Depth then has to continue from
neighbour to neighbour.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from .contours import Contours
from .epipolar import Candidates
from .pencil import Pencil
from .quadric import SAME, Crossing

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_NORMAL_SCALE = 0.35  # rad by which a normal may turn beyond the turn of the view
_MOST_TURN = 0.7  # rad beyond that: the normals of two pieces that meet at a T-junction
_RADIUS = 2.0  # the largest radius of curvature, in radii of the object
_BLUR_PX = 2.0  # by which two crossings may disagree, whatever the radius
_JUMP = 8.0  # a step along the rim longer than this many usual ones
_RADIUS_JUMP = 0.25  # of the radius of curvature between neighbours, in the object's
_PIECE = 10  # samples
_NEIGHBOURS = 15  # samples, the window in which depth continues
_CONTENDERS = 6  # pairs of candidates that are held against the silhouettes
_OUTSIDE_COST = 2.0  # for each tolerance outside, up to 4
_JUMP_COST = 4.0  # for a jump of the depth by the object's radius


def candidate_crossings(pencil: Pencil, candidates: Candidates) -> tuple[Crossing, Array]:
    """What every candidate in one partner says.

    Returns:
        Crossing of arrays (n, K), NaN where there is no candidate, and (n, K) float64,
        the cost of its normal: 0 when it turned no more than the ray, infinite when it
        turned so much more that the two cannot be of one smooth surface.
    """
    row, fraction = candidates.row, candidates.fraction
    if not candidates.valid.size:
        return Crossing(*(fraction,) * 5), fraction
    cos, sin = pencil.rays(row, fraction)
    cross, cos_apart = pencil.crossing(np.where(candidates.valid, cos, np.nan), sin)
    turn = pencil.turn_of_normal(row, fraction, cos_apart)
    excess = np.maximum(turn - np.arcsin(np.minimum(np.abs(cross.sin), 1)), 0)
    cost = (excess / _NORMAL_SCALE) ** 2
    return cross, np.where(excess > _MOST_TURN, np.inf, cost)


def choose_pairs(
    contours: Contours,
    rows: Index,
    before: tuple[Crossing, Array],
    after: tuple[Crossing, Array],
    outside: Callable[[Array], Array],
    known: Array | None = None,
) -> tuple[Index, Index]:
    """The candidate of each sample in both partners.

    Args:
        contours: N samples.
        rows: (n,) which of them.
        before, after: ``candidate_crossings`` of the two partners, (n, A) and (n, B).
        outside: takes (p, 3) points to (p,) how far they lie outside other silhouettes,
            as multiples of what is tolerated; asked only where there is a choice.
        known: (N,) float64, depths that continue into these, metres, NaN where unknown.

    Returns:
        Two (n,) intp, columns of the candidates, -1 in both where no pair is possible.
    """
    (cross0, cost0), (cross1, cost1) = before, after
    n, A, B = len(rows), cross0.d.shape[1], cross1.d.shape[1]
    if not A or not B:
        none = np.full(n, -1)
        return none, none
    d0, a0 = cross0.d[:, :, None], cross0.a[:, :, None]
    d1, a1 = cross1.d[:, None, :], cross1.a[:, None, :]
    size = object_radius(contours, cross0.d)
    with np.errstate(divide="ignore", invalid="ignore"):
        # 2 (d_-1 - d_1) = radius (a_1 - a_-1); where a_-1 = a_1 it tells no radius.
        radius = 2 * (d0 - d1) / (a1 - a0)
        depth = d0 + a0 * radius / 2
        told = np.abs(a1 - a0) > SAME * (np.abs(a0) + np.abs(a1))
        depth = np.where(told, depth, (d0 + d1) / 2)
        # On a rim that is seen, k_t is not negative: the surface would hide it.
        bend = np.where(radius < 0, 4 * radius, radius) / size
        cost = np.where(told, np.log1p(bend**2), 0) + cost0[:, :, None] + cost1[:, None, :]
        blur = (
            _BLUR_PX
            * contours.radians_per_pixel
            * d0
            / np.minimum(np.abs(cross0.sin)[:, :, None], np.abs(cross1.sin)[:, None, :])
        )
        most = np.where(radius > 0, 0.5 * _RADIUS * size * np.abs(a1 - a0), 0) + blur
        possible = (d0 > 0) & (d1 > 0) & (np.abs(d0 - d1) <= most)
    possible &= ((cross0.d_other > 0)[:, :, None]) & ((cross1.d_other > 0)[:, None, :])
    possible &= np.isfinite(cost)
    cost = np.where(possible, cost, np.inf).reshape(n, -1)
    depth = depth.reshape(n, -1)

    # The cheapest few of each sample, cheapest first.
    column = np.argsort(cost, axis=1)[:, :_CONTENDERS]
    cost = np.take_along_axis(cost, column, axis=1)
    depth = np.take_along_axis(depth, column, axis=1)
    if column.shape[1] > 1:
        contested, which = np.nonzero(np.isfinite(cost) & np.isfinite(cost[:, 1:2]))
        where = contours.centre + depth[contested, which][:, None] * contours.T[rows[contested]]
        excess = np.nan_to_num(outside(where), nan=np.inf)
        cost[contested, which] += _OUTSIDE_COST * np.minimum(np.maximum(excess, 0), 4)
        best = np.argmin(cost, axis=1)[:, None]
        here = np.where(np.isfinite(cost), depth, np.nan)
        around = np.full(len(contours), np.nan) if known is None else known.copy()
        around[rows] = np.take_along_axis(here, best, axis=1)[:, 0]
        usual = _along_loops(contours, around)[rows]
        with np.errstate(invalid="ignore"):
            jump = np.abs(depth - usual[:, None]) / size
        cost += np.where(np.isfinite(jump), _JUMP_COST * np.minimum(jump, 1), 0)
    best = np.argmin(cost, axis=1)[:, None]
    found = np.isfinite(np.take_along_axis(cost, best, axis=1))[:, 0]
    chosen = np.take_along_axis(column, best, axis=1)[:, 0]
    return np.where(found, chosen // B, -1), np.where(found, chosen % B, -1)


def object_radius(contours: Contours, d: Array) -> float:
    """Half the object's width, metres, from the angle it fills and usual depths."""
    d = d[d > 0]
    distance = float(np.median(d)) if len(d) else 1.0
    return distance * contours.angular_radius


def _along_loops(contours: Contours, depth: Array) -> Array:
    """Median of the depth over the neighbours along each loop, (n,)."""
    usual = np.empty_like(depth)
    starts = contours.loop_starts
    for first, last in pairwise(starts):
        part = depth[first:last]
        known = np.isfinite(part)
        usual[first:last] = np.nan
        if known.any():
            usual[first:last][known] = median_filter(part[known], _NEIGHBOURS, mode="wrap")
    return usual


def nearest_position(
    pencil: Pencil, candidates: Candidates, depth: Array, curvature: Array
) -> Array:
    """Row position of each known point's correspondent in another frame.

    There the point lies inside the outline, by what the surface has curved away since:
    about angle^2 / (2 k_t distance). A candidate much farther off is on another piece.

    Args:
        pencil: of the contours, n samples, and the other frame's.
        candidates: epipolar candidates of the n samples there.
        depth: (n,) of their rim points, metres, NaN where unknown.
        curvature: (n,) k_t, 1/metre.

    Returns:
        (n,) float64, row plus fraction of the candidate whose ray passes nearest to the
        point, NaN where there is none.
    """
    if not candidates.valid.size:
        return np.full(len(depth), np.nan)
    column = nearest_column(pencil, candidates, depth, curvature)
    here = np.arange(len(depth))
    position = candidates.row[here, column] + candidates.fraction[here, column]
    return np.where(column < 0, np.nan, position)


def nearest_column(pencil: Pencil, candidates: Candidates, depth: Array, curvature: Array) -> Index:
    """(n,) column of the candidate that ``nearest_position`` takes, -1 if there is none."""
    n = len(depth)
    if not candidates.valid.size:
        return np.full(n, -1)
    x, y = depth * pencil.here.cos - pencil.baseline, depth * pencil.here.sin
    cos, sin = pencil.rays(candidates.row, candidates.fraction)
    distance = np.sqrt(x**2 + y**2)
    miss = np.abs(sin * (x / distance)[:, None] - cos * (y / distance)[:, None])
    miss = np.where(candidates.valid & np.isfinite(miss), miss, np.inf)
    here, best = np.arange(n), np.argmin(miss, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.arctan2(sin[here, best], cos[here, best]) - pencil.here.alpha
        curved_away = turn**2 / (2 * np.abs(curvature) * distance)
        blur = _BLUR_PX * pencil.other.radians_per_pixel
        near = miss[here, best] <= blur + 2 * curved_away
    return np.where(near, best, -1)


def small_pieces(
    points: Array, curvature: Array, good: NDArray[np.bool_], contours: Contours
) -> NDArray[np.bool_]:
    """Good samples on a stretch of continuous surface of fewer than a few samples.

    A jump of the depth or of the radius of curvature along the contour starts a new
    piece; a short piece between two jumps is a match that its neighbours do not confirm,
    of a contour that comes out from behind another in one of the partners.

    Args:
        points: (n, 3) rim points, metres.
        curvature: (n,) k_t, 1/metre.
        good: (n,) which of them count.
        contours: the n samples.

    Returns:
        (n,) bool.
    """
    after = contours.next_row
    both = good & good[after]
    if not both.any():
        return good.copy()
    step = _length(points.take(after, axis=0) - points)
    size = np.median(_length(points[good] - contours.centre)) * contours.angular_radius
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = 1 / curvature
        joined = both & (step <= _JUMP * np.median(step[both]))
        joined &= np.abs(radius[after] - radius) <= _RADIUS_JUMP * size
    piece = np.cumsum(~joined[contours.previous_row])
    for first, last in pairwise(contours.loop_starts):
        if joined[last - 1]:  # a piece goes on through the seam of the loop
            piece[first:last][piece[first:last] == piece[last - 1]] = piece[first]
    return good & (np.bincount(piece)[piece] < _PIECE)


def _length(vectors: Array) -> Array:
    """(n,) of (n, 3)."""
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))
