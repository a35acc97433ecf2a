"""Triangles between two consecutive rims, zipped along the epipolar correspondence.

Two rim points are joined if and only if they lie on consecutive rims (Boyer and Berger
1997, section 6). Both rims run the same way round the object, so along a stretch that
is matched without a break the two sequences are merged in order, and each new point
makes one triangle with the last point of either side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import Rim, Status

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def zip_rims(rim: Rim, previous: Rim, longest: float) -> Index:
    """Triangulate the strip between a rim and the one before it.

    Only points of status good are used, and no triangle spans a break: a sample
    without correspondent, a jump of the correspondent, or a step in space many times the
    usual one (two pieces of surface).

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
    owner = np.repeat(np.arange(len(i)), passed)
    offset = np.arange(len(owner)) - (np.cumsum(passed) - passed).take(owner)
    first, count = first.take(owner), count.take(owner)
    at = first + (start.take(owner) - first + offset) % count
    back = np.stack([i.take(owner), n + at, n + after_previous.take(at)], axis=1)
    back = back[step_previous.take(at)]

    triangles = np.concatenate([forward, back])
    return _outward(
        triangles,
        np.concatenate([rim.points, previous.points]),
        np.concatenate([rim.normals, previous.normals]),
    )


def next_rows(loop: NDArray[np.uint16]) -> Index:
    """(n,) the row after each row, closed within each run of equal loop numbers."""
    after = np.arange(1, len(loop) + 1)
    last = np.flatnonzero(np.append(np.diff(loop) != 0, True)) if len(loop) else after
    after[last] = np.concatenate([[0], last[:-1] + 1]) if len(loop) else after
    return after


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
    length = _lengths(points.take(after, axis=0) - points)
    if not both.any():
        return both
    with np.errstate(invalid="ignore"):
        return both & (length <= longest * np.median(length[both]))


def _outward(triangles: Index, points: Array, normals: Array) -> Index:
    """Drop triangles without area; turn the others to agree with their normals."""
    a, b, c = (points.take(corner, axis=0) for corner in triangles.T)
    facing = np.cross(b - a, c - a)
    mean = sum(normals.take(corner, axis=0) for corner in triangles.T)
    agree = np.einsum("tk,tk->t", facing, mean) >= 0
    turned = np.where(agree[:, None], triangles, triangles[:, [0, 2, 1]])
    return turned[_lengths(facing) > 0]


def _lengths(vectors: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
