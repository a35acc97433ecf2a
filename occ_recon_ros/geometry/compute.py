"""The rim of one view, by the paper's steps: correspondence, depth and curvature, checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, dot
from .belief import (
    BELIEVED,
    Belief,
    contradicts_neighbour,
    depth_discontinuities,
    propagated,
    small_pieces,
)
from .compiled import compiled
from .context import Context, PoseEvidence
from .contours import Contours
from .estimators import ESTIMATORS, MANY_FRAMES, Rays, finite_q
from .frontier import frontier_points
from .links import long_links
from .matching import Partner, choose_pairs, nearest, rays_at
from .quadric import solve, solve_at_partner
from .rim import Rim, Status, empty_rim
from .silhouette import Silhouettes

Mask = NDArray[np.bool_]

GOOD = Status.GOOD.value  # arrays are compared with it six times as fast as with the Status
_OPEN = [Status.NO_CORRESPONDENT.value, Status.OUTSIDE.value]  # others may still solve it
_WORTH = 10  # samples to go on for, and to send a rim again for
# Sigmas by which a point outside of a silhouette may be wrong in depth, the least first.
_MOVES = BELIEVED * np.array([1, -1, 2, -2, 3, -3]) / 3


def compute_rim(
    view: Contours,
    before: Contours,
    after: Contours,
    silhouettes: Silhouettes | None = None,
    context: Context | None = None,
) -> tuple[Rim, PoseEvidence]:
    """The rim of a view from two partners.

    Args:
        view: the contours, n samples.
        before, after: those of the two partners, usually on either side of the view.
        silhouettes: of other frames, which rim points must not fall outside of.
        context: what else is known; None: nothing.

    Source: E. Boyer and M.-O. Berger, "3D Surface Reconstruction Using Occluding Contours",
    IJCV 22(3), 1997, doi:10.1023/A:1007997617239; sections beside the steps.
    """
    work = _Work(view, silhouettes or Silhouettes([]), context or Context())
    one, two = work.partner(before), work.partner(after)

    # 2.1 correspondence; 3.1 depth and k_t, 3.2 the special cases (or one of section 4).
    found = _Known.none(len(view))
    found.status[one.pencil.along_ray | two.pencil.along_ray] = Status.MOTION_ALONG_RAY
    work.solve(one, two, found)
    # 2.1 multiple points: both views see the very same point, whatever its curvature.
    frontier_px = work.mark_frontier_points(one, found)

    # 6 the surface is smooth in pieces only: silhouettes, the rims of partners, other pairs.
    excess_px = work.give_up_outside(found)
    doubtful = work.contradicted(found, [one])
    todo = doubtful | np.isin(found.status, _OPEN)
    work.solve_by_others(found, todo, doubtful)
    return work.rim(found), PoseEvidence(frontier_px, excess_px, found.belief)


def revise_rim(
    rim: Rim, belief: Belief, view: Contours, silhouettes: Silhouettes, context: Context
) -> tuple[Rim | None, Array]:
    """A rim anew where frames that came since contradict points or give what was not to be had.

    Args:
        rim: as it is, of this view.
        belief: of its points; it is brought up to date.
        view, silhouettes, context: as of ``compute_rim``, with all frames that are known now.

    Returns:
        The rim, None where there is nothing to change; and (m,) how far its points were outside
        the worst silhouette, px.
    """
    work = _Work(view, silhouettes, context)
    found = _Known.of(rim, belief, view)
    depth = found.depth.copy()
    excess_px = work.give_up_outside(found)
    doubtful = work.contradicted(found, [work.partner(c) for c in context.neighbours])
    # Where the equations are ill-conditioned, others have been as well: beside frontier points.
    todo = doubtful | np.isin(found.status, _OPEN)
    work.solve_by_others(found, todo, doubtful)
    kept = found.depth == depth
    if np.array_equal(found.status, rim.status) and (~kept & (rim.status == GOOD)).sum() < _WORTH:
        return None, excess_px
    linked = context.previous is not None and context.previous.stamp_ns == rim.prev_stamp_ns
    new = work.rim(found, np.where(kept, rim.prev, np.nan) if linked else None)
    was, good = rim.status == GOOD, new.status == GOOD
    worse = was & ~good | np.isfinite(rim.prev) & np.isnan(new.prev) & was
    if not worse.any() and (good & ~(was & kept)).sum() < _WORTH:
        return None, excess_px
    new = replace(new, points=np.where(kept[:, None], rim.points, new.points))
    if new.prev_stamp_ns != rim.prev_stamp_ns:  # that frame has been forgotten
        prev = np.where(kept, rim.prev, np.nan)
        new = replace(new, prev=prev, prev_stamp_ns=rim.prev_stamp_ns)
    return new, excess_px


@dataclass
class _Known:
    """What is known of each sample: (n,) arrays, written in place when more is learnt.

    Attributes:
        depth: metres along the ray, NaN where unknown.
        q: 1 / (2 k_t), metres.
        belief: by errors of the contours alone.
        variance: of the depth, by these and errors of poses, m^2.
        status: a Status.
    """

    depth: Array
    q: Array
    belief: Belief
    variance: Array
    status: NDArray[np.uint8]

    @staticmethod
    def none(n: int) -> _Known:
        """Nothing is known yet."""
        status = np.full(n, Status.NO_CORRESPONDENT, np.uint8)
        depth, q = np.full((2, n), np.nan)
        return _Known(depth, q, Belief.none(n), np.full(n, np.inf), status)

    @staticmethod
    def of(rim: Rim, belief: Belief, view: Contours) -> _Known:
        """What a rim says."""
        depth = dot(rim.points - view.centre, view.T)
        with np.errstate(divide="ignore"):
            q = 0.5 / rim.curvature
        return _Known(depth, q, belief, rim.depth_sigma**2, rim.status.copy())

    def put(self, rows: Index, other: _Known, take: Mask | slice = slice(None)) -> None:
        """Take over what is found of some rows, where it is to be taken."""
        rows, theirs = rows[take], other.belief
        self.depth[rows], self.q[rows] = other.depth[take], other.q[take]
        self.belief.put(rows, Belief(theirs.depth[take], theirs.q[take], theirs.both[take]))
        self.variance[rows], self.status[rows] = other.variance[take], other.status[take]


class _Work:
    """The steps on one view's samples."""

    def __init__(self, view: Contours, silhouettes: Silhouettes, context: Context) -> None:
        self.view, self.silhouettes, self.context = view, silhouettes, context
        self.usable = np.isfinite(view.sigma)
        self._partners: dict[int, tuple[Partner, Mask]] = {}  # by stamp, and of which samples

    def partner(self, other: Contours, rows: Mask | None = None) -> Partner:
        """Another frame as a partner, of all usable samples or of some (n,) at least; the
        candidates of one sample are looked up once."""
        rows = self.usable if rows is None else rows & self.usable
        known, of = self._partners.get(other.stamp_ns, (None, rows))
        if known is None or (rows & ~of).any():
            known = Partner.of(self.view, other, rows)
            self._partners[other.stamp_ns] = known, rows
        return known

    def solve(self, one: Partner, two: Partner, found: _Known) -> None:
        """Write what two partners say of the samples that have candidates in them."""
        rows, i, j = choose_pairs(self.view, one, two, self.context.pose_sigma)
        if len(rows):
            found.put(rows, self._solved(one, two, rows, i, j))

    def _solved(self, one: Partner, two: Partner, rows: Index, i: Index, j: Index) -> _Known:
        """Depth and curvature of some samples from pairs of candidates."""
        view, settings, pose = self.view, self.context.settings, self.context.pose_sigma
        cross = one.cross.take(i), two.cross.take(j)
        best = solve(*cross)
        if len(again := best.ill_conditioned):
            before, after = one.rays(i[again]), two.rays(j[again])
            partner = after.centre, after.T, after.N
            ray = view.centre, view.T[rows[again]]
            best = solve_at_partner(best, again, cross[1], partner, ray, (before.centre, before.T))
        sigma = view.sigma[rows], one.sigma[i], two.sigma[j]
        belief, by_pose, gain = propagated(*cross, finite_q(best.curvature), sigma, pose)
        depth, curvature, status = best.depth, best.curvature, best.status
        if settings.estimator != "osculating_quadric":
            partners = [one.rays(i), two.rays(j)]
            # Correspondents in more frames are found from the points that three frames gave.
            if settings.estimator in MANY_FRAMES:
                more = self.context.more
                partners += [self._nearest_rays(c, rows, depth, curvature) for c in more]
            rays = Rays(view.centre, view.T[rows], view.N[rows], view.sigma[rows])
            other = ESTIMATORS[settings.estimator](rays, partners)
            known = np.isfinite(other.depth) & np.isfinite(other.depth_sigma)
            depth = np.where(known, other.depth, depth)
            curvature = np.where(known & np.isfinite(other.curvature), other.curvature, curvature)
            belief.depth[known] = other.depth_sigma[known] ** 2

        status[(status == GOOD) & ~(gain <= settings.amplification)] = Status.ILL_CONDITIONED
        depth = np.where(depth > 0, depth, np.nan)
        gone = np.isnan(depth) & (status != Status.MOTION_ALONG_RAY.value)
        status[gone] = Status.ILL_CONDITIONED
        with np.errstate(divide="ignore"):
            return _Known(depth, 0.5 / curvature, belief, belief.depth + by_pose, status)

    def _nearest_rays(self, other: Contours, rows: Index, depth: Array, curvature: Array) -> Rays:
        n, partner = len(self.view), self.partner(other)
        full_depth, full_q = np.full((2, n), np.nan)
        full_depth[rows], full_q[rows] = depth, 0.5 / curvature
        return rays_at(other, partner.positions(nearest(partner, full_depth, full_q))[rows])

    def mark_frontier_points(self, one: Partner, found: _Known) -> Array:
        """Give the samples nearest to the frontier points with a partner their depths; returns
        how far apart the two views see them, px."""
        view, shared = self.view, frontier_points(one.pencil)
        rows = view.nearest_row(shared.row)
        usable = self.usable[rows]
        rows, step = rows[usable], shared.points[usable] - view.centre
        found.depth[rows] = dot(step, view.T.take(rows, axis=0))
        found.status[rows] = Status.DOUBLE
        return shared.error / view.radians_per_pixel

    def points(self, rows: Index, depth: Array) -> Array:
        """(k, 3) at depths (k,) along the rays of samples (k,)."""
        points: Array = compiled().on_rays(self.view.centre, self.view.T, rows, depth)
        return points

    def give_up_outside(self, found: _Known) -> Array:
        """Mark good points outside a silhouette; returns by how much each is, px.

        A point that comes inside of all within what its depth is believed to is moved there:
        that is the likeliest depth of those that the silhouettes allow.
        """
        good = np.flatnonzero(found.status == GOOD)
        outside, within = self._moved_inside(good, found, good)
        found.status[good[~within]] = Status.OUTSIDE
        return outside

    def _moved_inside(self, rows: Index, found: _Known, entries: Index) -> tuple[Array, Mask]:
        """Move what is found of samples to the nearest depth, of some within what is believed,
        that is inside of all silhouettes.

        Args:
            rows: (k,) of the view.
            found: what is known; its depths are changed.
            entries: (k,) where there.

        Returns:
            (k,) how far each was outside the worst silhouette, px, and whether it is inside now.
        """
        view, tolerance = self.view, self.context.tolerance_px
        depth, sigma = found.depth[entries], np.sqrt(found.variance[entries])
        each = self.silhouettes.outside_px(self.points(rows, depth))
        outside: Array = np.fmax.reduce(each, axis=0, initial=-np.inf)
        within = ~(outside > tolerance)
        # No view sees a point move by more than it does.
        most_px = BELIEVED * sigma / (depth * view.radians_per_pixel)
        out = np.flatnonzero(~within & (outside - tolerance < most_px))
        if len(out):
            tried = depth[out] + _MOVES[:, None] * sigma[out]
            refuted = np.count_nonzero(each[:, out] > tolerance, axis=1)
            # Those that refute many come first: the others need not be asked.
            silhouettes = self.silhouettes.ordered(self.silhouettes.asked[np.argsort(-refuted)])
            T = view.T.take(rows[out], axis=0)
            first = silhouettes.first_inside(view.centre, T, tried, tolerance)
            within[out] = first >= 0
            moved = np.flatnonzero(first >= 0)
            found.depth[entries[out[moved]]] = tried[first[moved], moved]
        return outside, within

    def contradicted(
        self, found: _Known, partners: Sequence[Partner], among: Mask | None = None
    ) -> Mask:
        """(n,) which good samples, of all or some (n,), are not on one surface with the rims of
        partners."""
        broken = np.zeros(len(self.view), bool)
        asked = found.status == GOOD
        if among is not None:
            asked &= among
        depth = np.where(asked, found.depth, np.nan)
        for partner in partners:
            other = partner.pencil.other
            rim = self.context.rims.get(other.stamp_ns)
            if rim is None or not len(partner.candidates):
                continue
            entries = nearest(partner, depth, found.q)
            rows = np.flatnonzero(entries >= 0)
            entries = entries[rows]
            row, fraction = partner.candidates.row[entries], partner.candidates.fraction[entries]
            after = other.next_row[row]
            both = (rim.status[row] == GOOD) & (rim.status[after] == GOOD)
            rows, entries, row, fraction = (x[both] for x in (rows, entries, row, fraction))
            broken[rows] |= contradicts_neighbour(
                self.view,
                partner.cross.take(entries),
                found.depth[rows],
                found.q[rows],
                found.variance[rows],
                other.at(rim.depth, row, fraction),
                0.5 / rim.curvature[row],
                rim.depth_sigma[row] ** 2,
            )
        return broken

    def solve_by_others(self, found: _Known, todo: Mask, doubtful: Mask) -> None:
        """Solve what two partners did not by others: one may be hidden in the one and seen
        in the other, or seen by two on the same side only. The doubtful ones of them are
        given up if no others give a better point."""
        todo, changed = todo & self.usable, np.zeros(len(self.view), bool)
        for pair in self.context.pairs:
            if np.count_nonzero(todo) < _WORTH:
                break
            one, two = (self.partner(other, todo) for other in pair)
            rows, i, j = choose_pairs(self.view, one, two, self.context.pose_sigma, todo)
            if not len(rows):
                continue
            other = self._solved(one, two, rows, i, j)
            take = other.status == GOOD
            take &= ~doubtful[rows] | (np.abs(other.q) < 0.5 * np.abs(found.q[rows]))
            take[take] = self._moved_inside(rows[take], other, np.flatnonzero(take))[1]
            found.put(rows, other, take)
            doubtful[rows[take]] = todo[rows[take]] = False
            changed[rows[take]] = True
        found.status[doubtful & (found.status == GOOD)] = Status.NO_CORRESPONDENT
        if changed.any():
            asked = [known for known, of in self._partners.values() if of is self.usable]
            broken = self.contradicted(found, asked, changed)
            found.status[broken] = Status.NO_CORRESPONDENT

    def rim(self, found: _Known, links: Array | None = None) -> Rim:
        """The rim of what is found: small pieces left out, linked to the rim before.

        Args:
            links: (n,) positions in that rim where they are known, NaN for points that have none
                yet; None: of none.
        """
        view, previous = self.view, self.context.previous
        points = self.points(np.arange(len(view)), found.depth)
        good = found.status == GOOD
        jumps = depth_discontinuities(points, found.depth, found.q, found.belief, good, view)
        found.status[small_pieces(jumps, good, view)] = Status.NO_CORRESPONDENT
        unknown = np.isnan(found.depth)
        with np.errstate(divide="ignore"):
            curvature = 0.5 / found.q
        rim = replace(
            empty_rim(view),
            points=points,
            curvature=np.where(unknown, np.nan, curvature),
            depth_sigma=np.where(unknown, np.nan, np.sqrt(found.variance)),
            status=found.status,
        )
        if previous is None:
            return rim
        prev = self._linked(found, points, previous, links)
        return replace(rim, prev=prev, prev_stamp_ns=previous.stamp_ns)

    def _linked(
        self, found: _Known, points: Array, previous: Contours, known: Array | None
    ) -> Array:
        """(n,) positions of the correspondents in the frame before; none over a gap that other
        silhouettes show."""
        prev = np.full(len(self.view), np.nan) if known is None else known.copy()
        depth = np.where(np.isnan(prev), found.depth, np.nan)
        new = np.isfinite(depth)
        if new.any():
            partner = self.partner(previous, new)
            prev[new] = partner.positions(nearest(partner, depth, found.q))[new]
        rim = self.context.rims.get(previous.stamp_ns)
        if rim is not None:
            links = long_links(points, rim, prev, previous)
            most = self.context.tolerance_px + links.hollow_px(self.view)
            outside = self.silhouettes.worst_px(links.middle, most.max(initial=0.0))
            prev[links.rows[outside > most]] = np.nan
        return prev
