"""Streaming reconstruction: contours in, rims out, one for each frame."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .calibration import CalibrationWatch
from .continuity import breaks, long_links
from .contours import Contours
from .epipolar import epipolar_candidates
from .estimators import ESTIMATORS, MANY_FRAMES, Rays
from .frontier import frontier_points
from .matching import nearest_position, small_pieces
from .pencil import Pencil
from .quadric import Solution
from .rim import Rim, Status, empty_rim
from .settings import RimSettings
from .silhouette import Silhouette, SilhouetteBank
from .triple import Estimate, Partner, Revise, estimate, rays_at
from .window import ViewCircle

Array = NDArray[np.float64]

_CHOICE_CHECKS = 8  # silhouettes that help to choose among candidates
_WIDEST = 3.0  # baselines: the surface is no parabola over more
_WORTH = 10  # points to send a rim again for
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
        self._bank = SilhouetteBank()
        self._circle = ViewCircle()
        self._next = 0
        self._first_waiting = 0
        self._rims: dict[int, Rim] = {}
        self.calibration = CalibrationWatch()
        self.unmoved = 0  # frames left out because the camera had not moved

    @property
    def pose_error_px(self) -> float:
        """How far apart partners see their common frontier points, 1 sigma in pixels.

        Robust (from the median) over the last frames; NaN before there are any. Much more
        than the contours' own sigma means that poses or calibration are off.
        """
        return self.calibration.frontier_px

    @property
    def tolerance_px(self) -> float:
        """Pixels that a point may lie outside a silhouette: those of the settings, or more
        where poses or calibration are seen to be off."""
        return max(self.settings.silhouette_tolerance, self.calibration.tolerance_px, 1e-6)

    def add(self, contours: Contours) -> list[Rim]:
        """Take in the next frame; return the rims that it completes, oldest first.

        A frame whose camera has not moved since the last is left out and counted
        (``unmoved``): it can teach nothing, and no rim is made for it.

        Raises:
            ValueError: the frame is not later than the last one.
            Exception: it cannot be worked on; the scan is as it was without it.
        """
        if self._frames and contours.stamp_ns <= self._frames[-1].contours.stamp_ns:
            raise ValueError("contours must come in the order of their stamps")
        if not len(contours):
            return []
        if self._frames and self._moved(contours) < _STILL:
            self.unmoved += 1
            return []
        self._frames.append(Silhouette(contours))
        self._circle.add(contours)
        self._forget()
        before = self._next, self._first_waiting
        try:
            return self._due()
        except Exception:
            # Else it would be met again with every frame to come.
            self._next, self._first_waiting = before
            self._circle.keep(range(len(self._frames) - 1))
            del self._frames[-1]
            raise

    def _due(self) -> list[Rim]:
        """The rims whose partners have come."""
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
                before, after = self._circle.partners(k, baseline)
            rims.append(self._rim(k, before, after))
            self._next += 1
        return rims

    def finish(self) -> list[Rim]:
        """The rims still owed: those of the last frames, then those of the first.

        Where the turn has closed, the partner is found across the seam; where it has
        not, both partners are taken on the one side that was seen. After them come again,
        under their own stamps, the rims of which a silhouette seen later shows points to be
        wrong (now status 4), or partners seen later give points that were not to be had.
        """
        waiting = [*range(self._next, len(self._frames)), *range(self._first_waiting)]
        earlier = list(self._rims)
        self._next, self._first_waiting = len(self._frames), 0
        owed = [self._rim(k, *self._circle.partners(k, self.settings.baseline)) for k in waiting]
        owed = [self._revised(k) or rim for k, rim in zip(waiting, owed, strict=True)]
        revised = [self._revised(k) for k in earlier]
        return owed + [rim for rim in revised if rim is not None]

    @property
    def centres(self) -> Array:
        """(frames, 3) camera centres of the frames kept, in the order they came, metres."""
        return self._circle.centres.copy()

    def contours_of(self, stamp_ns: int) -> Contours | None:
        """The contours of a frame that is still kept."""
        stamps = [silhouette.contours.stamp_ns for silhouette in self._frames]
        k = bisect_left(stamps, stamp_ns)
        return self._frames[k].contours if stamp_ns in stamps[k : k + 1] else None

    def _forget(self) -> None:
        """Let every second frame go of too many between the first, which may join the last
        across the seam of the turn, and the last, which wait or are partners of those that
        do. A camera that only shakes for long makes even these too many."""
        count, most = len(self._frames), self.settings.frames_kept
        if count <= most:
            return
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

    def _rim(self, k: int, before: int | None, after: int | None) -> Rim:
        """The rim of frame k from its partners, by the paper's steps."""
        contours = self._frames[k].contours
        if before is None or after is None:
            return empty_rim(contours)
        partners = {j: self._partner(k, j) for j in (before, after)}
        few = self._others(k, self.settings.silhouette_checks)

        # Correspondence, depth and curvature from three contours (sections 3 to 5).
        found, columns = estimate(
            contours,
            partners[before],
            partners[after],
            lambda points: self._excess(points, few[:_CHOICE_CHECKS]),
            self.settings.amplification,
            revise=self._estimator(k, before, after),
        )
        # Frontier points: both views see the very same point, whatever its curvature.
        rows, depth = self._frontier(partners[before].pencil)
        found.depth[rows], found.status[rows] = depth, Status.DOUBLE

        # Checks: the silhouettes of the other frames, other pairs of partners, continuity.
        self._give_up_outside(contours, found, few)
        doubtful = self._breaks(k, found, {before: partners[before]}, columns)
        todo = doubtful | (found.status == Status.NO_CORRESPONDENT)
        todo |= found.status == Status.OUTSIDE
        if np.count_nonzero(todo & np.isfinite(contours.sigma)) >= _WORTH:
            pairs = self._pairs(k, before, after)
            self._try_others(k, found, todo, doubtful, pairs, partners, few)
        return self._keep(k, found, partners, few)

    def _keep(
        self, k: int, found: Estimate, partners: dict[int, Partner], checks: list[Silhouette]
    ) -> Rim:
        """The rim of an estimate: small pieces left out, linked to the rim before."""
        contours = self._frames[k].contours
        points = contours.centre + found.depth[:, None] * contours.T
        alone = small_pieces(points, found.curvature, found.status == Status.GOOD, contours)
        found.status[alone] = Status.NO_CORRESPONDENT
        previous = k - 1 if k else self._closing_frame()
        prev, prev_stamp = np.full(len(contours), np.nan), None
        if previous is not None:
            back = partners.get(previous)
            if back is None or len(back.rows) < len(contours):
                back = self._partner(k, previous)
            prev = nearest_position(back.pencil, back.candidates, found.depth, found.curvature)
            prev_stamp = self._frames[previous].contours.stamp_ns
            if previous in self._rims:
                after = self._frames[previous].contours.next_row
                links = long_links(points, self._rims[previous], prev, after)
                outside = self._bank.outside_px(links.middle, checks) - self.tolerance_px
                prev[links.rows[outside > links.hollow_px(contours)]] = np.nan
        unknown = np.isnan(found.depth)
        self._rims[k] = Rim(
            stamp_ns=contours.stamp_ns,
            frame_id=contours.frame_id,
            centre=contours.centre,
            points=points,
            normals=contours.N,
            curvature=np.where(unknown, np.nan, found.curvature),
            depth_sigma=np.where(unknown, np.nan, found.sigma),
            loop=contours.loop,
            prev=prev,
            status=found.status,
            prev_stamp_ns=prev_stamp,
        )
        return self._rims[k]

    def _partner(self, k: int, j: int, rows: NDArray[np.intp] | None = None) -> Partner:
        return Partner.of(self._frames[k].contours, self._frames[j].contours, rows)

    def _pairs(self, k: int, before: int, after: int) -> list[tuple[int, int]]:
        """Other pairs of partners, the best-conditioned first."""
        circle, baseline = self._circle, self.settings.baseline
        past = circle.beyond(k, before, baseline, _WIDEST * baseline)
        next_ = circle.beyond(k, after, baseline, _WIDEST * baseline)
        pairs = [(past, after), (before, next_), (past, next_), (past, before), (next_, after)]
        return [(i, j) for i, j in pairs if i is not None and j is not None and i != j]

    def _try_others(
        self,
        k: int,
        found: Estimate,
        todo: NDArray[np.bool_],
        doubtful: NDArray[np.bool_],
        pairs: list[tuple[int, int]],
        partners: dict[int, Partner],
        checks: list[Silhouette],
    ) -> None:
        """Solve what two partners did not by others: one may be hidden in the one and seen
        in the other, or seen by two on the same side only. The doubtful ones of them are
        given up if no others give a better point."""
        contours = self._frames[k].contours
        todo, changed = todo & np.isfinite(contours.sigma), False
        for i, j in pairs:
            rows = np.flatnonzero(todo)
            if len(rows) < _WORTH:
                break
            for one in (i, j):
                if one not in partners:
                    partners[one] = self._partner(k, one, rows)
            other, _ = estimate(
                contours,
                partners[i].some(rows),
                partners[j].some(rows),
                lambda points: self._excess(points, checks[:_CHOICE_CHECKS]),
                self.settings.amplification,
                found.depth,
            )
            points = contours.centre + other.depth[:, None] * contours.T[rows]
            take = other.status == Status.GOOD
            bent = np.abs(other.curvature) > 2 * np.abs(found.curvature[rows])
            take &= ~doubtful[rows] | bent
            take[take] = ~(self._excess(points[take], checks) > 1)
            found.put(rows, other, take)
            doubtful[rows[take]] = todo[rows[take]] = False
            changed |= bool(take.any())
        found.status[doubtful & (found.status == Status.GOOD)] = Status.NO_CORRESPONDENT
        if changed:
            found.status[self._breaks(k, found, partners)] = Status.NO_CORRESPONDENT

    def _breaks(
        self,
        k: int,
        found: Estimate,
        partners: dict[int, Partner],
        columns: NDArray[np.intp] | None = None,
    ) -> NDArray[np.bool_]:
        """(n,) which good samples are not on one surface with the rims of the partners; the
        columns are of the candidates that were chosen, if they are known."""
        broken = np.zeros(len(found.depth), bool)
        error = np.nan_to_num(self.pose_error_px) * self._frames[k].contours.radians_per_pixel
        for j, partner in partners.items():
            if j in self._rims and len(partner.rows) == len(broken):
                broken |= breaks(partner, found, self._rims[j], 2 * error, columns)
        return broken & (found.status == Status.GOOD)

    def _give_up_outside(
        self, contours: Contours, found: Estimate, checks: list[Silhouette]
    ) -> None:
        good = np.flatnonzero(found.status == Status.GOOD)
        points = contours.centre + found.depth[good, None] * contours.T[good]
        outside = self._bank.outside_px(points, checks)
        self.calibration.add_excess(outside, self.settings.silhouette_tolerance)
        found.status[good[outside > self.tolerance_px]] = Status.OUTSIDE

    def _frontier(self, pencil: Pencil) -> tuple[NDArray[np.intp], Array]:
        """Rows of the samples nearest to the frontier points with a partner, and depths."""
        contours, found = pencil.contours, frontier_points(pencil)
        self.calibration.add_frontier(found.error / contours.radians_per_pixel)
        rows = np.rint(found.row).astype(np.intp)
        rows = np.where(rows < len(contours), rows, len(contours) - 1)
        usable = np.isfinite(contours.sigma[rows])
        rows, step = rows[usable], found.points[usable] - contours.centre
        return rows, np.einsum("nk,nk->n", step, contours.T[rows])

    def _estimator(self, k: int, before: int, after: int) -> Revise | None:
        """What computes depth, curvature and sigma in the paper's stead, if that is set.

        Where it has no answer the paper's stays. Correspondents in more frames are found
        from the points that three frames gave.
        """
        if self.settings.estimator == "osculating_quadric":
            return None
        contours = self._frames[k].contours
        view = Rays(contours.centre, contours.T, contours.N, contours.sigma)
        others: list[int] = []
        if self.settings.estimator in MANY_FRAMES:
            others = self._circle.within(k, before, after, self.settings.frames - 1)

        def revise(
            first: Solution, sigma: Array, partners: tuple[Rays, Rays]
        ) -> tuple[Solution, Array]:
            more = []
            for j in others:
                pencil = Pencil(contours, self._frames[j].contours)
                candidates = epipolar_candidates(pencil)
                row = nearest_position(pencil, candidates, first.depth, first.curvature)
                more.append(rays_at(pencil.other, row))
            found = ESTIMATORS[self.settings.estimator](view, [*partners, *more])
            depth, curvature = found.depth, found.curvature
            known = np.isfinite(depth) & np.isfinite(found.depth_sigma)
            solution = Solution(
                np.where(known, depth, first.depth),
                np.where(known & np.isfinite(curvature), curvature, first.curvature),
                first.status,
            )
            return solution, np.where(known, found.depth_sigma, sigma)

        return revise

    def _revised(self, k: int) -> Rim | None:
        """The rim of frame k if frames that came since show points to be wrong, or give
        points that were not to be had."""
        rim = self._rims.get(k)
        if rim is None:  # it had no partners
            return None
        contours = self._frames[k].contours
        depth = np.einsum("nk,nk->n", rim.points - contours.centre, contours.T)
        found = Estimate(
            depth.copy(), rim.curvature.copy(), rim.depth_sigma.copy(), rim.status.copy()
        )
        checks = self._others(k, 4 * self.settings.silhouette_checks)
        self._give_up_outside(contours, found, checks)
        before, after = self._circle.partners(k, self.settings.baseline)
        if before is not None and after is not None:
            partners = {j: self._partner(k, j) for j in (before, after)}
            doubtful = self._breaks(k, found, partners)
            todo = doubtful | ((found.status != Status.GOOD) & (found.status != Status.DOUBLE))
            pairs = [(before, after), *self._pairs(k, before, after)]
            self._try_others(k, found, todo, doubtful, pairs, partners, checks)
        kept = found.depth == depth
        new = self._keep(k, found, {}, checks)
        was, good = rim.status == Status.GOOD, new.status == Status.GOOD
        worse = was & ~good | np.isfinite(rim.prev) & np.isnan(new.prev) & was
        if not worse.any() and (good & ~(was & kept)).sum() < _WORTH:
            self._rims[k] = rim
            return None
        new = replace(new, points=np.where(kept[:, None], rim.points, new.points))
        if new.prev_stamp_ns != rim.prev_stamp_ns:  # that frame has been forgotten
            prev = np.where(kept, rim.prev, np.nan)
            new = replace(new, prev=prev, prev_stamp_ns=rim.prev_stamp_ns)
        self._rims[k] = new
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

    def _excess(self, points: Array, checks: list[Silhouette]) -> Array:
        """(n,) how far points lie outside the worst silhouette, in tolerances."""
        return self._bank.outside_px(points, checks) / self.tolerance_px

    def _closing_frame(self) -> int | None:
        """The last frame, if the turn has closed so that it comes before the first."""
        last = len(self._frames) - 1
        before = self._circle.opposite(0, 1, 0.0) if last >= 3 else None
        return last if before == last else None
