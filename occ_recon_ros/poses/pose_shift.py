"""Poses that came with images by their numbers, and are those of the images after or before.

One image was lost, or one pose, and all that follow have that of another view. Their steps need not
be even. How the tangent planes of all pairs of views differ tells: the views before agree with each
other, and so do those after, but not the ones with the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array

from .refine_rig import Rig
from .refine_tangencies import HullView, Tangencies, hulls_of

_FARTHEST = 3  # places, by which poses are looked for
_FEWEST, _MOST = 6, 100  # views; more are a few degrees apart, and a place is next to nothing
_SOME = 3  # views that have the poses of others; of fewer each is looked at by itself
_MOST_OFF = 10.0  # sigmas by which planes differ, of which more counts no more
_APART = 1.3  # times what views on one side differ by, that they do across, where any are asked
_AT_ONE = 2.5  # the same that is left at most: of views on the other side of the object it is more
_BETTER = 0.6  # of what they differ by as given, with less of which left a shift is taken
_CLEARLY = 0.999  # of that of another, from which on fewer views are taken to be shifted
_SURE = 2.0  # sigmas, by less of which all views differ where nothing is to be asked


@dataclass(frozen=True)
class PoseShift:
    """Which views have the pose of another.

    Attributes:
        first: number of the first view that has it; 0: all have.
        by: places from a view to the one whose pose it has, 1: the next.
        given: of each of n views, the number of the view that was given its pose; -1: none was.
    """

    first: int
    by: int
    given: tuple[int, ...]


def pose_shift(contours: Sequence[Contours | None], cameras: Sequence[Camera]) -> PoseShift | None:
    """The shift with which all outlines agree; None where they do as they are, or with none.

    Args:
        contours: of n views in the order of their numbers, None where there is none.
        cameras: of these, as given; metres, object frame.
    """
    hulls = hulls_of(contours, cameras)
    n = len(hulls)
    if n > _MOST or sum(hull is not None for hull in hulls) < _FEWEST:
        return None
    as_given = _Apart.of(hulls, cameras, cameras)
    if not any(as_given.stands_out(k) for k in range(n)):
        return None
    whole = slice(0, n)
    best, least = None, _mean(as_given.sums(whole, whole))
    for by in sorted(set(range(-_FARTHEST, _FARTHEST + 1)) - {0}, key=abs):
        others = [placed_as(camera, cameras[(k - by) % n]) for k, camera in enumerate(cameras)]
        within = _Apart.of(hulls, others, others)
        across = _Apart.of(hulls, cameras, others)
        for first in (0, *range(n - 1, 0, -1)):
            told = _told(first, by, n) if first else range(n)
            if len(told) < _SOME:
                continue
            before, after = slice(0, first), slice(told.start, told.stop)
            inside = as_given.sums(before, before) + within.sums(after, after)
            between = across.sums(before, after)
            off = _mean(inside + between)
            if off > _CLEARLY * least:
                continue
            least = off
            if first:
                was = _mean(as_given.sums(before, slice(first, n)))
                right = _mean(between) < min(_AT_ONE * _mean(inside), _BETTER * was)
            else:
                right = off < _BETTER * _mean(as_given.sums(whole, whole))
            own = [k if k < first else -1 for k in range(n)]
            own[after] = [(k - by) % n for k in told]
            best = PoseShift(first, by, tuple(own)) if right else None
    return best


def placed_as(lens: Camera, there: Camera) -> Camera:
    """A camera with the pose of another."""
    R, t = there.R_camera_object, there.t_camera_object
    return replace(lens, R_camera_object=R, t_camera_object=t)


def _told(first: int, by: int, n: int) -> range:
    """The views from the first on whose own poses others of these were given."""
    return range(first + max(by, 0), n + min(by, 0))


def _mean(sums: Array) -> float:
    return float(sums[0] / sums[1]) if sums[1] else np.inf


@dataclass(frozen=True)
class _Apart:
    """By how much the tangent planes of pairs of views differ.

    Attributes:
        sums_to: (2, n + 1, n + 1) float64, of those of views before each two numbers, the sum of
            what they differ by, sigmas, and the count.
    """

    sums_to: Array

    @staticmethod
    def of(
        hulls: Sequence[HullView | None], one: Sequence[Camera], other: Sequence[Camera]
    ) -> _Apart:
        """Of each view of the one cameras with each later view of the other cameras."""
        n = len(hulls)
        both = Tangencies([*hulls, *hulls]).between(np.arange(2 * n) < n)
        residuals, place = both.residuals(Rig.of([*one, *other]))
        off = np.minimum(np.abs(residuals.value) / residuals.sigma, _MOST_OFF)
        first, second = both.pairs[:, place // 2] - np.array([[0], [n]])
        table, later = np.zeros((2, n + 1, n + 1)), second > first
        np.add.at(table[0], (first[later] + 1, second[later] + 1), off[later])
        np.add.at(table[1], (first[later] + 1, second[later] + 1), 1.0)
        return _Apart(table.cumsum(axis=1).cumsum(axis=2))

    def sums(self, rows: slice, columns: slice) -> Array:
        """(2,) of the pairs of views of two ranges of numbers, the earlier in the first."""
        s = self.sums_to
        a, b, c, d = rows.start, rows.stop, columns.start, columns.stop
        return np.asarray(s[:, b, d] - s[:, a, d] - s[:, b, c] + s[:, a, c])

    def stands_out(self, first: int) -> bool:
        """Whether views before a number differ from those after by more than among themselves; of
        0, whether all do."""
        n = self.sums_to.shape[1] - 1
        before, after = slice(0, first), slice(first, n)
        if not first:
            return _mean(self.sums(after, after)) > _SURE
        inside = self.sums(before, before) + self.sums(after, after)
        return _mean(self.sums(before, after)) > _APART * _mean(inside)
