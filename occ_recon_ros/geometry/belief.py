"""How far each sample is to be believed, and whether two things that are known agree.

Write q = 1 / (2 k_t): the paper's two equations are depth - a_i q = d_i, A x = d with
x = (depth, q). An error e of a contour across itself turns its ray by e / cos b within the
epipolar plane, and moves d_i + a_i q; to first order x moves by A^-1 of that. The errors of the
three contours are independent; so are those of the poses of the three views, but these are the
same for all samples of a view.

Whatever compares two things here (the crossings with two partners, neighbours on the rim, the rim
of a partner) compares their difference with the sigma of that difference, and allows it
``BELIEVED`` of them, beside what a smooth surface may do by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, lengths
from .compiled import compiled
from .contours import Contours
from .quadric import Crossing

Mask = NDArray[np.bool_]

BELIEVED = 3.0
"""Sigmas of a difference that is no contradiction: chi-square 9, 0.3 % of right samples."""

_JUMP = 8.0  # median steps along the rim: a longer one crosses from one piece of surface to another
_RADIUS_JUMP = 0.25  # of the object's radius, by which that of curvature differs from step to step
# Times the squared turn, by so much a surface leaves its circle: of the circle's radius, and at
# most of the object's.
_BEND, _MOST_BEND = 5.0, 1.0
_PIECE = 6  # samples: a smaller piece is not one that its neighbours confirm


@dataclass(frozen=True)
class Belief:
    """The 2 x 2 covariance of (depth, q) of each sample, (n,) float64 each, m^2.

    Attributes:
        depth, q: the two variances; infinite where the system is singular.
        both: their covariance.
    """

    depth: Array
    q: Array
    both: Array

    @property
    def depth_sigma(self) -> Array:
        """(n,) 1 sigma of the depth, metres."""
        return np.sqrt(self.depth)

    def put(self, rows: NDArray[np.intp], other: Belief) -> None:
        """Write that of some rows."""
        self.depth[rows], self.q[rows], self.both[rows] = other.depth, other.q, other.both

    @staticmethod
    def none(n: int) -> Belief:
        """Of n samples of which nothing is known."""
        return Belief(*np.full((3, n), np.inf))


def propagated(
    before: Crossing, after: Crossing, q: Array, sigma: tuple[Array, Array, Array], pose: float
) -> tuple[Belief, Array, Array]:
    """What errors of three contours, and of the poses of their views, make of depth and q.

    The partner's ray turns about its centre, and its crossing with the sample's ray moves by
    the distance times the angle over the sine; the sample's own ray does the same the other
    way. Both change the slope a_i.

    Args:
        before, after: the crossings with both partners, arrays (n,).
        q: (n,) 1 / (2 k_t), metres; 0 leaves out that an error also changes the slope.
        sigma: (n,) each, of the samples' own contour and of both partners', rad.
        pose: 1 sigma of a view's pose, rad.

    Returns:
        The belief by errors of the contours alone; (n,) the variance of the depth by those of
        poses alone, m^2; and (n,) how badly the system is conditioned, whatever the noise: the
        depth error that equal contour errors make, over that of one crossing of two rays across
        the contour.
    """
    found = np.full((5, len(q)), np.inf)
    compiled().propagated(before.arrays, after.arrays, q, sigma, float(pose), found)
    depth, q, both, by_pose, gain = found
    return Belief(depth, q, both), by_pose, gain


def depth_discontinuities(
    points: Array, depth: Array, q: Array, known: Belief, good: Mask, contours: Contours
) -> Mask:
    """Steps along the rim that do not stay on one smooth surface.

    Args:
        points: (n, 3) rim points, metres.
        depth: (n,) theirs, metres.
        q: (n,) 1 / (2 k_t), metres.
        known: of the n samples, by errors of their contours: those of poses are common to
            neighbours.
        good: (n,) which of them count.
        contours: the n samples.

    Returns:
        (n,) bool: True where the step to the next row is one, or leads to or from one that
        does not count.
    """
    after = contours.next_row
    both = good & good[after]
    if not both.any():
        return np.ones(len(good), bool)
    step = lengths(points.take(after, axis=0) - points)
    size = np.median(depth[good]) * contours.angular_radius
    with np.errstate(invalid="ignore"):
        depth_doubt = BELIEVED * np.sqrt(known.depth + known.depth[after])
        q_doubt = BELIEVED * np.sqrt(known.q + known.q[after])
        joined = both & (step <= _JUMP * np.median(step[both]) + depth_doubt)
        joined &= np.abs(q[after] - q) <= 0.5 * _RADIUS_JUMP * size + q_doubt
    return ~joined


def small_pieces(discontinuities: Mask, good: Mask, contours: Contours) -> Mask:
    """(n,) good samples on a stretch without discontinuity of fewer than a few samples: a match
    that its neighbours do not confirm, of a contour that comes out from behind another in one
    of the partners."""
    piece = np.cumsum(discontinuities[contours.previous_row])
    for first, last in zip(contours.loop_starts[:-1], contours.loop_starts[1:], strict=True):
        if not discontinuities[last - 1]:  # a piece goes on through the seam of the loop
            piece[first:last][piece[first:last] == piece[last - 1]] = piece[first]
    return good & (np.bincount(piece)[piece] < _PIECE)


def contradicts_neighbour(
    contours: Contours,
    cross: Crossing,
    depth: Array,
    q: Array,
    variance: Array,
    their_depth: Array,
    their_q: Array,
    their_variance: Array,
) -> Mask:
    """Samples that do not lie on one smooth surface with the rim of a partner.

    Where a piece of surface is hidden in a partner, the piece that hides it is met in its
    place. The crossing is then too far, and depth and radius of curvature run away together,
    which no silhouette need contradict. But the rim of the other partner, known already,
    knows better. Between two views the surface turns like a circle, to second order: it
    touches both rays as far from where they cross, so that depth = d + (d_other - depth of
    the other).

    Args:
        contours: the view.
        cross: crossings with the partner, (n,).
        depth, q, variance: of the samples, (n,): metres, metres, m^2 of the depth.
        their_depth, their_q, their_variance: of the partner's rim at the correspondents.

    Returns:
        (n,) bool, False where the partner says nothing, or where its own surface is the flatter
        one.
    """
    size = object_radius(contours, depth)
    with np.errstate(invalid="ignore"):
        apart = np.abs(depth - (cross.d + cross.d_other - their_depth))
        bend = np.minimum(2 * _BEND * np.abs(their_q), _MOST_BEND * size)
        most = bend * cross.sin**2 + BELIEVED * np.sqrt(variance + their_variance)
        return (apart > most) & (np.abs(q) > np.abs(their_q))


def object_radius(contours: Contours, d: Array) -> float:
    """Half the object's width, metres, from the angle it fills and usual depths (n,)."""
    d = d[d > 0]
    distance = float(np.median(d)) if len(d) else 1.0
    return distance * contours.angular_radius
