"""Which of the epipolar candidates is the correspondent: both partners decide together.

One plane may meet a contour many times (concave outlines, several loops, a handle before
a body). The order rule has removed the half of them that run the wrong way. Of the
rest, the pair (one candidate in each partner) is kept whose three rays are tangent to
one plausible piece of surface: in front of the cameras, with normals that turn no more
than the view does, and with a radius of curvature no larger than the object's: a match
to another piece of the outline needs a far larger one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, repeated
from .belief import BELIEVED, object_radius
from .compiled import compiled
from .contours import Contours
from .correspondence import Candidates, Pencil
from .estimators import Rays
from .quadric import Crossed, Crossing, crossed_candidates

Mask = NDArray[np.bool_]

_NORMAL_SCALE = 0.35  # rad by which a normal may turn beyond the turn of the view
_MOST_TURN = 0.7  # rad beyond that: the normals of two pieces that meet at a T-junction
_RADIUS = 2.0  # the largest radius of curvature, in radii of the object
_HOLLOW = 0.1  # and the least, below 0, that may come of a surface which is no parabola
_UNSURE_PX = 0.25  # 1 sigma of poses, as long as nothing better is known of them
_MOST_CANDIDATES = 8  # of a sample in a partner: those whose normals have turned least
_WORST = 10.0  # usual sigmas: what a sample beside a corner is worth as a correspondent


@dataclass(frozen=True)
class Partner:
    """What another view says of samples of a view.

    Attributes:
        pencil: of both views.
        crossed: all m candidates, and where their rays cross those of the samples.
    """

    pencil: Pencil
    crossed: Crossed

    @staticmethod
    def of(contours: Contours, other: Contours, rows: Mask | None = None) -> Partner:
        """Look up the candidates of all samples, or of some (n,)."""
        pencil = Pencil(contours, other)
        return Partner(pencil, crossed_candidates(pencil, rows))

    @property
    def candidates(self) -> Candidates:
        """All m."""
        return self.crossed.candidates

    @property
    def cross(self) -> Crossing:
        """Theirs."""
        return self.crossed.cross

    @cached_property
    def sigma(self) -> Array:
        """(m,) 1 sigma of the contour at the candidates, rad. One beside a corner counts as a
        correspondent, though not as a rim point: it is worth ten times less than usual."""
        other = self.pencil.other
        return np.minimum(other.sigma, _WORST * other.usual_sigma)[self.candidates.row]

    @cached_property
    def usable(self) -> Index:
        """The candidates that may be correspondents: crossed before both cameras, of a normal
        that has not turned away; of too many of one sample those that have turned least."""
        cross, sample = self.cross, self.candidates.sample
        with np.errstate(invalid="ignore"):
            fit = (cross.d > 0) & (cross.d_other > 0) & (self.crossed.turned <= _MOST_TURN)
        entries = np.flatnonzero(fit & np.isfinite(cross.d) & np.isfinite(cross.a))
        count = np.bincount(sample[entries], minlength=1)
        if count.max() > _MOST_CANDIDATES:
            by_turn = np.lexsort((self.crossed.turned[entries], sample[entries]))
            rank = repeated(count)[1]
            entries = np.sort(entries[by_turn[rank < _MOST_CANDIDATES]])
        return entries

    def rays(self, entries: Index) -> Rays:
        """Rays of chosen candidates (k,), which are there."""
        other, row = self.pencil.other, self.candidates.row[entries]
        fraction = self.candidates.fraction[entries]
        T, N = other.directions_at(row, fraction), other.normals_at(row, fraction)
        return Rays(other.centre, T, N, self.sigma[entries], self.cross.take(entries))

    def positions(self, entries: Index) -> Array:
        """(k,) fractional rows of chosen candidates, NaN where an entry is negative."""
        if not len(self.candidates):
            return np.full(len(entries), np.nan)
        found = self.candidates.row[entries] + self.candidates.fraction[entries]
        return np.where(entries < 0, np.nan, found)


def rays_at(other: Contours, position: Array) -> Rays:
    """Rays at fractional rows (k,) of a frame, NaN where the row is."""
    row, fraction = other.split(position)
    sigma = np.minimum(other.sigma, _WORST * other.usual_sigma)[row]
    sigma = np.where(np.isfinite(position), sigma, np.nan)
    T, N = other.directions_at(row, fraction), other.normals_at(row, fraction)
    return Rays(other.centre, T, N, sigma)


def choose_pairs(
    contours: Contours,
    before: Partner,
    after: Partner,
    pose_sigma: float,
    rows: Mask | None = None,
) -> tuple[Index, Index, Index]:
    """The candidate of each sample in both partners: of all pairs that are possible the cheapest.

    d_-1 - d_1 = (a_1 - a_-1) q, with a q between 0 and what the object has room for: what is
    left of that must come of errors.

    Args:
        contours: n samples.
        before, after: the partners.
        pose_sigma: 1 sigma of a view's pose, rad across its contours.
        rows: (n,) which samples are asked for; None: all that have candidates.

    Returns:
        The k samples of which a pair is possible, ascending, and the entries of its candidates
        in the two partners, (k,) intp each.
    """
    pose = max(pose_sigma, _UNSURE_PX * contours.radians_per_pixel)
    sides = []
    for partner in (before, after):
        entries, samples = partner.usable, partner.candidates.sample
        if rows is not None:
            entries = entries[rows[samples[entries]]]
        values = *partner.cross.arrays, partner.crossed.turned, partner.sigma
        sides.append((entries, samples, *values))
    size = object_radius(contours, before.cross.d[sides[0][0]])
    limits = -0.5 * _HOLLOW * size, 0.5 * _RADIUS * size, size, _NORMAL_SCALE, BELIEVED
    cost, pair = np.full(len(contours), np.inf), np.empty((2, len(contours)), np.intp)
    compiled().cheapest_pairs(*sides, contours.sigma, pose, limits, cost, pair)
    samples = np.flatnonzero(np.isfinite(cost))
    return samples, pair[0, samples], pair[1, samples]


def nearest(partner: Partner, depth: Array, q: Array) -> Index:
    """The candidate of each known point whose ray passes nearest to it.

    There the point lies inside the outline, by what the surface has curved away since:
    about angle^2 q / distance. A candidate much farther off is on another piece.

    Args:
        partner: for all n samples.
        depth: (n,) of their rim points, metres, NaN where unknown.
        q: (n,) 1 / (2 k_t), metres.

    Returns:
        (n,) intp, entry of the candidate, -1 where there is none.
    """
    pencil, candidates = partner.pencil, partner.candidates
    if not len(candidates):
        return np.full(len(depth), -1)
    blur = 8 * _UNSURE_PX * pencil.other.radians_per_pixel
    rays = candidates.sample, partner.crossed.cos, partner.crossed.sin
    here = pencil.here.cos, pencil.here.sin
    entries = np.full(len(depth), -1, np.intp)
    compiled().nearest(*rays, here, pencil.baseline, blur, depth, q, entries)
    return entries
