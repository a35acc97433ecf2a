"""Poses and calibration corrected by the contours alone.

What moved in the middle of the scan is taken back first. Then what is asked grows: nothing; what
all views share (where the camera sees the axis or the object frame, focal length, principal point);
the steps of a table; each view's pose. A group is corrected only if that explains pairs of views
which were left out of the fit, and by more than chance. First by the planes that touch two
outlines, then by these and by the rays of all outlines together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, robust_sigma, thinned
from occ_recon_ros.geometry.viewing import seen_by

from .another_lens import AnotherLens
from .refine_break import Break, find_break
from .refine_lens import RADIAL_MODELS
from .refine_outlines import OutlineResiduals, place
from .refine_rig import SHARED, Axis, Corrections, Rig, common_axis, moved_alike
from .refine_solve import Adjustment
from .refine_tangencies import HullView, Tangencies, hulls_of
from .refine_trials import Progress, Trial, Trials

_FEWEST = 5  # views with an outline
_MOST = 100  # of them: of more some are looked at
_GOOD_ENOUGH = 1.0  # sigmas of the outlines: right calibrations stay below it
_GOOD_ENOUGH_PX = 0.3
_AS_WELL = 1.1  # times what outlines are apart by in other corrections: no worse
_DETERMINED = 0.5  # of a prior's variance that the residuals must take away


@dataclass(frozen=True)
class Refinement:
    """Corrected cameras and how far they are to be believed.

    Attributes:
        cameras: n, corrected; as given where nothing gained.
        groups: that were corrected; "break": what moved, see ``breaks``.
        before_px, after_px: how far apart two views see the planes that touch the object, 1
            sigma, robust, px.
        before, after: the same in sigmas of the outlines.
        trials: what was tried, in order.
        axis: that the cameras go around, if they do.
        undetermined: groups that the contours say nothing of.
        covariance: (n, 6, 6) float64, of each camera's rotation (rad) and centre (m) in its own
            frame; along the gauge (place, turn and scale of the object) that of the prior.
        common: (11,) float64, corrections that all views share: rotation about x, y and z (rad),
            shift (m), cx and cy (px), logarithms of the focal length and of fy / fx, and
            distortion (``Rig.bend``).
        common_sigma: (11,) their standard deviations; 0 for what was not corrected.
        steps: (n,) float64, corrections of the angles about the axis, rad.
        views_px: (n,) float64, by how much each view was corrected by itself, px.
        scale, middle: the factor by which, and the point (3,) about which, the corrected cameras
            were moved away from the object, so that a pixel is there as large as before: outlines
            know no scale, and calibrations know that size better than focal length or distance.
        breaks: events after which all views were off by one motion, which was taken back first.
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
    common: Array = field(default_factory=lambda: np.zeros(SHARED))
    common_sigma: Array = field(default_factory=lambda: np.zeros(SHARED))
    steps: Array = field(default_factory=lambda: np.zeros(0))
    views_px: Array = field(default_factory=lambda: np.zeros(0))
    scale: float = 1.0
    middle: Array = field(default_factory=lambda: np.zeros(3))
    breaks: tuple[Break, ...] = ()

    @property
    def another_lens(self) -> AnotherLens | None:
        """That the outlines ask for, where none was corrected."""
        asked = [trial.another_lens for trial in self.trials if trial.another_lens is not None]
        return asked[-1] if asked and not {"lens", "focal"} & set(self.groups) else None


def refine(
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    always: bool = False,
    progress: Progress = lambda done, total: None,
    allowed: Sequence[str] = ("common", "lens", "steps", "views"),
) -> Refinement:
    """Correct cameras so that the outlines agree: what moved in the middle of the scan, then what
    gains. Of more than 100 views some are looked at, and only what all share is corrected.

    Args:
        contours: one a camera, None where a view has none; made with these cameras.
        cameras: n, as given.
        always: also where the outlines agree already as well as they are known; then to see what
            would be gained, for cameras are left as they are but for what moved.
        progress: told how far it is.
        allowed: groups that may be corrected; without "common" nothing is.

    Raises:
        ValueError: fewer than five views with an outline that look at one thing.
    """
    hulls = hulls_of(contours, cameras)
    # Of views that moved together, a third of all, most pairs agree all the same.
    if (event := find_break(hulls, cameras)) is None:
        return _of_all(hulls, contours, cameras, always, progress, allowed)
    found = _beside(event, hulls, contours, cameras, always, progress, allowed)
    if "views" not in found.groups:
        return found
    # Nothing moved, if poses need less of a correction without that.
    other = _of_all(hulls, contours, cameras, always, progress, allowed)
    as_well = "views" in other.groups and other.after < _AS_WELL * found.after
    less = as_well and np.median(other.views_px) < np.median(found.views_px)
    return other if less else found


def _of_all(
    hulls: Sequence[HullView | None],
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    always: bool,
    progress: Progress,
    allowed: Sequence[str],
) -> Refinement:
    """What is to be corrected where nothing moved in the middle of the scan."""
    seen = [k for k, hull in enumerate(hulls) if hull is not None]
    if len(seen) > _MOST:
        return _of_many(contours, cameras, thinned(seen, _MOST), always, progress)
    if len(seen) < _FEWEST:
        raise ValueError(f"poses can be refined from {_FEWEST} views with an outline at least")
    outlines = OutlineResiduals(contours, cameras, hulls)
    tangencies, given = outlines.tangencies, outlines.given
    before_px, before = _agreement(tangencies, given)
    axis = common_axis(cameras)
    corrections = Corrections(cameras, outlines.middle, outlines.radius, axis)
    enough = before < _GOOD_ENOUGH or before_px < _GOOD_ENOUGH_PX
    as_given = Refinement(list(cameras), (), before_px, before_px, before, before, axis=axis)
    if not np.isfinite(before) or (enough and not always):
        return as_given
    found = Trials(corrections, outlines, progress)
    if always or found.needed:
        found.run([group for group in allowed if _possible(group, axis, cameras)])
    best, undetermined = found.best, _undetermined(corrections, found.tried)
    as_given = replace(as_given, trials=found.trials, undetermined=undetermined)
    if best is None:
        return as_given
    corrected = corrections.of(best.x)
    middle, _ = place(tangencies.rays(corrected), corrected, hulls)
    scale = given.pixel_at(outlines.middle) / corrected.pixel_at(middle)
    corrected = corrected.scaled(scale, middle)
    after_px, after = _agreement(tangencies, corrected)
    asked = found.asked(best, slice(0, SHARED))
    common, sigma = corrections.common(best.x, asked.sigma * best.free[:SHARED])
    views = best.x[corrections.groups["views"]].reshape(-1, 6)
    return replace(
        as_given,
        cameras=corrected.cameras(cameras),
        groups=found.groups,
        after_px=after_px,
        after=after,
        covariance=corrections.covariance(corrected, asked.dependence * best.covariance),
        common=common,
        common_sigma=sigma,
        steps=corrections.steps(best.x),
        views_px=np.sqrt((views**2).sum(axis=1)),
        scale=scale,
        middle=middle,
    )


def event_between(
    contours: Sequence[Contours | None], cameras: Sequence[Camera]
) -> tuple[Break, list[Camera]] | None:
    """What moved between two views, and the cameras with that taken back, None where nothing did.

    Args:
        contours: one a camera, made with it, None where a view has none; in the order of time.
        cameras: n, as given.
    """
    event = find_break(hulls_of(contours, cameras), cameras)
    return None if event is None else (event, event.taken_back(Rig.of(cameras)).cameras(cameras))


def _beside(
    event: Break,
    hulls: Sequence[HullView | None],
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    always: bool,
    progress: Progress,
    allowed: Sequence[str],
) -> Refinement:
    """What is to be corrected beside what moved."""
    given = Rig.of(cameras)
    moved = event.taken_back(given).cameras(cameras)
    again = [c and seen_by(camera, c) for camera, c in zip(moved, contours, strict=True)]
    rest = refine(again, moved, always, progress, allowed)
    some = thinned([k for k, hull in enumerate(hulls) if hull is not None], _MOST)
    part = Tangencies([hulls[k] for k in some])
    before_px, before = _agreement(part, Rig.of([cameras[k] for k in some]))
    return replace(
        rest,
        groups=tuple(dict.fromkeys(("break", *rest.groups))),
        breaks=(event, *rest.breaks),
        before_px=before_px,
        before=before,
        steps=rest.steps if len(rest.steps) else np.zeros(len(cameras)),
        views_px=rest.views_px if len(rest.views_px) else np.zeros(len(cameras)),
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
        [contours[k] for k in some],
        [cameras[k] for k in some],
        always,
        progress,
        ("common", "lens"),
    )
    if not found.groups:
        return replace(found, cameras=list(cameras))
    n, moved = len(cameras), moved_alike(Rig.of(cameras), found.common)
    return replace(
        found,
        cameras=moved.scaled(found.scale, found.middle).cameras(cameras),
        covariance=np.repeat(found.covariance[:1], n, axis=0),
        steps=np.zeros(n),
        views_px=np.zeros(n),
    )


def _possible(group: str, axis: Axis | None, cameras: Sequence[Camera]) -> bool:
    """Whether cameras can have such a correction."""
    if group == "lens":
        return all(c.distortion in RADIAL_MODELS and len(c.D) <= 8 for c in cameras)
    return group != "steps" or axis is not None


def _agreement(tangencies: Tangencies, rig: Rig) -> tuple[float, float]:
    """How far apart two views see one plane, robust 1 sigma: in px, and in sigmas."""
    residuals, _ = tangencies.residuals(rig)
    if len(residuals) < 2 * _FEWEST:
        return float("nan"), float("nan")
    return robust_sigma(residuals.value), robust_sigma(residuals.value / residuals.sigma)


def _undetermined(
    corrections: Corrections, tried: Sequence[tuple[tuple[str, ...], Adjustment]]
) -> tuple[str, ...]:
    """Groups of which the residuals take away little of the prior's variance."""
    found = []
    for groups, solution in tried:
        group = groups[-1]
        left = np.diag(solution.covariance)[corrections.groups[group]]
        told = 1 - left.mean() / float(solution.prior[group].mean()) ** 2
        if group in ("steps", "views") and group not in found and told < _DETERMINED:
            found.append(group)
    return tuple(found)
