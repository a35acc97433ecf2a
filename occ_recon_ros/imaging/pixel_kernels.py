"""The hot loops over pixels, compiled: as ``geometry.kernels``."""

import numpy as np
from numba import njit

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def across(image, points, out, u):
    """(n, m, channels) float32 values of an image (h, w, channels), between its pixels, at
    distances u (m,) along unit vectors (n, 2) from points (n, 2); the nearest ones outside."""
    height, width, channels = image.shape
    n, m = len(points), len(u)
    found = np.empty((n, m, channels), np.float32)
    right, bottom = width - 1.001, height - 1.001
    x, y = np.empty(m), np.empty(m)
    for i in range(n):
        for j in range(m):
            a, b = points[i, 0] + u[j] * out[i, 0], points[i, 1] + u[j] * out[i, 1]
            a, b = a if a > 0 else 0.0, b if b > 0 else 0.0  # NaN, too
            x[j], y[j] = a if a < right else right, b if b < bottom else bottom
        for j in range(m):
            column, row = int(x[j]), int(y[j])
            fx, fy = np.float32(x[j] - column), np.float32(y[j] - row)
            for c in range(channels):
                top, low = np.float32(image[row, column, c]), np.float32(image[row + 1, column, c])
                top += fx * (np.float32(image[row, column + 1, c]) - top)
                low += fx * (np.float32(image[row + 1, column + 1, c]) - low)
                found[i, j, c] = top + fy * (low - top)
    return found


@_compiled
def change_across(values):
    """(n, channels) by how much the mean of the last third of values (n, m, channels) is above that
    of the first third."""
    n, m, channels = values.shape
    third, found = max(1, m // 3), np.zeros((n, channels))
    for i in range(n):
        for j in range(third):
            for c in range(channels):
                found[i, c] += (values[i, m - third + j, c] - values[i, j, c]) / third
    return found


@_compiled
def seen_along(values, directions):
    """(n, m) float32: values (n, m, channels) along directions (n, channels) of colour."""
    n, m, channels = values.shape
    found = np.zeros((n, m), np.float32)
    for i in range(n):
        for j in range(m):
            for c in range(channels):
                found[i, j] += values[i, j, c] * np.float32(directions[i, c])
    return found


@_compiled
def beyond(image, plane, mask):
    """Write 255 where B, G, R and 1 times a plane (4,) of float32 are above 0, to a mask (h, w) of
    an image (h, w, 3)."""
    colours, found = image.reshape(-1), mask.reshape(-1)
    b, g, r, rest = plane
    for k in range(len(found)):
        at = 3 * k
        value = b * np.float32(colours[at]) + g * np.float32(colours[at + 1])
        value += r * np.float32(colours[at + 2]) + rest
        found[k] = 255 if value > 0 else 0


@_compiled
def outside_by(mask, points):
    """(n,) how far points (n, 2) lie outside of the object of a mask (h, w, 1), px, negative
    within, between the centres of pixels; from these it is to the nearest one of the other kind,
    less half a pixel. Beyond the picture there is nothing of the object."""
    height, width = mask.shape[:2]
    found = np.empty(len(points))
    for i in range(len(points)):
        x = min(max(points[i, 0], 0.0), width - 1.001)
        y = min(max(points[i, 1], 0.0), height - 1.001)
        column, row = int(x), int(y)
        left = _to_other_kind(mask, row, column)
        right = _to_other_kind(mask, row, column + 1)
        below = _to_other_kind(mask, row + 1, column)
        beside = _to_other_kind(mask, row + 1, column + 1)
        top, low = left + (x - column) * (right - left), below + (x - column) * (beside - below)
        found[i] = top + (y - row) * (low - top)
    return found


@_compiled
def _to_other_kind(mask, row, column):
    """The same of the centre of a pixel: square by square around it."""
    height, width = mask.shape[:2]
    inside = mask[row, column, 0] > 127
    nearest, reach = np.inf, 0
    while reach + 1 < nearest and reach < max(height, width):
        reach += 1
        for off in range(-reach, reach + 1):
            for down, right in ((-reach, off), (reach, off), (off, -reach), (off, reach)):
                y, x = row + down, column + right
                there = 0 <= y < height and 0 <= x < width and mask[y, x, 0] > 127
                if there != inside:
                    nearest = min(nearest, np.sqrt(float(reach * reach + off * off)))
    return 0.5 - nearest if inside else nearest - 0.5
