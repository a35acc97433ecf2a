"""Triangles between two consecutive rims, zipped along the epipolar correspondence.

Two rim points are joined if and only if they lie on consecutive rims (Boyer and Berger
1997, section 6). Both rims run the same way round the object, so along a stretch that
is matched without a break the two sequences are merged in order, and each new point
makes one triangle with the last point of either side.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..geometry import Rim, Status
from ..geometry.arrays import Array, Index, lengths, repeated

_STRETCHED = 2.5  # times the usual distance between the rims, or along them
_NEIGHBOURS = 15
_ROUNDS = 3
_SPLINTER = 3.0  # a piece of a strip so much longer than it is wide is none


def zip_rims(rim: Rim, previous: Rim, longest: float) -> Index:
    """Triangulate the strip between a rim and the one before it.

    Only points of status good are used, and no triangle spans a break: a sample
    without correspondent, a jump of the correspondent, a step in space many times the
    usual one (two pieces of surface), or a distance between the rims that does not go with
    the neighbours'. None faces away from the normal of one of its corners.

    Args:
        rim: n rows; its ``prev`` holds positions in the previous rim.
        previous: m rows.
        longest: the longest step along either rim that still joins two points, as a
            multiple of the usual (median) step.

    Returns:
        (t, 3) intp triangles of vertex numbers: 0 to n-1 the rim's rows, n to n+m-1 the
        previous rim's; outward by the right-hand rule.
    """
    n, m = len(rim), len(previous)
    after, after_previous = next_rows(rim.loop), next_rows(previous.loop)
    good, good_previous = rim.status == Status.GOOD, previous.status == Status.GOOD
    step = _steps_joined(rim.points, after, good, longest)
    step_previous = _steps_joined(previous.points, after_previous, good_previous, longest)

    # Each step i -> after[i] of the rim passes the rows floor(f) + 1 .. of the other.
    matched = (rim.prev >= 0) & (rim.prev < m)
    row = np.where(matched, rim.prev, 0).astype(np.intp)
    i = np.flatnonzero(step & matched & matched.take(after))
    start, end = row.take(i), row.take(after).take(i)
    first, count = (bound.take(start) for bound in _loop_bounds(previous.loop))
    passed = (end - start) % count
    # On one loop, with less than a quarter of it between them.
    same = (end >= first) & (end < first + count) & (passed <= count // 4)
    i, start, end, passed = i[same], start[same], end[same], passed[same]
    first, count = first[same], count[same]

    # A new point of this rim, with the last point of the other ...
    forward = np.stack([i, after.take(i), n + end], axis=1)[good_previous.take(end)]
    # ... and each new point of the other, with the last of this.
    owner, offset = repeated(passed)
    first, count = first.take(owner), count.take(owner)
    at = first + (start.take(owner) - first + offset) % count
    back = np.stack([i.take(owner), n + at, n + after_previous.take(at)], axis=1)
    back = back[step_previous.take(at)]

    triangles = np.concatenate([forward, back])
    points = np.concatenate([rim.points, previous.points])
    if len(triangles):
        triangles = _unstretched(triangles, points, n)
    return _outward(triangles, points, np.concatenate([rim.normals, previous.normals]))


def next_rows(loop: NDArray[np.uint16]) -> Index:
    """(n,) the row after each row, closed within each run of equal loop numbers."""
    first, count = _loop_bounds(loop)
    return first + (np.arange(len(loop)) - first + 1) % count


def _loop_bounds(loop: NDArray[np.uint16]) -> tuple[Index, Index]:
    """(m,) first row and (m,) number of rows of the loop that each row is in."""
    starts = np.flatnonzero(np.append(True, np.diff(loop) != 0))
    counts = np.diff(np.append(starts, len(loop)))
    return np.repeat(starts, counts), np.repeat(counts, counts)


def _steps_joined(
    points: Array, after: Index, good: NDArray[np.bool_], longest: float
) -> NDArray[np.bool_]:
    """(n,) whether a row and the one after it are good and lie on one piece of surface."""
    both = good & good.take(after)
    length = lengths(points.take(after, axis=0) - points)
    if not both.any():
        return both
    with np.errstate(invalid="ignore"):
        return both & (length <= longest * np.median(length[both]))


def _unstretched(triangles: Index, points: Array, n: int) -> Index:
    """Those triangles that are not much longer from rim to rim than their neighbours: such a
    match has gone from one piece of surface to another."""
    triangles = triangles[np.argsort(triangles[:, 0], kind="stable")]
    for _ in range(_ROUNDS):
        ends = triangles, triangles[:, [1, 2, 0]]
        sides = points.take(ends[0], axis=0) - points.take(ends[1], axis=0)
        length = np.sqrt(np.einsum("tij,tij->ti", sides, sides))
        across = (ends[0] < n) != (ends[1] < n)
        widest = np.where(across, length, 0).max(axis=1, initial=0)
        usual = median_filter(widest, _NEIGHBOURS, mode="mirror")
        fine = widest <= _STRETCHED * np.maximum(usual, np.median(length[~across]))
        if fine.all():
            break
        triangles = triangles[fine]
    return triangles[~_splinters(triangles, points, n)]


def _splinters(triangles: Index, points: Array, n: int) -> NDArray[np.bool_]:
    """(t,) True where a piece of the strip is far longer from rim to rim than along them: a few
    points that are matched alike but not as their neighbours are.

    Args:
        triangles: in the order of the rim's rows, the first corner of each.
    """
    sides = points.take(triangles, axis=0) - points.take(triangles[:, [1, 2, 0]], axis=0)
    length = np.sqrt(np.einsum("tij,tij->ti", sides, sides))
    across = (triangles < n) != (triangles[:, [1, 2, 0]] < n)
    begins = np.diff(triangles[:, 0], prepend=-2) > 1
    if not begins.any():
        return begins
    piece, starts = np.cumsum(begins) - 1, np.flatnonzero(begins)
    wide = np.maximum.reduceat(np.where(across, length, 0).max(axis=1), starts)
    # Every triangle has a side along one rim or the other.
    tall = np.add.reduceat(np.where(across, 0, length).sum(axis=1), starts) / 2
    return np.asarray((_SPLINTER * tall < wide)[piece])


def _outward(triangles: Index, points: Array, normals: Array) -> Index:
    """Turn triangles to agree with their normals; drop those that do not with all of them, or
    have no area."""
    a, b, c = (points.take(corner, axis=0) for corner in triangles.T)
    facing = np.cross(b - a, c - a)
    agree = np.einsum("tk,tck->tc", facing, normals.take(triangles, axis=0))
    turned = np.where(agree[:, :1] >= 0, triangles, triangles[:, [0, 2, 1]])
    return turned[(agree > 0).all(axis=1) | (agree < 0).all(axis=1)]
