"""Which groups of corrections explain pairs of views and rays that were left out of the fit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

from .another_lens import AnotherLens
from .refine_outlines import FOLDS, OutlineResiduals
from .refine_rig import SHARED, Corrections
from .refine_solve import SURE, Adjustment, Asked, asked, scale_of, solve

Progress = Callable[[int, int], None]
NEEDLESS = "the outlines agree as well as they are known"
_LENS_BEYOND = "beyond what a lens may be off by"
_NOT_FOCAL = "another focal length alone does not explain most of it"
_FOCAL = 8  # of ``moved_alike``

_NOISE_ALONE = 1.15  # sigmas of the outlines: no more is for cameras to explain
_BEYOND = 4.0  # times what calibrations are good for: no lens, but the outlines' own errors
_NO_LESS = 1.0  # standard errors: lenses that were wrong explain 2.3 to 2.9 more than views do
_WORTH = 0.03  # least share of the residual that must go
_MUCH = 0.5  # share of the residual, less of which is left by what explains much of it
# A lens that is all that is wrong leaves the outlines' own errors (1 to 2 sigmas), or 6 to 15 % of
# large ones; errors of other kinds, of which it takes up half, leave 5 sigmas.
_MOST, _OWN_SIGMAS = 0.25, 2.2
_FARTHEST = np.log(1.5)  # of the logarithm of a focal length that is believed if it explains most


@dataclass(frozen=True)
class Trial:
    """A set of groups, and what it explains.

    Attributes:
        groups: that were corrected.
        left_out_px: robust residual of pairs of views that were left out, px.
        gain: of the robust loss there against the set that was best before, in standard errors.
        better: whether it takes the place of that one; of fewer groups, whether they explain hardly
            less.
        refused: why it does not, in words; empty if it does.
        another_lens: by which it explains much, and that is too far from the one known to be
            believed; None where it does not.
    """

    groups: tuple[str, ...]
    left_out_px: float
    gain: float = 0.0
    better: bool = False
    refused: str = ""
    another_lens: AnotherLens | None = None


@dataclass
class Trials:
    """The sets that were tried on the outlines of all views.

    Args:
        corrections: of the cameras.
        outlines: of their views.
        progress: told how far it is.

    Attributes:
        best: solution of the best set, None where none gained; and ``groups``, that set.
        tried: solutions of all sets; ``trials``: what each of them explains.
    """

    corrections: Corrections
    outlines: OutlineResiduals
    progress: Progress = lambda done, total: None
    best: Adjustment | None = None
    groups: tuple[str, ...] = ()
    tried: list[tuple[tuple[str, ...], Adjustment]] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._cell = self.outlines.cells()
        self._best_z = self._left_out(np.zeros(len(self.corrections)))
        self.trials.append(Trial((), self._px(self._best_z), better=True))

    @property
    def needed(self) -> bool:
        """Whether the outlines are off by more than they are by themselves: that is no error of
        cameras, though the lens would take it up."""
        usual = self.outlines.tangencies.usual_sigma
        return self._px(self._best_z) > _NOISE_ALONE * usual

    def run(self, allowed: Sequence[str]) -> None:
        """Try sets from few parameters to many; groups that are not allowed are left out.

        The lens is tried where the outlines ask for another one, before the steps and single
        views, which would take up much of what it explains. One number of it, the focal length, is
        believed even far from the one known where it explains nearly all: single poses that are
        bent, which would as well, bend the body.
        """
        if "common" not in allowed:
            return
        self._try(("common",))
        if "lens" in allowed and self._asks_for_lens():
            self._try(("common", "focal"))
            self._try(("common", "lens"))
        free = [g for g in ("steps", "views") if g in allowed and g in self.corrections.groups]
        shared = self.groups or ("common",)
        better = [self._try((*shared, group)) for group in free]
        if "lens" in shared and not any(better):
            # The lens took up what single views are off by, too far to be believed with them.
            shared = ("common",)
            better = [self._try((*shared, group)) for group in free]
        if len(better) > 1 and all(better):
            self._try((*shared, *free))  # neither can do without the other
        if "lens" in self.groups and any(better):
            # What it explains, it may explain of what steps or single views are off by.
            self._try(tuple(group for group in self.groups if group != "lens"))

    def _asks_for_lens(self) -> bool:
        """Whether the outlines ask for another lens, by more than chance."""
        _, solution = self.tried[-1]
        return self.asked(solution, self.corrections.groups["lens"]).certainty > SURE

    def asked(self, solution: Adjustment, part: slice) -> Asked:
        """What the residuals ask of some parameters where others are fitted."""
        owners, columns = self.outlines.owners(), np.arange(part.start, part.stop)
        return asked(self.corrections, self.outlines.residuals, owners, solution, columns)

    def _try(self, groups: tuple[str, ...]) -> bool:
        """Fit a set of groups; whether it is the best so far."""
        corrections, source = self.corrections, self.outlines.residuals
        number, each = len(self.tried), 2 + FOLDS
        total = each * max(6, number + 1)
        self.progress(number * each, total)
        start = None if self.best is None else self._kept(self.best.x, groups)
        found = solve(corrections, self.outlines.tangencies.residuals, groups, start=start)
        noise = found.noise
        self.outlines.search(corrections.of(found.x))
        self.progress(number * each + 1, total)
        found = solve(corrections, source, groups, None, found.x, found.prior, noise)
        fold = self._cell % FOLDS
        z = np.full(len(fold), np.nan)
        for k in range(FOLDS):
            self.progress(number * each + 2 + k, total)
            part = solve(corrections, source, groups, fold != k, found.x, found.prior, noise)
            mine = fold == k
            z[mine] = self._left_out(part.x)[mine]
        self.tried.append((groups, found))
        gain = _gain(self._best_z, z, self._cell, noise)
        before, after = self._px(self._best_z), self._px(z)
        fewer = set(groups) < set(self.groups)
        refused = self._refused(groups, found.x, gain, after, before) if not fewer else ""
        if fewer and gain < -_NO_LESS:
            refused = f"it explains less, by {-gain:.1f} standard errors"
        beyond = gain > SURE and refused.startswith(_LENS_BEYOND)
        # With steps or single views these explain as much: what it is with them tells nothing.
        asked_for = beyond and groups[-1] == "lens" and after < _MUCH * before
        another = self._another(found.x, after, before) if asked_for else None
        self.trials.append(Trial(groups, after, gain, not refused, refused, another))
        if not refused:
            self.best, self.groups, self._best_z = found, groups, z
        return not refused

    def _refused(
        self, groups: tuple[str, ...], x: Array, gain: float, after: float, before: float
    ) -> str:
        """Why parameters are not taken, that explain so much (px after and before) with a gain in
        standard errors; empty if they are."""
        if not self.needed:
            return NEEDLESS
        if after >= (1 - _WORTH) * before:
            return f"less than {_WORTH:.0%} of the {before:.3f} px before go"
        if gain <= SURE:
            return f"its gain may be chance (up to {SURE:g} standard errors)"
        if groups[-1] == "focal":
            if abs(self._shared(x)[0][_FOCAL]) > _FARTHEST:
                return f"{_LENS_BEYOND}, a focal length that explains all too"
            return _NOT_FOCAL if after > _MOST * before else ""
        # Images are cropped, so that the principal point may be anywhere, or left distorted.
        lens = x[self.corrections.groups["lens"]] / self.corrections.lens_px
        off = np.abs(lens[2:4])
        if "focal" in groups or off.max() < _BEYOND:
            return ""
        which = ("its focal length", "fy / fx")[int(off.argmax())]
        return f"{_LENS_BEYOND}: {which}, {off.max():.1f} times as far as usual"

    def _another(self, x: Array, after: float, before: float) -> AnotherLens:
        """The lens of parameters that explain so much, px after and before."""
        values, usual = self._shared(x)
        lens, own = self.corrections.groups["lens"], self.outlines.tangencies.usual_sigma
        whole = after < max(_MOST * before, _OWN_SIGMAS * own)
        return AnotherLens.of(values[lens], usual[lens], whole)

    def _shared(self, x: Array) -> tuple[Array, Array]:
        """What all views share, (11,) as of ``moved_alike``, and what lenses are usually known to
        in it (11,)."""
        lens = self.corrections.groups["lens"]
        usual = np.append(np.zeros(lens.start), self.corrections.lens_px)
        return self.corrections.common(x[:SHARED], usual)

    def _kept(self, x: Array, groups: Sequence[str]) -> Array:
        """Parameters of some groups, the others zero."""
        kept = np.zeros_like(x)
        for group in groups:
            kept[self.corrections.groups[group]] = x[self.corrections.groups[group]]
        return kept

    def _left_out(self, x: Array) -> Array:
        """(all,) residuals in sigmas, NaN where there is none."""
        residuals, place = self.outlines.residuals(self.corrections.of(x))
        z = np.full(len(self._cell), np.nan)
        z[place] = residuals.value / residuals.sigma
        return z

    def _px(self, z: Array) -> float:
        """Robust residual of pairs of views, px."""
        z = z[self.outlines.touching]
        return self.outlines.tangencies.usual_sigma * scale_of(z[np.isfinite(z)])


def _gain(before: Array, after: Array, cell: NDArray[np.intp], noise: float) -> float:
    """By how many standard errors robust losses have become less, from cell to cell."""
    known = np.isfinite(before) & np.isfinite(after)
    losses = [np.log1p((z / (2 * noise)) ** 2) for z in (before, after)]
    change = (losses[0] - losses[1])[known]
    gain = np.bincount(cell[known], change)[np.unique(cell[known])]
    error = np.sqrt(len(gain)) * np.std(gain, ddof=1)
    return float(gain.sum() / max(error, 1e-12))
