"""The compiled loops of ``OutlineMap``: see ``kernels`` for what all loops have in common."""

import numpy as np
from numba import njit

from .outline_map import FARTHEST, FIRST_ROW, WALKS

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def raise_to_outline(
    points, rotation, shift, rows, columns, step, cells, place, ahead, unit, most, found
):
    """Raise ``found`` (n,) to how far points (n, 3) are outside of an outline, in units of so
    many to a cell, where it is not above ``most`` yet; NaN there is not known yet. The rest is
    of its ``OutlineMap``."""
    for p in range(len(points)):
        if found[p] > most:
            continue
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        z = rotation[2, 0] * X + rotation[2, 1] * Y + rotation[2, 2] * Z + shift[2]
        if not z > 0:
            continue
        x = (rotation[0, 0] * X + rotation[0, 1] * Y + rotation[0, 2] * Z + shift[0]) / z
        y = (rotation[1, 0] * X + rotation[1, 1] * Y + rotation[1, 2] * Z + shift[1]) / z
        # Points off the grid go to its edge.
        i, j = min(max(x, 0.0), rows - 1.0), min(max(y, 0.0), columns - 1.0)
        outside = float(cells[int(i) * columns + int(j)])
        if not outside >= FIRST_ROW:
            if x != i or y != j:
                outside += np.hypot(x - i, y - j)
        else:
            # From the sample that the cell names along the outline to the nearest.
            row = int(outside - FIRST_ROW)
            outside, along, before = 0.0, 0.0, row
            for walk in range(WALKS + 1):
                dx, dy = x - place[row, 0], y - place[row, 1]
                new_across = dx * place[row, 2] + dy * place[row, 3]
                new_along = dx * place[row, 3] - dy * place[row, 2]
                if walk and not new_across**2 + new_along**2 < outside**2 + along**2:
                    break
                outside, along, before = new_across, new_along, row
                move = int(np.rint(min(max(along * place[row, 4], -FARTHEST), FARTHEST)))
                if move == 0:
                    break
                row += ahead[row, move + FARTHEST]
            row = before
            if abs(along) > step:
                dx, dy = x - place[row, 0], y - place[row, 1]
                side = dx * place[row, 5] + dy * place[row, 6]
                outside = np.copysign(np.hypot(outside, along), side)
        outside *= unit
        if outside > found[p] or np.isnan(found[p]):
            found[p] = outside


@_compiled
def nearest_cells(blocked):
    """How far the nearest cell is, of those (rows, columns), some, that are blocked, and its flat
    index. First along columns, then along rows by the lower envelope of parabolas:
    P. Felzenszwalb and D. Huttenlocher, "Distance transforms of sampled functions", Theory of
    Computing 8, 2012, doi:10.4086/toc.2012.v008a019."""
    rows, columns = blocked.shape
    along = np.empty((rows, columns), np.intp)  # the row of the nearest in the same column
    for i in range(rows):
        for j in range(columns):
            if blocked[i, j]:
                along[i, j] = i
            else:
                along[i, j] = along[i - 1, j] if i else -1
    for i in range(rows - 2, -1, -1):
        for j in range(columns):
            below = along[i + 1, j]
            if below > i and (along[i, j] < 0 or below - i < i - along[i, j]):
                along[i, j] = below

    distance, found = np.empty((rows, columns)), np.empty((rows, columns), np.intp)
    lowest, start = np.empty(columns, np.intp), np.empty(columns)
    for i in range(rows):
        last = -1
        for j in range(columns):
            if along[i, j] < 0:
                continue
            height = (i - along[i, j]) ** 2 + j * j
            while last >= 0:
                k = lowest[last]
                crossing = (height - (i - along[i, k]) ** 2 - k * k) / (2.0 * (j - k))
                if crossing > start[last]:
                    break
                last -= 1
            last += 1
            lowest[last], start[last] = j, crossing if last else -np.inf
        k = 0
        for j in range(columns):
            while k < last and start[k + 1] < j:
                k += 1
            row, column = along[i, lowest[k]], lowest[k]
            found[i, j] = row * columns + column
            distance[i, j] = np.sqrt((i - row) ** 2 + (j - column) ** 2)
    return distance, found
