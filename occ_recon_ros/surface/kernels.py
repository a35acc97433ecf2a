"""The hot loops of carving and closing, compiled: as ``geometry.kernels``."""

import numpy as np
from numba import njit

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def raise_to_cone(points, P, image, pixel, most, worst):
    """Raise ``worst`` (n,) to how far points (n, 3) are outside of a cone, where it is not above
    ``most`` yet.

    Args:
        points: (n, 3).
        P: (3, 4) that takes them to (column z, row z, z) in the image.
        image: (h, w) signed distances, pixels.
        pixel: at distance 1.
        most: what is farther outside is out anyway.
        worst: (n,) metres; written.
    """
    height, width = image.shape
    for p in range(len(points)):
        if worst[p] > most:
            continue
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        z = P[2, 0] * X + P[2, 1] * Y + P[2, 2] * Z + P[2, 3]
        if not z > 0:
            continue
        u = (P[0, 0] * X + P[0, 1] * Y + P[0, 2] * Z + P[0, 3]) * (1 / z)
        v = (P[1, 0] * X + P[1, 1] * Y + P[1, 2] * Z + P[1, 3]) * (1 / z)
        x, y = u, v
        if not (0 <= u <= width - 1 and 0 <= v <= height - 1):
            x, y = min(max(u, 0.0), width - 1.0), min(max(v, 0.0), height - 1.0)
        i, j = min(int(y), height - 2), min(int(x), width - 2)
        f, g = y - i, x - j
        above = image[i, j] + g * (image[i, j + 1] - image[i, j])
        below = image[i + 1, j] + g * (image[i + 1, j + 1] - image[i + 1, j])
        distance = above + f * (below - above)
        if distance > 0 and (u != x or v != y):
            distance += np.hypot(u - x, v - y)
        worst[p] = max(worst[p], distance * pixel * z)


@_compiled
def projected(x, normals, rows, points, across, weights, reach, facing):
    """One step of vertices towards the surface that samples show.

    Args:
        x, normals: (n, 3) vertices and their normals.
        rows: (n, k) samples near to each; their number, or more, where there are no more.
        points, across, weights: (m, 3), (m, 3), (m,) of the samples.
        reach: metres, the standard deviation of the weights.
        facing: least cosine between normals.

    Returns:
        (n,) total weight, (n, 3) mean normal, not of length 1, (n,) move against the mean's
        direction and (n,) how far aside the samples lie, metres.
    """
    n, k = rows.shape
    total, mean = np.zeros(n), np.zeros((n, 3))
    move, aside = np.zeros(n), np.zeros(n)
    for v in range(n):
        a, b, c, N0, N1, N2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        height = 0.0
        for i in range(k):
            s = rows[v, i]
            if s >= len(points):
                continue
            cos = across[s, 0] * normals[v, 0] + across[s, 1] * normals[v, 1]
            if cos + across[s, 2] * normals[v, 2] <= facing:
                continue
            dx, dy, dz = x[v, 0] - points[s, 0], x[v, 1] - points[s, 1], x[v, 2] - points[s, 2]
            w = np.exp(-0.5 * (dx * dx + dy * dy + dz * dz) / reach**2) * weights[s]
            total[v] += w
            a, b, c = a + w * dx, b + w * dy, c + w * dz
            N0, N1, N2 = N0 + w * across[s, 0], N1 + w * across[s, 1], N2 + w * across[s, 2]
            height += w * (dx * across[s, 0] + dy * across[s, 1] + dz * across[s, 2])
        if total[v] > 0:
            a, b, c = a / total[v], b / total[v], c / total[v]
            mean[v, 0], mean[v, 1], mean[v, 2] = N0 / total[v], N1 / total[v], N2 / total[v]
            length = np.sqrt(N0 * N0 + N1 * N1 + N2 * N2)
            move[v] = 0.5 * (height / total[v] + (a * N0 + b * N1 + c * N2) / length)
            aside[v] = np.sqrt(a * a + b * b + c * c)
    return total, mean, move, aside


@_compiled
def to_outline(u, v, xy, after, before, linked, reach, nearest, found):
    """Signed distances of some pixels to an outline; chords over gaps are no part of it.

    Args:
        u, v: (p,) columns and rows of the pixels.
        xy: (n, 2) the samples.
        after, before, linked: (n,) their next and previous rows, and whether the outline follows
            the step to the next.
        reach: pixels within which most have a sample.
        nearest: (height, width) int32, -1; written: the sample nearest to each pixel in reach.
        found: (p,) float64; written: pixels, outside positive.
    """
    height, width = nearest.shape
    for k in range(len(xy)):
        x, y = xy[k, 0], xy[k, 1]
        for i in range(max(int(y - reach), 0), min(int(y + reach) + 2, height)):
            for j in range(max(int(x - reach), 0), min(int(x + reach) + 2, width)):
                other = nearest[i, j]
                if other < 0 or (j - x) ** 2 + (i - y) ** 2 < (
                    (j - xy[other, 0]) ** 2 + (i - xy[other, 1]) ** 2
                ):
                    nearest[i, j] = k
    for p in range(len(u)):
        row = nearest[v[p], u[p]]
        if row < 0:
            least = np.inf
            for k in range(len(xy)):
                square = (xy[k, 0] - u[p]) ** 2 + (xy[k, 1] - v[p]) ** 2
                if square < least:
                    row, least = k, square
        # Two sides meet at the nearest corner; one of them is nearest but in odd cases.
        d0, s0 = _to_side(u[p], v[p], xy, row, after[row])
        d1, s1 = _to_side(u[p], v[p], xy, before[row], row)
        if not linked[row]:
            d0 = np.inf
        if not linked[before[row]]:
            d1 = np.inf
        side = s0 if d0 < d1 else s1
        if abs(d0 - d1) < 1e-9:  # at the corner itself the point is outside of the sharper
            side = s0 + s1
        found[p] = np.copysign(min(d0, d1), side)


@_compiled
def _to_side(x, y, xy, first, last):
    """Distance to a side, and a number positive outside it."""
    X, Y = xy[last, 0] - xy[first, 0], xy[last, 1] - xy[first, 1]
    length = max(np.sqrt(X * X + Y * Y), 1e-12)
    dx, dy = x - xy[first, 0], y - xy[first, 1]
    part = min(max((dx * X + dy * Y) / length**2, 0.0), 1.0)
    return np.hypot(dx - part * X, dy - part * Y), (X * dy - Y * dx) / length
