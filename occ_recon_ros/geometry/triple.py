"""Depth and curvature of a view's samples from two partners: three contours, the paper's steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .epipolar import Candidates, epipolar_candidates
from .estimators import Rays
from .matching import candidate_crossings, choose_pairs
from .pencil import Pencil
from .quadric import Crossing, Solution, amplification, depth_sigma, solve, solve_at_partner
from .rim import Status

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Partner:
    """What another view says of some samples of a view, by all its candidates.

    Attributes:
        rows: (m,) intp, ascending, the samples.
        pencil: of both views, for these samples.
        candidates: their epipolar candidates.
        cross: crossings (m, K) of each ray with its candidates'.
        cost: (m, K) float64, of the candidates' normals.
    """

    rows: Index
    pencil: Pencil
    candidates: Candidates
    cross: Crossing
    cost: Array

    @staticmethod
    def of(contours: Contours, other: Contours, rows: Index | None = None) -> Partner:
        """Look up the candidates of all samples, or of some."""
        pencil = Pencil(contours, other)
        if rows is None:
            rows = np.arange(len(contours))
        else:
            pencil = pencil.some(rows)
        candidates = epipolar_candidates(pencil)
        return Partner(rows, pencil, candidates, *candidate_crossings(pencil, candidates))

    def some(self, rows: Index) -> Partner:
        """For fewer samples."""
        if len(rows) == len(self.rows):
            return self
        at = np.searchsorted(self.rows, rows)
        pencil, candidates = self.pencil.some(at), self.candidates.rows(at)
        return Partner(rows, pencil, candidates, self.cross.rows(at), self.cost[at])


@dataclass
class Estimate:
    """What is known of each sample: (n,) arrays, written in place when more is learnt.

    Attributes:
        depth: metres along the ray, NaN where unknown.
        curvature: k_t, 1/metre.
        sigma: of the depth, metres.
        status: a Status.
    """

    depth: Array
    curvature: Array
    sigma: Array
    status: NDArray[np.uint8]

    def put(self, rows: Index, other: Estimate, take: NDArray[np.bool_]) -> None:
        """Take over those of an estimate of some rows that are to be taken."""
        rows = rows[take]
        self.depth[rows], self.curvature[rows] = other.depth[take], other.curvature[take]
        self.sigma[rows], self.status[rows] = other.sigma[take], other.status[take]


Revise = Callable[[Solution, Array, tuple[Rays, Rays]], tuple[Solution, Array]]


def estimate(
    contours: Contours,
    before: Partner,
    after: Partner,
    outside: Callable[[Array], Array],
    most_gain: float,
    depth: Array | None = None,
    revise: Revise | None = None,
) -> tuple[Estimate, Index]:
    """Solve the samples of two partners (of the same m rows).

    Args:
        contours: the view.
        before, after: its partners.
        outside: as for ``choose_pairs``.
        most_gain: amplification above which a sample is ill-conditioned.
        depth: (n,) what is known of all samples' depths, to continue; or None.
        revise: another estimator, which starts from the solution.

    Returns:
        What is found, and (m,) the column of the candidate in the first partner.
    """
    rows = before.rows
    # Epipolar correspondence (section 3).
    columns = choose_pairs(
        contours, rows, (before.cross, before.cost), (after.cross, after.cost), outside, depth
    )
    one, two = before.candidates.column(columns[0]), after.candidates.column(columns[1])
    first, second = before.pencil.other, after.pencil.other

    # Depth and curvature from three contours (sections 4 and 5).
    cross0, cross1 = before.cross.column(columns[0]), after.cross.column(columns[1])
    solution = solve(cross0, cross1)
    own = contours.sigma[rows]
    sigma = depth_sigma(cross0, cross1, own, _sigma(first, one), _sigma(second, two))
    gain = amplification(cross0, cross1)
    solution = _solve_at_partner(solution, contours, rows, cross1, (first, one), (second, two))
    if revise is not None:
        solution, sigma = revise(solution, sigma, (rays(first, one), rays(second, two)))

    status = solution.status.copy()
    status[(status == Status.GOOD) & ~(gain <= most_gain)] = Status.ILL_CONDITIONED
    status[(columns[0] < 0) | ~np.isfinite(own)] = Status.NO_CORRESPONDENT
    status[before.candidates.along_ray | after.candidates.along_ray] = Status.MOTION_ALONG_RAY
    gone = (status == Status.NO_CORRESPONDENT) | (status == Status.MOTION_ALONG_RAY)
    known = np.where(gone | ~(solution.depth > 0), np.nan, solution.depth)
    status[~gone & np.isnan(known)] = Status.ILL_CONDITIONED
    return Estimate(known, solution.curvature, sigma, status), columns[0]


def _solve_at_partner(
    solution: Solution,
    contours: Contours,
    rows: Index,
    after: Crossing,
    first: tuple[Contours, Candidates],
    second: tuple[Contours, Candidates],
) -> Solution:
    """Fill in the ill-conditioned samples by way of the second partner."""
    at = np.flatnonzero(solution.status == Status.ILL_CONDITIONED)
    if not len(at):
        return solution
    one, two = (rays(partner, where.rows(at)) for partner, where in (first, second))
    depth, curvature = solution.depth.copy(), solution.curvature.copy()
    filled = solve_at_partner(
        Solution(depth[at], curvature[at], solution.status[at]),
        after.rows(at),
        (two.centre, two.T, two.N),
        (contours.centre, contours.T[rows[at]]),
        (one.centre, one.T),
    )
    depth[at], curvature[at] = filled.depth, filled.curvature
    return Solution(depth, curvature, solution.status)


def rays(partner: Contours, at: Candidates) -> Rays:
    """Rays of the candidates (K = 1), rows NaN where there is none."""
    missing = ~at.valid[:, 0]
    T = at.directions(partner)[:, 0]
    N = at.interpolate(partner.N, partner.next_row)[:, 0]
    T[missing] = np.nan
    N = N / np.linalg.norm(N, axis=1, keepdims=True)
    return Rays(partner.centre, T, N, _sigma(partner, at))


def rays_at(partner: Contours, position: Array) -> Rays:
    """Rays at fractional rows (n,) of a frame, NaN where the row is."""
    known = np.isfinite(position)
    # Row and fraction may have rounded up to the row past the last.
    row = np.minimum(np.where(known, position, 0), len(partner) - 1).astype(np.intp)
    fraction = np.where(known, position - row, 0.0)
    return rays(partner, Candidates(known[:, None], row[:, None], fraction[:, None], ~known))


def _sigma(partner: Contours, at: Candidates) -> Array:
    """(n,) sigma of the candidates (K = 1), NaN where there is none."""
    # A sample beside a corner counts as a correspondent, though not as a rim point: it is
    # worth ten times less than the usual one.
    sigma = np.minimum(partner.sigma, 10 * partner.usual_sigma)[at.row[:, 0]]
    return np.where(at.valid[:, 0], sigma, np.nan)
