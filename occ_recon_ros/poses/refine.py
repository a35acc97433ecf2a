"""Poses and calibration corrected by the contours alone.

What is asked grows: nothing; what all views share (where the camera sees the axis or the object
frame, focal length, principal point); the steps of a table; each view's pose. A group is corrected
only if that explains pairs of views which were left out of the fit, and by more than chance.
First by the planes that touch two outlines, then by these and by the rays of all outlines together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours

from .refine_coherence import Coherence
from .refine_rig import Axis, Corrections, Rig, common_axis, moved_alike
from .refine_solve import Solution, Source, scale_of, solve
from .refine_tangencies import HullView, Residuals, Tangencies, half_angles, joined

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_FEWEST = 5  # views with an outline
_MOST = 100  # of them: of more some are looked at
_BLOCKS = 6  # of views that follow each other; pairs of blocks are left out together
_FOLDS = 3
_SURE = 2.0  # standard errors by which what was left out must gain
_NOISE_ALONE = 1.15  # sigmas of the outlines: no more is for cameras to explain
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
            shift (m), log of the focal length, cx and cy (px).
        common_sigma: (9,) their standard deviations.
        steps: (n,) float64, corrections of the angles about the axis, rad.
        views_px: (n,) float64, by how much each view was corrected by itself, px.
        scale, middle: the factor by which, and the point (3,) about which, the corrected cameras
            were moved away from the object, so that a pixel is there as large as before: outlines
            know no scale, and calibrations know that size better than focal length or distance.
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
    scale: float = 1.0
    middle: Array = field(default_factory=lambda: np.zeros(3))


def refine(
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    always: bool = False,
    progress: Progress = lambda done, total: None,
    allowed: Sequence[str] = ("common", "steps", "views"),
) -> Refinement:
    """Correct cameras so that the outlines agree. Of more than 100 views some are looked at, and
    only what all share is corrected.

    Args:
        contours: one a camera, None where a view has none; made with these cameras.
        cameras: n, as given.
        always: also where the outlines agree already as well as they are known.
        progress: told how far it is.
        allowed: groups that may be corrected.

    Raises:
        ValueError: fewer than five views with an outline that look at one thing.
    """
    hulls = [
        None if c is None else HullView.of(c, camera)
        for c, camera in zip(contours, cameras, strict=True)
    ]
    seen = [k for k, hull in enumerate(hulls) if hull is not None]
    if len(seen) > _MOST:
        return _of_many(contours, cameras, seen[:: -(-len(seen) // _MOST)], always, progress)
    if len(seen) < _FEWEST:
        raise ValueError(f"poses can be refined from {_FEWEST} views with an outline at least")
    outlines = Outlines(contours, cameras, hulls)
    tangencies, given = outlines.tangencies, outlines.given
    axis = common_axis(cameras)
    corrections = Corrections(cameras, outlines.middle, outlines.radius, axis)
    before_px, before = _agreement(tangencies, given)
    enough = before < _GOOD_ENOUGH or before_px < _GOOD_ENOUGH_PX
    if not np.isfinite(before) or (enough and not always):
        return Refinement(list(cameras), (), before_px, before_px, before, before, axis=axis)
    sets = [groups for groups in _sets(axis) if {*groups} <= {*allowed}]
    best, trials, tried = _chosen(corrections, outlines, sets, progress)
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
    middle, _ = _place(tangencies.rays(corrected), corrected, hulls)
    scale = _size(given, outlines.middle) / _size(corrected, middle)
    corrected = corrected.scaled(scale, middle)
    after_px, after = _agreement(tangencies, corrected)
    common, sigma = corrections.common(best.x, best.covariance)
    return Refinement(
        corrected.cameras(cameras),
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
        scale,
        middle,
    )


def _of_many(
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    some: Sequence[int],
    always: bool,
    progress: Progress,
) -> Refinement:
    """A long sequence: what all views share, from some of them."""
    found = refine(
        [contours[k] for k in some], [cameras[k] for k in some], always, progress, ("common",)
    )
    if not found.groups:
        return replace(found, cameras=list(cameras))
    n = len(cameras)
    return replace(
        found,
        cameras=moved_alike(cameras, found.common)
        .scaled(found.scale, found.middle)
        .cameras(cameras),
        covariance=np.repeat(found.covariance[:1], n, axis=0),
        steps=np.zeros(n),
        views_px=np.zeros(n),
    )


def _sets(axis: Axis | None) -> list[tuple[str, ...]]:
    """Groups to be tried, from few parameters to many."""
    if axis is None:
        return [("common",), ("common", "views")]
    return [("common",), ("common", "steps"), ("common", "views"), ("common", "steps", "views")]


class Outlines:
    """What the outlines of all views say of cameras: tangencies, and rays.

    The places of the list of all residuals: two for each pair of views, then one for each ray.
    """

    def __init__(
        self,
        contours: Sequence[Contours | None],
        cameras: Sequence[Camera],
        hulls: Sequence[HullView | None],
    ) -> None:
        self.given = Rig.of(cameras)
        self.tangencies = Tangencies(hulls)
        self.middle, self.radius = _place(self.tangencies.rays(self.given), self.given, hulls)
        kept = [None if h is None else c for c, h in zip(contours, hulls, strict=True)]
        self.coherence = Coherence(kept, cameras)
        self._first_ray = 2 * self.tangencies.pairs.shape[1]

    def search(self, rig: Rig) -> None:
        """Find where the rays pass best, to look near there from now on."""
        self.coherence.search(rig, self.middle, self.radius)

    def residuals(self, rig: Rig) -> tuple[Residuals, NDArray[np.intp]]:
        """All residuals of cameras, and the place of each."""
        touching, place = self.tangencies.residuals(rig)
        rays = self.coherence.residuals(rig, self.middle, self.radius)
        camera = np.column_stack([touching.camera, touching.camera[:, 0]])
        none = np.zeros((len(touching), 1, touching.by_camera.shape[2]))
        by_camera = np.concatenate([touching.by_camera, none], axis=1)
        found = joined([Residuals(touching.value, touching.sigma, camera, by_camera), rays])
        return found, np.concatenate([place, self._first_ray + np.arange(len(rays))])

    def cells(self) -> NDArray[np.intp]:
        """(all,) number of the pair of blocks of views that each residual belongs to; rays belong
        to that of their view. By the number modulo _FOLDS every block has a part in each fold."""
        pairs = self.tangencies.pairs
        seen = np.unique(pairs)
        blocks = min(_BLOCKS, max(2, len(seen) // 2))
        of = np.zeros(int(seen.max()) + 1, np.intp)
        of[seen] = np.arange(len(seen)) * blocks // len(seen)
        (i, j), own = of[pairs], of[self.coherence.view]
        cells = (i + j) % _FOLDS + _FOLDS * (i * blocks + j)
        rays = own % _FOLDS + _FOLDS * (blocks * blocks + own)
        return np.concatenate([np.repeat(cells, 2), rays])


def _chosen(
    corrections: Corrections,
    outlines: Outlines,
    sets: Sequence[tuple[str, ...]],
    progress: Progress,
) -> tuple[Solution | None, list[Trial], list[tuple[tuple[str, ...], Solution]]]:
    """The best set of groups by what it explains of pairs and rays that were left out."""
    source, cell = outlines.residuals, outlines.cells()
    fold = cell % _FOLDS
    touching = np.arange(len(cell)) < 2 * outlines.tangencies.pairs.shape[1]
    pixel = outlines.tangencies.usual_sigma
    tried: list[tuple[tuple[str, ...], Solution]] = []
    best: Solution | None = None
    best_z = _left_out(corrections, source, np.zeros(len(corrections)), len(cell))
    trials = [Trial((), pixel * _scale(best_z[touching]), better=True)]
    for number, groups in enumerate(sets):
        if len(groups) > 2 and sum(trial.better for trial in trials[-2:]) < 2:
            break  # neither of its groups can do without the other
        progress(number * (2 + _FOLDS), (2 + _FOLDS) * len(sets))
        start = None if best is None else _kept(corrections, best.x, groups)
        found = solve(corrections, outlines.tangencies.residuals, groups, start=start)
        noise = found.noise
        outlines.search(corrections.of(found.x))
        progress(number * (2 + _FOLDS) + 1, (2 + _FOLDS) * len(sets))
        found = solve(corrections, source, groups, None, found.x, found.prior, noise)
        z = np.full(len(cell), np.nan)
        for k in range(_FOLDS):
            progress(number * (2 + _FOLDS) + 2 + k, (2 + _FOLDS) * len(sets))
            part = solve(corrections, source, groups, fold != k, found.x, found.prior, noise)
            mine = fold == k
            z[mine] = _left_out(corrections, source, part.x, len(cell))[mine]
        tried.append((groups, found))
        gain = _gain(best_z, z, cell, noise)
        less = _scale(z[touching]) < (1 - _WORTH) * _scale(best_z[touching])
        needed = _scale(best_z[touching]) > _NOISE_ALONE
        better = bool(needed and less and gain > _SURE)
        trials.append(Trial(groups, pixel * _scale(z[touching]), gain, better))
        if better:
            best, best_z = found, z
    return best, trials, tried


def _gain(before: Array, after: Array, cell: NDArray[np.intp], noise: float) -> float:
    """By how many standard errors robust losses have become less, from cell to cell."""
    known = np.isfinite(before) & np.isfinite(after)
    change = (_loss(before, noise) - _loss(after, noise))[known]
    gain = np.bincount(cell[known], change)[np.unique(cell[known])]
    error = np.sqrt(len(gain)) * np.std(gain, ddof=1)
    return float(gain.sum() / max(error, 1e-12))


def _scale(z: Array) -> float:
    return scale_of(z[np.isfinite(z)])


def _kept(corrections: Corrections, x: Array | None, groups: Sequence[str]) -> Array | None:
    """Parameters of some groups, the others zero."""
    if x is None:
        return None
    kept = np.zeros_like(x)
    for group in groups:
        kept[corrections.groups[group]] = x[corrections.groups[group]]
    return kept


def _left_out(corrections: Corrections, source: Source, x: Array, count: int) -> Array:
    """(count,) residuals in sigmas, NaN where there is none."""
    residuals, place = source(corrections.of(x))
    z = np.full(count, np.nan)
    z[place] = residuals.value / residuals.sigma
    return z


def _loss(z: Array, noise: float) -> Array:
    loss: Array = np.log1p((z / (2 * noise)) ** 2)
    return loss


def _agreement(tangencies: Tangencies, rig: Rig) -> tuple[float, float]:
    """How far apart two views see one plane, robust 1 sigma: in px, and in sigmas."""
    residuals, _ = tangencies.residuals(rig)
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


def _size(rig: Rig, middle: Array) -> float:
    """What a pixel covers at the object, metres, in the median."""
    return float(np.median(np.linalg.norm(rig.C - middle, axis=1) / rig.focal))


def _place(rays: Array, rig: Rig, hulls: Sequence[HullView | None]) -> tuple[Array, float]:
    """The point (3,) nearest to the views' middle rays, and the object's radius, metres."""
    seen = np.array([h is not None for h in hulls])
    C, looks = rig.C[seen], rays[seen].mean(axis=1)
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    across = np.eye(3) - looks[:, :, None] * looks[:, None, :]
    b = np.einsum("nij,nj->ni", across, C).ravel()
    middle: Array = np.linalg.lstsq(across.reshape(-1, 3), b, rcond=None)[0]
    away = np.linalg.norm(C - middle, axis=1)
    return middle, float(np.median(away * np.tan(np.minimum(half_angles(rays[seen]), 1.4))))
