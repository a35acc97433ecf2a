"""Corrections that make the views agree: robust least squares with priors found on the way.

Each group of parameters has a normal prior about zero. That of the common ones is wide, that of
the lens what calibrations are usually good for, each parameter by itself more where it must be. How
far steps and single views stray is estimated with them (empirical Bayes: the prior variance is the
mean square of the parameters plus their own uncertainty), so that groups which explain nothing stay
where they are. So is the scale of the noise, from the residuals.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix, diags

from occ_recon_ros.geometry.arrays import Array, robust_sigma

from .refine_rig import WIDE_PX, Corrections, Rig
from .refine_tangencies import Residuals

Source = Callable[[Rig], tuple[Residuals, NDArray[np.intp]]]

SURE = 2.0  # standard errors that are no chance
_FREE_PX = 2.0  # prior of steps and views to begin with
_LEAST_PX = 1e-3
_CAUCHY = 2.0  # sigmas of noise where a residual begins to count less
_MOST_ROUNDS = 12  # in which noise and priors are found
_MOST_STEPS = 3  # in a round
_MOST_DAMPING = 1e2
_LITTLE = 0.5  # log-likelihood that a step or a round gains when it is the last
_SETTLED = 0.05  # change of a standard deviation
_UNTOUCHED_PX = 0.01
_LEAST_NOISE = 0.3  # of what the outlines' sigmas predict


@dataclass(frozen=True)
class Adjustment:
    """What the residuals ask for.

    Attributes:
        x: (p,) float64, parameters, px; zero where the group was not asked.
        covariance: (p, p) float64, px^2, of the asked ones; the prior's along the gauge.
        noise: scale of the residuals' sigmas that the residuals bear out.
        prior: standard deviation of each group, px; of the lens (5,) or its focal length (1,), in
            what these are usually known to.
        free: (p,) which parameters were asked.
        information: (p, p) float64, of the residuals alone, 1/px^2.
    """

    x: Array
    covariance: Array
    noise: float
    prior: dict[str, Array]
    free: NDArray[np.bool_]
    information: Array


def solve(
    corrections: Corrections,
    source: Source,
    groups: Sequence[str],
    used: NDArray[np.bool_] | None = None,
    start: Array | None = None,
    prior: Mapping[str, Array] | None = None,
    noise: float | None = None,
) -> Adjustment:
    """Fit groups of parameters.

    Args:
        corrections: of the cameras.
        source: residuals of given cameras, and the place of each in a list of all.
        groups: of ``corrections.groups``, to be fitted.
        used: (all,) places of residuals that count; None: all.
        start: (p,) parameters to begin with, and to keep those that are not fitted at.
        prior: standard deviations that are not to be estimated, px.
        noise: scale of the residuals' sigmas, if it is not to be estimated.
    """
    size = len(corrections)
    free = np.zeros(size, bool)
    for group in groups:
        free[corrections.groups[group]] = True
    x = np.zeros(size) if start is None else start.copy()
    fixed = {"common": np.array(WIDE_PX), **(prior or {})}
    lens_px = {g: corrections.lens_of(g) for g in ("lens", "focal")}
    first = {g: np.ones(len(usual)) for g, usual in lens_px.items()} | fixed
    spread = {g: first.get(g, np.array(_FREE_PX)) for g in groups}
    problem = _Problem(corrections, source, used, free)
    now = problem.at(x)
    given, noise = noise, noise or scale_of(now.z)
    for _ in range(_MOST_ROUNDS):
        inverse = _inverse_prior(corrections, groups, spread)
        x, now, A, gain = _descended(problem, x, now, noise, inverse)
        settled = gain < _LITTLE
        new = given or scale_of(now.z)
        settled &= abs(np.log(new / noise)) < _SETTLED
        noise = new
        asked = [g for g in groups if g not in fixed]
        covariance = _inverted(A + np.diag(inverse[free])) if asked else None
        for group in asked:
            assert covariance is not None
            mine = corrections.groups[group]
            at = np.cumsum(free)[mine] - 1
            square = x[mine] ** 2 + np.diag(covariance)[at]
            if group in lens_px:
                own = np.maximum(np.sqrt(square) / lens_px[group], 1.0)
            else:
                own = np.maximum(np.sqrt(square.mean()), _LEAST_PX)
            close = _SETTLED * np.maximum(own, _UNTOUCHED_PX / _SETTLED)
            settled &= bool((np.abs(own - spread[group]) < close).all())
            spread[group] = own
        if settled:
            break
    full, information = np.zeros((2, size, size))
    full[np.ix_(free, free)] = _inverted(A + np.diag(inverse[free]))
    information[np.ix_(free, free)] = A
    return Adjustment(x, full, noise, spread, free, information)


@dataclass(frozen=True)
class Asked:
    """What residuals ask of some parameters where all is fitted but a group.

    Attributes:
        x: (q,) float64, where the next step would take them, px.
        sigma: (q,) float64, of that. The samples of one outline have their errors in common,
            and each outline is in the residuals of all its pairs: variances are those of sums
            over views (dyadic clusters: Aronow, Samii and Assenova, Political Analysis 23(4),
            2015, doi:10.1093/pan/mpv018), but never less than those of independent residuals.
        dependence: mean ratio of these to those of independent residuals.
    """

    x: Array
    sigma: Array
    dependence: float

    @property
    def certainty(self) -> float:
        """The largest of them in standard deviations."""
        return float(np.max(np.abs(self.x) / self.sigma))


def asked(
    corrections: Corrections,
    source: Source,
    owners: NDArray[np.intp],
    solution: Adjustment,
    columns: NDArray[np.intp],
) -> Asked:
    """What residuals ask of parameters beside those of a solution.

    Args:
        corrections, source: as of ``solve``.
        owners: (all, 2) the views whose outlines each residual compares.
        solution: where all is fitted but the parameters.
        columns: (q,) the parameters.
    """
    free = solution.free.copy()
    free[columns] = True
    state = _Problem(corrections, source, None, free).at(solution.x)
    inverse = _inverse_prior(corrections, tuple(solution.prior), solution.prior)[free]
    w = weights(state.z, solution.noise) / solution.noise**2
    mine = np.cumsum(free)[columns] - 1
    left = _inverted(_normal(state.J, w) + np.diag(inverse))
    pull = w * state.z
    step = left[mine] @ (state.J.T @ pull + inverse * solution.x[free])
    x = solution.x[columns] - step
    naive = np.diag(left)[mine]
    shares = (state.J @ left[:, mine]) * pull[:, None]
    a, b = owners[state.place].T
    summed = np.zeros((2, int(owners.max()) + 1, len(columns)))
    np.add.at(summed[0], a, shares)
    np.add.at(summed[1], b[a != b], shares[a != b])
    # What a pair of views says twice of itself is counted once.
    pair = np.unique(state.place[a != b] // 2, return_inverse=True)[1]
    twice = np.zeros((int(pair.max(initial=-1)) + 1, len(columns)))
    np.add.at(twice, pair, shares[a != b])
    robust = (summed.sum(axis=0) ** 2).sum(axis=0) - (twice**2).sum(axis=0)
    variance = np.maximum(robust, naive)
    return Asked(x, np.sqrt(variance), float(np.mean(variance / naive)))


@dataclass(frozen=True)
class _State:
    """Residuals at one place: in their sigmas, their derivatives, their places in the list."""

    z: Array
    J: csr_matrix
    place: NDArray[np.intp]


@dataclass(frozen=True)
class _Problem:
    corrections: Corrections
    source: Source
    used: NDArray[np.bool_] | None
    free: NDArray[np.bool_]

    def at(self, x: Array) -> _State:
        rig = self.corrections.of(x)
        residuals, place = self.source(rig)
        J = self.corrections.chain(residuals.by_camera, residuals.camera, rig)
        z, J = residuals.value / residuals.sigma, diags(1 / residuals.sigma) @ J
        if self.used is not None:
            kept = self.used[place]
            z, J, place = z[kept], J[kept], place[kept]
        return _State(z, J[:, self.free], place)


def _descended(
    problem: _Problem, x: Array, now: _State, noise: float, inverse: Array
) -> tuple[Array, _State, Array, float]:
    """Levenberg and Marquardt's steps with the weights of Cauchy's loss, the noise and the priors
    (``inverse``: 1 / variance of all parameters) as they are."""
    free, damping, total = problem.free, 1e-3, 0.0
    inverse = inverse[free]
    for _ in range(_MOST_STEPS):
        w = weights(now.z, noise)
        A = _normal(now.J, w / noise**2)
        g = now.J.T @ (w * now.z) / noise**2 + inverse * x[free]
        while damping < _MOST_DAMPING:
            H = A + np.diag(inverse)
            H[np.diag_indices_from(H)] *= 1 + damping
            move = -cho_solve(cho_factor(H), g)
            new_x = x.copy()
            new_x[free] += move
            new = problem.at(new_x)
            gain = _loss(now, new.place, noise) - _loss(new, now.place, noise)
            gain += 0.5 * float(inverse @ (x[free] ** 2 - new_x[free] ** 2))
            if gain >= 0:
                damping = max(damping / 10, 1e-6)
                break
            damping *= 10
        else:
            break
        x, now, total = new_x, new, total + gain
        if gain < _LITTLE:
            break
    w = weights(now.z, noise)
    return x, now, _normal(now.J, w / noise**2), total


def _inverted(A: Array) -> Array:
    inverse: Array = cho_solve(cho_factor(A), np.eye(len(A)))
    return inverse


def _normal(J: csr_matrix, w: Array) -> Array:
    matrix: Array = (J.T @ diags(w) @ J).toarray()
    return matrix


def weights(z: Array, noise: float) -> Array:
    """Of residuals in sigmas, by Cauchy's loss."""
    return 1 / (1 + (z / (_CAUCHY * noise)) ** 2)


def _loss(state: _State, place: NDArray[np.intp], noise: float) -> float:
    """Of the residuals that are at places too."""
    z = state.z[np.isin(state.place, place)]
    return float(0.5 * _CAUCHY**2 * np.log1p((z / (_CAUCHY * noise)) ** 2).sum())


def scale_of(z: Array) -> float:
    """Robust standard deviation about zero."""
    return max(robust_sigma(z), _LEAST_NOISE) if len(z) else 1.0


def _inverse_prior(
    corrections: Corrections, groups: Sequence[str], spread: Mapping[str, Array]
) -> Array:
    inverse = np.full(len(corrections), 1.0)
    for group in groups:
        inverse[corrections.groups[group]] = spread[group] ** -2
    lens = corrections.groups["lens"]
    inverse[lens] /= corrections.lens_px**2
    return inverse
