"""How far around the object the camera has been, and whether its views follow each other there.

All is asked of the camera centres, (frames, 3) float64, metres, in the order of time.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree

from .arrays import Array, Index, evenly

_NEIGHBOURS = np.pi / 2
"""The widest step from one view to the next that may be taken for a way that was gone."""
_MISSING = 1.5
"""Usual steps that may be missing from the last position to the first of a whole turn."""
_SCATTERED = 4.0
"""Times the usual step between neighbours that successive views are apart which do not follow
each other: a second turn between the steps of the first makes it two, a third three."""
_SMALL = np.deg2rad(20)
"""Successive views that are no farther apart follow each other in any case: a table that has
turned many times has neighbours from all turns."""
_FLAT = 0.1
"""Height of the positions, of their extent, above which they are at several heights: around an
axis they are then nearer to each other than in truth."""
_ROUND = 0.2
"""Least extent, of the largest, along which the middle of the sphere is sought: along less, a few
positions nearer to the object would decide."""
WIDE = np.deg2rad(50)
"""From view to view: the cones of two views that are so far apart meet a tenth of the radius off a
round surface (1 / cos(25 degrees) - 1)."""
_MOST_COMPARED = 250  # positions among which neighbours are sought


def angle_covered(centres: Array | Sequence[Array]) -> float:
    """Angle over which a camera that goes around has seen the object, radians.

    That between its extreme positions; a whole turn where no more than one and a half
    usual steps are missing from the last position to the first. Where views do not follow each
    other around the object, it is all of the circle but for the widest gap.

    The centres are taken to lie about a circle: its plane is that of least squares, its
    middle the algebraic fit (Kasa 1976, doi:10.1109/TIM.1976.6312298). Of centres at several
    heights, the usual step is that between neighbours on the sphere about them.

    Returns:
        0 for fewer than three positions or positions on a line.
    """
    angle = np.unwrap(angles_around(centres))
    if not len(angle):
        return 0.0
    around = np.sort(np.mod(angle, 2 * np.pi))
    gaps = np.sort(np.diff(around, append=around[0] + 2 * np.pi))
    farthest = np.abs(np.diff(angle)).max()
    far = farthest > _NEIGHBOURS or (farthest > _SMALL and not follow_each_other(centres))
    covered = float(2 * np.pi - gaps[-1] if far else np.ptp(angle))
    usual = _usual(gaps[:-2])  # but for a hole, and for what is still to come
    if covered < 2 * np.pi <= covered + _NEIGHBOURS and _at_several_heights(centres):
        usual = max(usual, steps_between(centres)[1])
    return max(covered, 2 * np.pi) if covered + _MISSING * usual >= 2 * np.pi else covered


def widest_gap(centres: Array | Sequence[Array]) -> float:
    """Widest angle around the object without a view, wherever in a scan it is, radians.

    Returns:
        0 where it is no wider than steps that follow each other, or than what may be missing of a
        whole turn; for fewer than three positions or positions on a line.
    """
    angle = np.sort(angles_around(centres))
    if not len(angle) or rings_go_around(centres):
        return 0.0
    gaps = np.sort(np.diff(angle, append=angle[0] + 2 * np.pi))
    usual = max(_usual(gaps[:-2]), steps_between(centres)[1])
    return float(gaps[-1]) if gaps[-1] > max(_SMALL, _MISSING * usual) else 0.0


def step_over_gap(centres: Array | Sequence[Array]) -> tuple[int, int] | None:
    """The first two successive views between which the camera went over the ``widest_gap``.

    Returns:
        None where there is none, or no step goes over it, as where it is between the last view and
        the first; or where views do not follow each other.
    """
    if not widest_gap(centres) or not follow_each_other(centres):
        return None
    angle = angles_around(centres)
    around = np.sort(angle)
    gaps = np.diff(around, append=around[0] + 2 * np.pi)
    middle = around[np.argmax(gaps)] + 0.5 * gaps.max()
    step = (np.diff(angle) + np.pi) % (2 * np.pi) - np.pi
    way = np.mod(np.sign(step) * (middle - angle[:-1]), 2 * np.pi)
    over = np.flatnonzero(way < np.abs(step))
    return (int(over[0]), int(over[0]) + 1) if len(over) else None


def rings_go_around(centres: Array | Sequence[Array]) -> bool:
    """Whether a scan that is over goes all the way round by the steps along its rings: around the
    axis, the views of one come to lie between those of another, and steps seem smaller than any.

    Returns:
        Whether views follow each other, and the widest gap around the axis is that of no more than
        one and a half steps between successive views, all but the two widest.
    """
    T, angle = _directions(centres), np.sort(angles_around(centres))
    if not len(T) or not follow_each_other(centres):
        return False
    gap = np.diff(angle, append=angle[0] + 2 * np.pi).max()
    step = _angle(_usual(np.sort(np.linalg.norm(np.diff(T, axis=0), axis=1))[:-2]))
    return bool(gap <= min(_MISSING * step, WIDE))


def back_at_start(centres: Array | Sequence[Array]) -> bool:
    """Whether the camera has gone around to where it began, but for one leap over a part that it
    has not seen: a step at least twice as wide as all others.
    """
    angle = np.unwrap(angles_around(centres))
    if not len(angle):
        return False
    *steps, leap = np.sort(np.abs(np.diff(angle)))
    gone = float(np.ptp(angle)) + _MISSING * _usual(np.array(steps))
    return bool(2 * steps[-1] <= leap and gone >= 2 * np.pi)


def follow_each_other(centres: Array | Sequence[Array]) -> bool:
    """Whether successive views are about as near to each other as neighbours around the object
    are, in any number of turns and at any heights.
    """
    step, between_neighbours = steps_between(centres)
    return step <= max(_SMALL, _SCATTERED * between_neighbours)


def steps_between(centres: Array | Sequence[Array]) -> tuple[float, float]:
    """Usual angles between successive views, and between neighbours around the object, radians.

    Half of all the way is gone in steps of at least the usual: a table that stands, and an image
    that comes again, count for nothing. Neighbours are those along the shortest tree that joins
    all positions, as seen from the middle of the sphere that they lie about.

    Returns:
        0 and 0 for fewer than three positions or positions on a line.
    """
    T = _directions(centres)
    if not len(T):
        return 0.0, 0.0
    successive = np.linalg.norm(np.diff(T, axis=0), axis=1)
    some = T[evenly(len(T), min(len(T), _MOST_COMPARED))]
    chords = np.linalg.norm(some[:, None] - some, axis=2)
    tree = minimum_spanning_tree(chords).data
    return _angle(_usual(np.sort(successive))), _angle(_usual(np.sort(tree)))


def order_of_neighbours(centres: Array | Sequence[Array]) -> Index:
    """(frames,) numbers of the views, so that each is followed by the nearest that is left.

    The first is that after the widest gap around the object: an end, where a part of a turn was
    seen.

    Returns:
        The order as it is for fewer than three positions or positions on a line.
    """
    T, angle = _directions(centres), angles_around(centres)
    if not len(T):
        return np.arange(len(centres))
    around = np.argsort(angle)
    gaps = np.diff(angle[around], prepend=angle[around[-1]] - 2 * np.pi)
    order, away = np.zeros(len(T), np.intp), np.zeros(len(T))
    order[0] = around[np.argmax(gaps)]
    for k in range(1, len(T)):
        away[order[k - 1]] = np.inf
        order[k] = np.argmin(np.linalg.norm(T - T[order[k - 1]], axis=1) + away)
    return order


def angles_around(centres: Array | Sequence[Array]) -> Array:
    """Angle of each camera centre about the middle of the circle that they lie on.

    Returns:
        (frames,) float64, -pi to pi, from an arbitrary direction; none at all for fewer than
        three positions or positions on a line.
    """
    C, axes = _centred(centres)
    if not len(C):
        return np.zeros(0)
    xy = C @ axes[:2].T
    return np.asarray(np.arctan2(*(xy - _middle(xy)).T))


def _centred(centres: Array | Sequence[Array]) -> tuple[Array, Array]:
    """(frames, 3) centres from their mean, their largest number 1, and (3, 3) their axes, the
    longest first; none at all for fewer than three positions or positions on a line."""
    C = np.asarray(centres, np.float64).reshape(-1, 3)
    none = np.zeros((0, 3)), np.eye(3)
    if len(C) < 3:
        return none
    C = C - C.mean(axis=0)
    C /= max(float(np.abs(C).max()), 1e-300)  # squares of any unit are finite then
    _, size, axes = np.linalg.svd(C, full_matrices=False)
    return none if size[1] < 1e-6 * size[0] or size[0] == 0 else (C, axes)


def _middle(C: Array, least: float | None = None) -> Array:
    """(d,) of the circle or sphere about centred points (n, d), by the algebraic fit."""
    A = np.column_stack([2 * C, np.ones(len(C))])
    return np.asarray(np.linalg.lstsq(A, (C**2).sum(axis=1), rcond=least)[0][:-1])


def _directions(centres: Array | Sequence[Array]) -> Array:
    """(frames, 3) unit vectors from the middle of the sphere to the centres, none at all for
    fewer than three positions or positions on a line; (frames, 2) in the plane of those that lie
    about one, from the middle of their circle."""
    C, axes = _centred(centres)
    if not len(C):
        return C
    if _at_several_heights(centres):
        away = C - _middle(C, _ROUND)
    else:  # of a short arc, too, this is the middle
        away = C @ axes[:2].T
        away -= _middle(away)
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None])


def _at_several_heights(centres: Array | Sequence[Array]) -> bool:
    C, axes = _centred(centres)
    width, _, height = np.linalg.norm(C @ axes.T, axis=0)
    return bool(height > _FLAT * width)


def _usual(steps: Array) -> float:
    """That of at least which half of the way is gone; 0 of none. Steps are sorted."""
    way = np.cumsum(steps)
    return float(steps[np.searchsorted(way, 0.5 * way[-1])]) if len(way) else 0.0


def _angle(chord: float) -> float:
    """Of a chord of the unit circle, radians."""
    return float(2 * np.arcsin(min(1.0, 0.5 * chord)))
