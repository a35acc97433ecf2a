"""The hot loops of outlines, compiled: as ``geometry.kernels``."""

import numpy as np
from numba import njit

_compiled = njit(cache=True, nogil=True, error_model="numpy")

_STIFF = 1e7  # from which on rounding would tell


@_compiled
def normals(points, reach):
    """As ``curves.normals``."""
    n = len(points)
    out = np.empty((n, 2))
    for i in range(n):
        before, after = (i - reach) % n, (i + reach) % n
        x, y = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]
        length = np.sqrt(x * x + y * y)
        if length == 0:
            length = 1.0
        out[i, 0], out[i, 1] = -y / length, x / length
    return out


@_compiled
def curvature(points, reach):
    """As ``curves.curvature``."""
    n = len(points)
    bend = np.empty(n)
    for i in range(n):
        before, after = (i - reach) % n, (i + reach) % n
        ax, ay = points[i, 0] - points[before, 0], points[i, 1] - points[before, 1]
        bx, by = points[after, 0] - points[i, 0], points[after, 1] - points[i, 1]
        length = np.sqrt(ax * ax + ay * ay) + np.sqrt(bx * bx + by * by)
        turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        # Convex object on the left, y down: it turns counter-clockwise, the cross product < 0.
        bend[i] = -2.0 * turn / (length if length > 0 else 1.0)
    return bend


@_compiled
def resampled(points, spacing):
    """As ``curves.resample``."""
    n = 0
    x, y, step = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    total = 0.0
    for i in range(len(points)):
        after = i + 1 if i + 1 < len(points) else 0
        length = np.hypot(points[after, 0] - points[i, 0], points[after, 1] - points[i, 1])
        if length > 1e-9:
            x[n], y[n], step[n] = points[i, 0], points[i, 1], length
            n, total = n + 1, total + length
    if not n:
        raise ValueError("a loop of no length")
    count = max(8, int(np.rint(total / spacing)))
    found = np.empty((count, 2))
    i, start, end = 0, 0.0, step[0]
    for j in range(count):
        s = j * (total / count)
        while s >= end and i < n - 1:
            i += 1
            start, end = end, end + step[i]
        before, after, last = (i - 1) % n, (i + 1) % n, (i + 2) % n
        f = (s - start) / step[i]
        one, two = step[i] / (step[i] + step[before]), step[i] / (step[after] + step[i])
        for z, c in ((x, 0), (y, 1)):
            a, b, way = (z[after] - z[before]) * one, (z[last] - z[i]) * two, z[after] - z[i]
            found[j, c] = z[i] + f * (a + f * (3 * way - 2 * a - b + f * (a + b - 2 * way)))
    return found


@_compiled
def smoothed(points, weight, k, pad):
    """As ``smooth.smooth_closed``: the loop (n, d) is gone on with for ``pad`` samples at both
    ends, and the banded system solved as L D L^T.

    Stiff as it may be, entries of 1e12 beside weights of 1, what is left over is solved for once
    more; third differences tell it without loss of digits.
    """
    n, d = points.shape
    rows = n + 2 * pad
    at, stiff = np.empty(rows, np.intp), np.zeros(rows)
    at[0] = -pad % n
    for i in range(1, rows):
        at[i] = at[i - 1] + 1 if at[i - 1] + 1 < n else 0
    # The third difference over samples i..i+3 takes the lower stiffness of its middle two.
    for i in range(rows - 3):
        stiff[i] = min(k[at[i + 1]], k[at[i + 2]])
    inverse, lower = _factors(weight, stiff, at)
    found, left = np.empty((rows, d)), np.empty((rows, d))
    for c in range(d):
        found[:, c] = points[:, c].mean()
    for turn in range(2 if k.max() > _STIFF else 1):
        for i in range(rows):
            for c in range(d):
                left[i, c] = (weight[at[i]] + 1e-9) * (points[at[i], c] - found[i, c])
        for i in range(rows - 3 if turn else 0):
            for c in range(d):
                bend = found[i + 3, c] - found[i, c] - 3 * (found[i + 2, c] - found[i + 1, c])
                left[i, c] += stiff[i] * bend
                left[i + 1, c] -= 3 * stiff[i] * bend
                left[i + 2, c] += 3 * stiff[i] * bend
                left[i + 3, c] -= stiff[i] * bend
        _solve(inverse, lower, left)
        found += left
    return found[pad : pad + n].copy()


@_compiled
def _factors(weight, stiff, at):
    """1 / D (rows + 3,) and the three diagonals of L (rows + 3, 3) below that of ones."""
    rows = len(at)
    diagonal, lower = np.zeros(rows + 3), np.zeros((rows + 3, 3))
    for i in range(rows):
        diagonal[i] += weight[at[i]] + 1e-9
        if i < rows - 3:
            diagonal[i] += stiff[i]
            diagonal[i + 1] += 9 * stiff[i]
            diagonal[i + 2] += 9 * stiff[i]
            diagonal[i + 3] += stiff[i]
            lower[i, 0] -= 3 * stiff[i]
            lower[i + 1, 0] -= 9 * stiff[i]
            lower[i + 2, 0] -= 3 * stiff[i]
            lower[i, 1] += 3 * stiff[i]
            lower[i + 1, 1] += 3 * stiff[i]
            lower[i, 2] -= stiff[i]
    for i in range(rows):
        if not diagonal[i] > 0:
            raise ValueError("the smooth curve is lost in rounding")
        one, two, three = lower[i]
        inverse = 1 / diagonal[i]
        a, b, c = one * inverse, two * inverse, three * inverse
        diagonal[i + 1] -= one * a
        diagonal[i + 2] -= two * b
        diagonal[i + 3] -= three * c
        lower[i + 1, 0] -= two * a
        lower[i + 1, 1] -= three * a
        lower[i + 2, 0] -= three * b
        lower[i, 0], lower[i, 1], lower[i, 2], diagonal[i] = a, b, c, inverse
    return diagonal, lower


@_compiled
def _solve(inverse, lower, right):
    """The solution takes the place of the right sides (rows, d)."""
    rows, d = right.shape
    for c in range(d):
        one = two = three = 0.0  # of the rows before, times L
        for i in range(rows):
            here = right[i, c] - one
            one = two + lower[i, 0] * here
            two, three = three + lower[i, 1] * here, lower[i, 2] * here
            right[i, c] = here * inverse[i]
        one = two = three = 0.0  # of the rows after
        for i in range(rows - 1, -1, -1):
            here = right[i, c] - (lower[i, 0] * one + lower[i, 1] * two + lower[i, 2] * three)
            one, two, three = here, one, two
            right[i, c] = here
