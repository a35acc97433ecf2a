"""Points on the surface between consecutive rims, along the epipolar curves.

A viewing ray touches the surface, so the epipolar curve through a rim point runs along the
ray there. Two corresponding points of consecutive rims with their two rays give the curve
between them by cubic Hermite interpolation, to fourth order in the step. Where the next rim
has no correspondent, as beside a T-junction and at the border of what is ever seen edge-on,
the osculating parabola goes on for about a step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours, Rim, Status
from ..geometry.arrays import Array, repeated
from .zipping import next_rows

Flags = NDArray[np.bool_]

_LEAST_AGREEMENT = 0.7  # cosine between chord and rays, and between the two normals
_ONWARD = 0.26  # rad that the normal may turn along a parabola beyond the last rim
_FARTHEST_ONWARD = 20  # spacings
_MOST_BETWEEN = 24  # points on a curve from rim to rim
_SURE_ONWARD = 0.1  # rad of the normal's turn after which a parabola counts half
_LONGEST_ROW_STEP = 8.0  # of the usual step along a rim, between rows that are joined


@dataclass(frozen=True)
class Samples:
    """Oriented points on the surface.

    Attributes:
        points: (n, 3) float64, metres.
        normals: (n, 3) float64, outward unit normals.
        weights: (n,) float64, 0 to 1: 1 on and between rims, less the farther a parabola was
            followed beyond the last rim.
    """

    points: Array
    normals: Array
    weights: Array

    def __len__(self) -> int:
        return len(self.points)


def swept_samples(contours: Sequence[Contours], rims: Sequence[Rim], spacing: float) -> Samples:
    """The good rim points, points between those that correspond, and some beyond the others.

    Args:
        contours: those the rims were made from, in any order.
        rims: one a stamp, with correspondents in the rim of ``prev_stamp_ns``.
        spacing: aimed at between points along the epipolar curves, metres.
    """
    views = {c.stamp_ns: c for c in contours}
    by_stamp = {rim.stamp_ns: rim for rim in rims if rim.stamp_ns in views}
    ends = {stamp: np.ones((len(rim), 2), bool) for stamp, rim in by_stamp.items()}
    parts = [_sure(np.zeros((0, 3)), np.zeros((0, 3)))]
    for stamp, rim in by_stamp.items():
        good = rim.status == Status.GOOD
        parts.append(_sure(rim.points[good], rim.normals[good]))
        stamp_before = rim.prev_stamp_ns
        previous = None if stamp_before is None else by_stamp.get(stamp_before)
        if previous is not None:
            both = ends[stamp], ends[previous.stamp_ns]
            parts.append(_between(rim, previous, views, spacing, both))
    for stamp, rim in by_stamp.items():
        parts.append(_onward(rim, views[stamp], ends[stamp], spacing))
    arrays = zip(*((p.points, p.normals, p.weights) for p in parts), strict=True)
    return Samples(*(np.concatenate(array) for array in arrays))


def _sure(points: Array, normals: Array) -> Samples:
    return Samples(points, normals, np.ones(len(points)))


def _between(
    rim: Rim,
    previous: Rim,
    views: Mapping[int, Contours],
    spacing: float,
    ends: tuple[Flags, Flags],
) -> Samples:
    """Points between a rim and the previous one, both ends left out.

    Args:
        ends: of the rim and of the previous one, (rows, 2): whether the curve through a point
            ends there against its ray and along it. Cleared where it goes on.
    """
    rows, P0, N0, known = _correspondents(rim, previous)
    rows, P0, N0 = rows[known], P0[known], N0[known]
    P1, N1 = rim.points[rows], rim.normals[rows]
    chord = P1 - P0
    length = np.linalg.norm(chord, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = chord / length[:, None]
        T0, T1 = (P - views[r.stamp_ns].centre for P, r in ((P0, previous), (P1, rim)))
        T0, T1 = (T / np.linalg.norm(T, axis=1, keepdims=True) for T in (T0, T1))
        cos0, cos1 = (T0 * along).sum(axis=1), (T1 * along).sum(axis=1)
    # On a concave stretch the two ends would leave the chord to one side: no rim is there.
    keep = (cos0 * cos1 > 0) & ((N0 * N1).sum(axis=1) > _LEAST_AGREEMENT)
    keep &= (np.abs(cos0) > _LEAST_AGREEMENT) & (np.abs(cos1) > _LEAST_AGREEMENT)
    ends[0][rows[keep], (cos1[keep] < 0).astype(np.intp)] = False
    before = np.floor(rim.prev[rows[keep]]).astype(np.intp)
    for row in (before, next_rows(previous.loop)[before]):
        ends[1][row, (cos0[keep] > 0).astype(np.intp)] = False
    keep &= length > spacing
    T0, T1 = np.sign(cos0)[:, None] * T0, np.sign(cos1)[:, None] * T1
    count = np.clip(np.ceil(length / spacing) - 1, 0, _MOST_BETWEEN)
    count = np.where(keep, count, 0).astype(np.intp)
    which, rank = repeated(count)
    s = ((rank + 1) / (count[which] + 1))[:, None]
    # Cubic Hermite curve with the rays as tangents, and how its normal turns.
    L = length[which, None]
    points = (
        (1 + 2 * s) * (1 - s) ** 2 * P0[which]
        + s**2 * (3 - 2 * s) * P1[which]
        + s * (1 - s) ** 2 * L * T0[which]
        + s**2 * (s - 1) * L * T1[which]
    )
    normals = (1 - s) * N0[which] + s * N1[which]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return _sure(points, normals)


def _onward(rim: Rim, view: Contours, ends: Flags, spacing: float) -> Samples:
    """Points along the osculating parabolas of good points, beyond the ends of the curves."""
    row, side = np.nonzero(ends & ((rim.status == Status.GOOD) & (rim.curvature > 0))[:, None])
    k_t = rim.curvature[row]
    count = np.minimum(_ONWARD / (k_t * spacing), _FARTHEST_ONWARD).astype(np.intp)
    which, rank = repeated(count)
    row, side, k_t = row[which], side[which], k_t[which, None]
    s = ((rank + 1) * spacing * np.where(side == 1, 1, -1))[:, None]
    points = rim.points[row] + s * view.T[row] - 0.5 * k_t * s**2 * rim.normals[row]
    normals = rim.normals[row] + k_t * s * view.T[row]
    # The error of a parabola grows with the cube of the way, its variance with the sixth power.
    weights = 1 / (1 + (k_t * s / _SURE_ONWARD)[:, 0] ** 6)
    return Samples(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), weights)


def _correspondents(
    rim: Rim, previous: Rim
) -> tuple[NDArray[np.intp], Array, Array, NDArray[np.bool_]]:
    """Rows of a rim, their correspondents' points and normals in the previous rim, and
    whether both are good and the correspondent is between two joined rows."""
    at = np.where(np.isfinite(rim.prev), rim.prev, -1)
    rows = np.flatnonzero((rim.status == Status.GOOD) & (at >= 0) & (at < len(previous)))
    before = np.floor(at[rows]).astype(np.intp)
    after = next_rows(previous.loop)[before]
    good = (previous.status[before] == Status.GOOD) & (previous.status[after] == Status.GOOD)
    part = (at[rows] - before)[:, None]
    points = (1 - part) * previous.points[before] + part * previous.points[after]
    normals = (1 - part) * previous.normals[before] + part * previous.normals[after]
    step = np.linalg.norm(previous.points[after] - previous.points[before], axis=1)
    if good.any():
        good &= step <= _LONGEST_ROW_STEP * np.median(step[good])
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return rows, points, normals, good
