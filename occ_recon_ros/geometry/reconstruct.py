"""Streaming reconstruction: contours in, rims out, one for each frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .epipolar import Candidates, epipolar_candidates
from .estimators import ESTIMATORS, MANY_FRAMES, Rays
from .frontier import frontier_points
from .matching import candidate_crossings, choose_pairs, nearest_position, small_pieces
from .pencil import Pencil
from .quadric import Crossing, Solution, amplification, depth_sigma, solve, solve_at_partner
from .rim import Rim, Status
from .settings import RimSettings
from .silhouette import Silhouette
from .window import ViewCircle

Array = NDArray[np.float64]

_CHOICE_CHECKS = 8  # silhouettes that help to choose among candidates
_ERRORS_KEPT = 200
_STILL = 1e-5  # rad: a camera that moved less has not moved


class RimReconstructor:
    """The paper's method over a sliding window of three frames.

    A frame waits until a later one at least ``baseline`` away has come; then its rim is
    computed with that frame and the nearest earlier one as far away. Frames that lack
    an earlier partner (the first) wait until ``finish``, when the turn may have closed.
    """

    def __init__(self, settings: RimSettings | None = None) -> None:
        self.settings = settings or RimSettings()
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._frames: list[Silhouette] = []
        self._circle = ViewCircle()
        self._next = 0
        self._first_waiting = 0
        self._rims: dict[int, Rim] = {}
        self._frontier_errors: deque[float] = deque(maxlen=_ERRORS_KEPT)

    @property
    def pose_error_px(self) -> float:
        """How far apart partners see their common frontier points, 1 sigma in pixels.

        Robust (from the median) over the last frames; NaN before there are any. Much more
        than the contours' own sigma means that poses or calibration are off.
        """
        if not self._frontier_errors:
            return float("nan")
        return 1.4826 * float(np.median(np.abs(self._frontier_errors)))

    def add(self, contours: Contours) -> list[Rim]:
        """Take in the next frame; return the rims that it completes, oldest first.

        A frame whose camera has not moved since the last is left out: it can teach
        nothing, and no rim is made for it.

        Raises:
            ValueError: the frame is not later than the last one.
        """
        if self._frames and contours.stamp_ns <= self._frames[-1].contours.stamp_ns:
            raise ValueError("contours must come in the order of their stamps")
        if not len(contours) or (self._frames and self._moved(contours) < _STILL):
            return []
        self._frames.append(Silhouette(contours))
        self._circle.add(contours)
        self._forget()
        rims = []
        while self._next < len(self._frames):
            k, baseline = self._next, self.settings.baseline
            before = self._circle.earlier(k, baseline)
            after = self._circle.later(k, baseline)
            if before is None and k == self._first_waiting:
                self._next = self._first_waiting = k + 1
                continue
            if before is None or after is None:
                break
            if self._circle.same_side(k, before, after):
                before, after = self._partners(k)
            rims.append(self._rim(k, before, after))
            self._next += 1
        return rims

    def finish(self) -> list[Rim]:
        """The rims still owed: those of the last frames, then those of the first.

        Where the turn has closed, the partner is found across the seam; where it has
        not, both partners are taken on the one side that was seen. After them come again,
        under their own stamps, the earlier rims of which a silhouette seen later shows
        points to be wrong (now status 4).
        """
        waiting = [*range(self._next, len(self._frames)), *range(self._first_waiting)]
        earlier = list(self._rims)
        self._next, self._first_waiting = len(self._frames), 0
        owed = [self._rim(k, *self._partners(k)) for k in waiting]
        owed = [self._revised(k) or rim for k, rim in zip(waiting, owed, strict=True)]
        revised = [self._revised(k) for k in earlier]
        return owed + [rim for rim in revised if rim is not None]

    @property
    def centres(self) -> Array:
        """(frames, 3) camera centres of the frames kept, in the order they came, metres."""
        return self._circle.centres.copy()

    def _forget(self) -> None:
        """Let every second frame go of too many between the first, which may join the last
        across the seam of the turn, and the last, which wait or are partners of those that
        do. A camera that only shakes for long makes even these too many."""
        count, most = len(self._frames), self.settings.frames_kept
        before = self._circle.earlier(self._next, self.settings.baseline)
        first = min(2 * self._first_waiting + 2, most)
        last = count - min(2 * (count - (before or 0)), most)
        if last - first <= most:
            return
        kept = [*range(first), *range(first, last, 2), *range(last, count)]
        self._circle.keep(kept)
        self._frames = [self._frames[k] for k in kept]
        self._rims = {i: self._rims[k] for i, k in enumerate(kept) if k in self._rims}
        self._next, self._first_waiting = np.searchsorted(
            kept, [self._next, self._first_waiting]
        ).tolist()

    def _moved(self, contours: Contours) -> float:
        last = self._frames[-1].contours.centre
        distance = np.linalg.norm(self._circle.object_point - last)
        return float(np.linalg.norm(contours.centre - last)) / max(float(distance), 1e-12)

    def _partners(self, k: int) -> tuple[int | None, int | None]:
        """Two partners of frame k wherever they are in the sequence, one on each side if
        the views allow it."""
        circle, baseline = self._circle, self.settings.baseline
        near = circle.earlier(k, baseline)
        if near is None:
            near = circle.later(k, baseline)
        if near is None:
            return None, None
        other = circle.opposite(k, near, baseline)
        if other is None:
            other = circle.beyond(k, near, baseline)
        return near, other

    def _rim(self, k: int, before: int | None, after: int | None) -> Rim:
        """The rim of frame k from its partners, by the paper's steps."""
        contours = self._frames[k].contours
        if before is None or after is None:
            return _empty_rim(contours)
        first, second = self._frames[before].contours, self._frames[after].contours

        # Epipolar correspondence (section 3).
        pencils = Pencil(contours, first), Pencil(contours, second)
        matches = epipolar_candidates(pencils[0]), epipolar_candidates(pencils[1])
        says = candidate_crossings(pencils[0], matches[0])
        also = candidate_crossings(pencils[1], matches[1])
        few = self._others(k, _CHOICE_CHECKS)
        columns = choose_pairs(contours, says, also, lambda points: self._excess(points, few))
        found = columns[0] >= 0
        one, two = matches[0].column(columns[0]), matches[1].column(columns[1])

        # Depth and curvature from three contours (sections 4 and 5).
        C, T, N = contours.centre, contours.T, contours.N
        cross0, cross1 = says[0].column(columns[0]), also[0].column(columns[1])
        solution = solve(cross0, cross1)
        sigmas = _sigma(first, one), _sigma(second, two)
        sigma = depth_sigma(cross0, cross1, contours.sigma, *sigmas)
        gain = amplification(cross0, cross1)
        solution = _solve_at_partner(solution, contours, cross1, (first, one), (second, two))
        if self.settings.estimator != "osculating_quadric":
            partners = _rays(first, one), _rays(second, two)
            solution, sigma = self._estimated(solution, sigma, (k, before, after), partners)

        status = solution.status.copy()
        along = matches[0].along_ray | matches[1].along_ray
        usable = np.isfinite(contours.sigma)
        weak = (status == Status.GOOD) & ~(gain <= self.settings.amplification)
        status[weak] = Status.ILL_CONDITIONED
        status[~found | ~usable] = Status.NO_CORRESPONDENT
        status[along] = Status.MOTION_ALONG_RAY
        gone = (status == Status.NO_CORRESPONDENT) | (status == Status.MOTION_ALONG_RAY)
        depth = np.where(gone | ~(solution.depth > 0), np.nan, solution.depth)
        status[~gone & np.isnan(depth)] = Status.ILL_CONDITIONED
        # Frontier points: both views see the very same point, whatever its curvature.
        rows, frontier_depth = self._frontier(pencils[0])
        depth[rows], status[rows] = frontier_depth, Status.DOUBLE
        points = C + depth[:, None] * T

        # Checks: continuous depth, and the silhouettes of the other frames.
        good = status == Status.GOOD
        good &= ~self._outside(points, k, self.settings.silhouette_checks)
        status[(status == Status.GOOD) & ~good] = Status.OUTSIDE
        alone = small_pieces(points, solution.curvature, good, contours)
        status[alone] = Status.NO_CORRESPONDENT

        previous = k - 1 if k else self._closing_frame()
        prev, prev_stamp = np.full(len(contours), np.nan), 0
        if previous is not None:
            other = self._frames[previous].contours
            pencil, back = pencils[0], matches[0]
            if previous != before:
                pencil = Pencil(contours, other)
                back = epipolar_candidates(pencil)
            prev = nearest_position(pencil, back, depth, solution.curvature)
            prev_stamp = other.stamp_ns
        self._rims[k] = Rim(
            stamp_ns=contours.stamp_ns,
            frame_id=contours.frame_id,
            points=points,
            normals=N,
            curvature=np.where(np.isnan(depth), np.nan, solution.curvature),
            depth_sigma=np.where(np.isnan(depth), np.nan, sigma),
            loop=contours.loop,
            prev=prev,
            status=status,
            prev_stamp_ns=prev_stamp,
        )
        return self._rims[k]

    def _frontier(self, pencil: Pencil) -> tuple[NDArray[np.intp], Array]:
        """Rows of the samples nearest to the frontier points with a partner, and depths."""
        contours, found = pencil.contours, frontier_points(pencil)
        self._frontier_errors.extend(found.error / contours.radians_per_pixel)
        rows = np.rint(found.row).astype(np.intp)
        rows = np.where(rows < len(contours), rows, len(contours) - 1)
        usable = np.isfinite(contours.sigma[rows])
        rows, step = rows[usable], found.points[usable] - contours.centre
        return rows, np.einsum("nk,nk->n", step, contours.T[rows])

    def _estimated(
        self, first: Solution, sigma: Array, triple: tuple[int, int, int], partners: Sequence[Rays]
    ) -> tuple[Solution, Array]:
        """Depth, curvature and sigma by the estimator that is set, from the paper's.

        Where it has no answer the paper's stays. Correspondents in more frames are found
        from the points that three frames gave.
        """
        k, before, after = triple
        contours = self._frames[k].contours
        view = Rays(contours.centre, contours.T, contours.N, contours.sigma)
        more = []
        if self.settings.estimator in MANY_FRAMES:
            for j in self._circle.within(k, before, after, self.settings.frames - 1):
                pencil = Pencil(contours, self._frames[j].contours)
                candidates = epipolar_candidates(pencil)
                row = nearest_position(pencil, candidates, first.depth, first.curvature)
                more.append(_rays(pencil.other, _at(row, pencil.other)))
        found = ESTIMATORS[self.settings.estimator](view, [*partners, *more])
        depth, curvature = found.depth, found.curvature
        known = np.isfinite(depth) & np.isfinite(found.depth_sigma)
        solution = Solution(
            np.where(known, depth, first.depth),
            np.where(known & np.isfinite(curvature), curvature, first.curvature),
            first.status,
        )
        return solution, np.where(known, found.depth_sigma, sigma)

    def _revised(self, k: int) -> Rim | None:
        """The rim of frame k if silhouettes that came since show points to be wrong."""
        rim = self._rims.get(k)
        if rim is None:  # it had no partners
            return None
        most = 4 * self.settings.silhouette_checks
        wrong = (rim.status == Status.GOOD) & self._outside(rim.points, k, most)
        if not wrong.any():
            return None
        status = np.where(wrong, np.uint8(Status.OUTSIDE), rim.status)
        self._rims[k] = replace(rim, status=status)
        return self._rims[k]

    def _others(self, k: int, most: int) -> list[Silhouette]:
        """Silhouettes of other frames, at most so many, spread over all so far.

        Every frame whose number is a multiple of a power of two: while the scan goes on
        the same ones serve again, so that few need their grid.
        """
        stride = 1
        while 0 < most * stride < len(self._frames):
            stride *= 2
        return [s for j, s in enumerate(self._frames[::stride]) if j * stride != k][:most]

    def _outside(self, points: Array, k: int, most: int) -> NDArray[np.bool_]:
        """(n,) which points of frame k lie outside one of at most so many silhouettes."""
        checks = self._others(k, most)
        with np.errstate(invalid="ignore"):
            return self._excess(points, checks) > 1

    def _excess(self, points: Array, checks: list[Silhouette]) -> Array:
        """(n,) how far points lie outside the worst silhouette, in tolerances."""
        worst = np.full(len(points), -np.inf)
        for silhouette in checks:
            pixel = silhouette.contours.radians_per_pixel
            worst = np.fmax(worst, silhouette.outside(points) / pixel)
        return worst / max(self.settings.silhouette_tolerance, 1e-6)

    def _closing_frame(self) -> int | None:
        """The last frame, if the turn has closed so that it comes before the first."""
        last = len(self._frames) - 1
        before = self._circle.opposite(0, 1, 0.0) if last >= 3 else None
        return last if before == last else None


def _solve_at_partner(
    solution: Solution,
    contours: Contours,
    after: Crossing,
    first: tuple[Contours, Candidates],
    second: tuple[Contours, Candidates],
) -> Solution:
    """Fill in the ill-conditioned samples by way of the second partner."""
    rows = np.flatnonzero(solution.status == Status.ILL_CONDITIONED)
    if not len(rows):
        return solution
    one, two = (_rays(partner, at.rows(rows)) for partner, at in (first, second))
    depth, curvature = solution.depth.copy(), solution.curvature.copy()
    filled = solve_at_partner(
        Solution(depth[rows], curvature[rows], solution.status[rows]),
        after.rows(rows),
        (two.centre, two.T, two.N),
        (contours.centre, contours.T[rows]),
        (one.centre, one.T),
    )
    depth[rows], curvature[rows] = filled.depth, filled.curvature
    return Solution(depth, curvature, solution.status)


def _rays(partner: Contours, at: Candidates) -> Rays:
    """Rays of the candidates (K = 1), rows NaN where there is none."""
    missing = ~at.valid[:, 0]
    T = at.directions(partner)[:, 0]
    N = at.interpolate(partner.N, partner.next_row)[:, 0]
    T[missing] = np.nan
    N = N / np.linalg.norm(N, axis=1, keepdims=True)
    return Rays(partner.centre, T, N, _sigma(partner, at))


def _sigma(partner: Contours, at: Candidates) -> Array:
    """(n,) sigma of the candidates (K = 1), NaN where there is none."""
    # A sample beside a corner counts as a correspondent, though not as a rim point: it is
    # worth ten times less than the usual one.
    sigma = np.minimum(partner.sigma, 10 * partner.usual_sigma)[at.row[:, 0]]
    return np.where(at.valid[:, 0], sigma, np.nan)


def _at(position: Array, other: Contours) -> Candidates:
    """Fractional rows (n,) of a frame as candidates, none where NaN."""
    known = np.isfinite(position)
    # Row and fraction may have rounded up to the row past the last.
    row = np.minimum(np.where(known, position, 0), len(other) - 1).astype(np.intp)
    fraction = np.where(known, position - row, 0.0)
    return Candidates(known[:, None], row[:, None], fraction[:, None], ~known)


def _empty_rim(contours: Contours) -> Rim:
    """A rim of which nothing could be computed."""
    n = len(contours)
    nan = np.full(n, np.nan)
    return Rim(
        stamp_ns=contours.stamp_ns,
        frame_id=contours.frame_id,
        points=np.full((n, 3), np.nan),
        normals=contours.N,
        curvature=nan,
        depth_sigma=nan,
        loop=contours.loop,
        prev=nan,
        status=np.full(n, Status.NO_CORRESPONDENT, np.uint8),
    )
