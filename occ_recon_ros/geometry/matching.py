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

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from .contours import Contours
from .epipolar import Candidates
from .quadric import Crossing, crossing, dot

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_NORMAL_SCALE = 0.35  # rad by which a normal may turn beyond the turn of the view
_NEIGHBOURS = 15  # samples, the window in which depth continues


def candidate_crossings(
    contours: Contours, partner: Contours, candidates: Candidates
) -> tuple[Crossing, Array]:
    """What every candidate in one partner says.

    Returns:
        Crossing of arrays (n, K), NaN where there is no candidate, and (n, K) float64,
        the cost of its normal: 0 when it turned no more than the ray.
    """
    T_i = candidates.directions(partner)
    T_i[~candidates.valid] = np.nan
    cross = crossing(contours.centre, contours.T[:, None], contours.N[:, None], partner.centre, T_i)
    N_i = candidates.interpolate(partner.N, partner.next_row)
    turn = np.arccos(np.clip(dot(contours.N[:, None], N_i), -1, 1))
    excess = np.maximum(turn - np.arcsin(np.minimum(np.abs(cross.sin), 1)), 0)
    return cross, (excess / _NORMAL_SCALE) ** 2


def choose_pairs(
    contours: Contours, before: tuple[Crossing, Array], after: tuple[Crossing, Array]
) -> tuple[Index, Index]:
    """The candidate of each sample in both partners.

    Args:
        contours: n samples.
        before, after: ``candidate_crossings`` of the two partners, (n, A) and (n, B).

    Returns:
        Two (n,) intp, columns of the candidates, -1 in both where no pair is possible.
    """
    (cross0, cost0), (cross1, cost1) = before, after
    n, A, B = len(contours), cross0.d.shape[1], cross1.d.shape[1]
    none = np.full(n, -1)
    if not A or not B:
        return none, none
    d0, a0 = cross0.d[:, :, None], cross0.a[:, :, None]
    d1, a1 = cross1.d[:, None, :], cross1.a[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = 2 * (d0 - d1) / (a1 - a0)
        depth = d0 + a0 * radius / 2
        size = _object_radius(contours, cross0)
        # On a rim that is seen, k_t is not negative: the surface would hide it.
        bend = np.where(radius < 0, 4 * radius, radius) / size
        cost = np.log1p(bend**2) + cost0[:, :, None] + cost1[:, None, :]
    seen = (d0 > 0) & (d1 > 0)
    seen &= ((cross0.d_other > 0)[:, :, None]) & ((cross1.d_other > 0)[:, None, :])
    cost = np.where(seen & np.isfinite(cost), cost, np.inf).reshape(n, -1)
    depth = depth.reshape(n, -1)
    best = np.argmin(cost, axis=1)
    rows = np.arange(n)
    found = np.isfinite(cost[rows, best])
    if A * B > 1:
        usual = _along_loops(contours, np.where(found, depth[rows, best], np.nan))
        with np.errstate(invalid="ignore"):
            jump = np.abs(depth - usual[:, None]) / size
        cost = cost + np.where(np.isfinite(jump), np.log1p(jump**2), 0)
        best = np.argmin(cost, axis=1)
    return np.where(found, best // B, -1), np.where(found, best % B, -1)


def _object_radius(contours: Contours, cross: Crossing) -> float:
    """Half the object's width, metres, from the angle it fills and its usual distance."""
    d = cross.d[cross.d > 0]
    distance = float(np.median(d)) if len(d) else 1.0
    middle = contours.T.mean(axis=0)
    return distance * float(np.linalg.norm(contours.T - middle, axis=1).max())


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


def nearest_position(points: Array, other: Contours, candidates: Candidates) -> Array:
    """Row position of each known point's correspondent in another frame.

    Args:
        points: (n, 3) rim points, metres, NaN where unknown.
        other: the other frame's contours.
        candidates: epipolar candidates of the n samples there.

    Returns:
        (n,) float64, row plus fraction of the candidate whose ray passes nearest to the
        point, NaN where there is none.
    """
    n = len(points)
    if not candidates.valid.shape[1]:
        return np.full(n, np.nan)
    ray = points - other.centre
    ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    miss = np.linalg.norm(candidates.directions(other) - ray[:, None], axis=-1)
    miss = np.where(candidates.valid & np.isfinite(miss), miss, np.inf)
    here, best = np.arange(n), np.argmin(miss, axis=1)
    position = candidates.row[here, best] + candidates.fraction[here, best]
    return np.where(np.isfinite(miss[here, best]), position, np.nan)
