"""Poses and calibration corrected by the contours alone.

What is asked grows: nothing; what all views share (where the camera sees the axis or the object
frame, focal length, principal point); the steps of a table; each view's pose. A group is corrected
only if that explains pairs of views which were left out of the fit, and by more than chance.
After Mendonca, Wong and Cipolla, IEEE PAMI 23(6), 2001, doi:10.1109/34.927465.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours

from .refine_rig import Axis, Corrections, common_axis
from .refine_solve import Solution, Source, scale_of, solve
from .refine_tangencies import HullView, Tangencies

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_FEWEST = 5  # views with an outline
_BLOCKS = 6  # of views that follow each other; pairs of blocks are left out together
_FOLDS = 3
_SURE = 2.0  # standard errors by which what was left out must gain
_WORTH = 0.03  # least share of the residual that must go
_GOOD_ENOUGH = 1.0  # sigmas of the outlines: right calibrations stay below it
_GOOD_ENOUGH_PX = 0.3
_DETERMINED = 0.5  # of a prior's variance that the residuals must take away


@dataclass(frozen=True)
class Trial:
    """A set of groups, and what it explains.

    Attributes:
        groups: that were corrected.
        left_out_px: robust residual of pairs of views that were left out, px.
        gain: of the robust loss there against the set that was best before, in standard errors.
        better: whether it takes the place of that one.
    """

    groups: tuple[str, ...]
    left_out_px: float
    gain: float = 0.0
    better: bool = False


@dataclass(frozen=True)
class Refinement:
    """Corrected cameras and how far they are to be believed.

    Attributes:
        cameras: n, corrected; as given where nothing gained.
        groups: that were corrected.
        before_px, after_px: how far apart two views see the planes that touch the object, 1
            sigma, robust, px.
        before, after: the same in sigmas of the outlines.
        trials: what was tried, in order.
        axis: that the cameras go around, if they do.
        undetermined: groups that the contours say nothing of.
        covariance: (n, 6, 6) float64, of each camera's rotation (rad) and centre (m) in its own
            frame; along the gauge (place, turn and scale of the object) that of the prior.
        common: (9,) float64, corrections that all views share: rotation about x, y and z (rad),
            shift (m), share of the focal length, cx and cy (px).
        common_sigma: (9,) their standard deviations.
        steps: (n,) float64, corrections of the angles about the axis, rad.
        views_px: (n,) float64, by how much each view was corrected by itself, px.
    """

    cameras: list[Camera]
    groups: tuple[str, ...]
    before_px: float
    after_px: float
    before: float
    after: float
    trials: list[Trial] = field(default_factory=list)
    axis: Axis | None = None
    undetermined: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))
    common: Array = field(default_factory=lambda: np.zeros(9))
    common_sigma: Array = field(default_factory=lambda: np.zeros(9))
    steps: Array = field(default_factory=lambda: np.zeros(0))
    views_px: Array = field(default_factory=lambda: np.zeros(0))


def refine(
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    always: bool = False,
    progress: Progress = lambda done, total: None,
) -> Refinement:
    """Correct cameras so that the outlines agree.

    Args:
        contours: one a camera, None where a view has none; they may have been made with any pose.
        cameras: n, as given.
        always: also where the outlines agree already as well as they are known.
        progress: told how far it is.

    Raises:
        ValueError: fewer than five views with an outline that look at one thing.
    """
    hulls = [
        None if c is None else HullView.of(c, camera)
        for c, camera in zip(contours, cameras, strict=True)
    ]
    if sum(h is not None for h in hulls) < _FEWEST:
        raise ValueError(f"poses can be refined from {_FEWEST} views with an outline at least")
    tangencies = Tangencies(hulls)
    middle, radius = _place(tangencies.rays(cameras), cameras, hulls)
    axis = common_axis(cameras)
    corrections = Corrections(cameras, middle, radius, axis)
    before_px, before = _agreement(tangencies, cameras)
    enough = before < _GOOD_ENOUGH or before_px < _GOOD_ENOUGH_PX
    if not np.isfinite(before) or (enough and not always):
        return Refinement(list(cameras), (), before_px, before_px, before, before, axis=axis)
    best, trials, tried = _chosen(corrections, tangencies, _sets(axis), progress)
    if best is None:
        return Refinement(
            list(cameras),
            (),
            before_px,
            before_px,
            before,
            before,
            trials,
            axis,
            _undetermined(corrections, tried),
        )
    corrected = corrections.of(best.x)
    after_px, after = _agreement(tangencies, corrected)
    common, sigma = corrections.common(best.x, best.covariance)
    return Refinement(
        corrected,
        next(trial.groups for trial in reversed(trials) if trial.better),
        before_px,
        after_px,
        before,
        after,
        trials,
        axis,
        _undetermined(corrections, tried),
        corrections.covariance(corrected, best.covariance),
        common,
        sigma,
        corrections.steps(best.x),
        np.sqrt((best.x[corrections.groups["views"]].reshape(-1, 6) ** 2).sum(axis=1)),
    )


def _sets(axis: Axis | None) -> list[tuple[str, ...]]:
    """Groups to be tried, from few parameters to many."""
    if axis is None:
        return [("common",), ("common", "views")]
    return [("common",), ("common", "steps"), ("common", "views"), ("common", "steps", "views")]


def _chosen(
    corrections: Corrections,
    tangencies: Tangencies,
    sets: Sequence[tuple[str, ...]],
    progress: Progress,
) -> tuple[Solution | None, list[Trial], list[tuple[tuple[str, ...], Solution]]]:
    """The best set of groups by what it explains of pairs that were left out."""
    source, cell = tangencies.residuals, _cells(tangencies)
    fold = cell % _FOLDS
    tried: list[tuple[tuple[str, ...], Solution]] = []
    left_out = [_left_out(corrections, source, np.zeros(len(corrections)), fold >= 0)]
    total = (1 + _FOLDS) * len(sets)
    for groups in sets:
        start = tried[-1][1].x if tried else None
        found = solve(corrections, source, groups, start=_kept(corrections, start, groups))
        progress(len(tried) * (1 + _FOLDS) + 1, total)
        z = np.full(len(fold), np.nan)
        for k in range(_FOLDS):
            part = solve(corrections, source, groups, fold != k, found.x, found.prior, found.noise)
            mine = fold == k
            z[mine] = _left_out(corrections, source, part.x, mine)[mine]
            progress(len(tried) * (1 + _FOLDS) + 2 + k, total)
        tried.append((groups, found))
        left_out.append(z)
    noise = min(scale_of(z[np.isfinite(z)]) for z in left_out)
    pixel = tangencies.usual_sigma
    trials = [Trial((), pixel * scale_of(left_out[0][np.isfinite(left_out[0])]), better=True)]
    best, best_z = None, left_out[0]
    for (groups, found), z in zip(tried, left_out[1:], strict=True):
        known = np.isfinite(z) & np.isfinite(best_z)
        gain = np.bincount(cell[known], (_loss(best_z, noise) - _loss(z, noise))[known])
        gain = gain[np.bincount(cell[known]) > 0]
        error = np.sqrt(len(gain)) * np.std(gain, ddof=1)
        scores = float(gain.sum() / max(error, 1e-12))
        less = scale_of(z[known]) < (1 - _WORTH) * scale_of(best_z[known])
        trials.append(Trial(groups, pixel * scale_of(z[known]), scores, scores > _SURE and less))
        if trials[-1].better:
            best, best_z = found, z
    return best, trials, tried


def _kept(corrections: Corrections, x: Array | None, groups: Sequence[str]) -> Array | None:
    """Parameters of some groups, the others zero."""
    if x is None:
        return None
    kept = np.zeros_like(x)
    for group in groups:
        kept[corrections.groups[group]] = x[corrections.groups[group]]
    return kept


def _left_out(corrections: Corrections, source: Source, x: Array, used: NDArray[np.bool_]) -> Array:
    """(all,) residuals in sigmas, NaN where there is none."""
    residuals, place = source(corrections.of(x))
    z = np.full(len(used), np.nan)
    z[place] = residuals.value / residuals.sigma
    return z


def _loss(z: Array, noise: float) -> Array:
    loss: Array = np.log1p((z / (2 * noise)) ** 2)
    return loss


def _cells(tangencies: Tangencies) -> NDArray[np.intp]:
    """(all,) number of the pair of blocks of views that each residual belongs to. Numbers count
    on along diagonals, so that every block has partners in each fold."""
    seen = np.unique(tangencies.pairs)
    blocks = min(_BLOCKS, max(2, len(seen) // 2))
    of = np.zeros(int(seen.max()) + 1, np.intp)
    of[seen] = np.arange(len(seen)) * blocks // len(seen)
    i, j = of[tangencies.pairs]
    cells = (i + j) % _FOLDS + _FOLDS * (i * blocks + j)
    return np.repeat(cells, 2)


def _agreement(tangencies: Tangencies, cameras: Sequence[Camera]) -> tuple[float, float]:
    """How far apart two views see one plane, robust 1 sigma: in px, and in sigmas."""
    residuals, _ = tangencies.residuals(cameras)
    if len(residuals) < 2 * _FEWEST:
        return float("nan"), float("nan")
    px = 1.4826 * float(np.median(np.abs(residuals.value)))
    return px, 1.4826 * float(np.median(np.abs(residuals.value / residuals.sigma)))


def _undetermined(
    corrections: Corrections, tried: Sequence[tuple[tuple[str, ...], Solution]]
) -> tuple[str, ...]:
    """Groups of which the residuals take away little of the prior's variance."""
    found = []
    for groups, solution in tried:
        group = groups[-1]
        left = np.diag(solution.covariance)[corrections.groups[group]]
        told = 1 - left.mean() / solution.prior[group] ** 2
        if group != "common" and group not in found and told < _DETERMINED:
            found.append(group)
    return tuple(found)


def _place(
    rays: Array, cameras: Sequence[Camera], hulls: Sequence[HullView | None]
) -> tuple[Array, float]:
    """The point (3,) nearest to the views' middle rays, and the object's radius, metres."""
    seen = np.flatnonzero([h is not None for h in hulls])
    C = np.array([cameras[k].centre for k in seen.tolist()])
    looks = rays[seen].mean(axis=1)
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    across = np.eye(3) - looks[:, :, None] * looks[:, None, :]
    b = np.einsum("nij,nj->ni", across, C).ravel()
    middle: Array = np.linalg.lstsq(across.reshape(-1, 3), b, rcond=None)[0]
    cos = np.einsum("nmk,nk->nm", rays[seen], looks).min(axis=1)
    away = np.linalg.norm(C - middle, axis=1)
    return middle, float(np.median(away * np.tan(np.arccos(np.clip(cos, 0.1, 1)))))
