"""The compiled loops of ``OutlineMap``: see ``kernels`` for what all loops have in common."""

import numpy as np
from numba import njit

from .outline_map import FARTHEST, FIRST_ROW, NEAR, WALKS

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def outside(points, asked, arrays, found):
    """How far points (n, 3) are outside of each outline that is asked for, px: ``found`` (S, n),
    NaN before. The arrays are those of ``Silhouettes``."""
    for k in range(len(asked)):
        _raise_to(asked[k], points, arrays, np.inf, found[k])


@_compiled
def worst(points, asked, arrays, most, found):
    """Raise ``found`` (n,) to how far points (n, 3) are outside of the worst outline, px, or of
    the first by more than ``most``."""
    for s in asked:
        _raise_to(s, points, arrays, most, found)


@_compiled
def first_inside(centre, T, depth, asked, arrays, most):
    """As ``Silhouettes.first_inside``."""
    first, rays = np.full(len(T), -1), np.empty(len(T), np.intp)
    for c in range(len(depth)):
        count = 0
        for k in range(len(T)):
            if first[k] < 0 and depth[c, k] > 0:
                rays[count] = k
                count += 1
        points = np.empty((count, 3))
        for n in range(count):
            for axis in range(3):
                points[n, axis] = centre[axis] + depth[c, rays[n]] * T[rays[n], axis]
        found = np.full(count, -np.inf)
        worst(points, asked, arrays, most, found)
        for n in range(count):
            if not found[n] > most:
                first[rays[n]] = c
    return first


@_compiled
def _raise_to(s, points, arrays, most, found):
    """The same for one outline."""
    A, grid, begins, cells, place, loop = arrays
    cells = cells[begins[s, 0] : begins[s + 1, 0]]
    place, loop = place[begins[s, 1] : begins[s + 1, 1]], loop[begins[s, 1] : begins[s + 1, 1]]
    _raise_to_outline(points, A[s], grid[s], cells, place, loop, most, found)


@_compiled
def _raise_to_outline(points, A, grid, cells, place, loop, most, found):
    """The same from its own part of the arrays; NaN in ``found`` is not known yet."""
    rows, columns, step, unit = grid
    for p in range(len(points)):
        if found[p] > most:
            continue
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        z = A[2, 0] * X + A[2, 1] * Y + A[2, 2] * Z + A[2, 3]
        if not z > 0:
            continue
        x = (A[0, 0] * X + A[0, 1] * Y + A[0, 2] * Z + A[0, 3]) / z
        y = (A[1, 0] * X + A[1, 1] * Y + A[1, 2] * Z + A[1, 3]) / z
        # Points off the grid go to its edge.
        i, j = min(max(x, 0.0), rows - 1.0), min(max(y, 0.0), columns - 1.0)
        outside = float(cells[int(i) * int(columns) + int(j)])
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
                first, last = loop[row, 0], loop[row, 1]
                row += move
                while row < first:
                    row += last - first
                while row >= last:
                    row -= last - first
            row = before
            if abs(along) > step:
                dx, dy = x - place[row, 0], y - place[row, 1]
                side = dx * place[row, 5] + dy * place[row, 6]
                outside = np.copysign(np.hypot(outside, along), side)
        outside *= unit
        if outside > found[p] or np.isnan(found[p]):
            found[p] = outside


@_compiled
def on_plane(axes, T, N, next_row):
    """x, y where rays T (m, 3) meet the plane at distance 1 across the last of the axes, the
    normals N on it, made of length 1, and the length to the next sample: (5, m)."""
    found = np.empty((5, len(T)))
    for k in range(len(T)):
        z = axes[2, 0] * T[k, 0] + axes[2, 1] * T[k, 1] + axes[2, 2] * T[k, 2]
        z = z if z > 0 else np.nan
        for i in range(2):
            along = axes[i, 0] * T[k, 0] + axes[i, 1] * T[k, 1] + axes[i, 2] * T[k, 2]
            found[i, k] = along / z
            found[2 + i, k] = axes[i, 0] * N[k, 0] + axes[i, 1] * N[k, 1] + axes[i, 2] * N[k, 2]
        length = np.hypot(found[2, k], found[3, k])
        found[2, k], found[3, k] = found[2, k] / length, found[3, k] / length
    for k in range(len(T)):
        after = next_row[k]
        found[4, k] = np.hypot(found[0, after] - found[0, k], found[1, after] - found[1, k])
    return found


@_compiled
def placed(x, y, normal_x, normal_y, previous_row, next_row, linked, usual):
    """The places (m, 7) of an ``OutlineMap``; 0 where a sample alone has no normal."""
    place = np.zeros((len(x), 7))
    for k in range(len(x)):
        before, after = previous_row[k], next_row[k]
        to_x, to_y = x[after] - x[k], y[after] - y[k]
        from_x, from_y = x[k] - x[before], y[k] - y[before]
        ahead, behind = np.hypot(to_x, to_y), np.hypot(from_x, from_y)
        place[k, 0], place[k, 1] = x[k], y[k]
        if np.isfinite(normal_x[k]):
            place[k, 2], place[k, 3] = normal_x[k], normal_y[k]
        place[k, 4] = 1 / (ahead if linked[k] and ahead > 0 else usual)
        if ahead > 0 and behind > 0:
            place[k, 5] = -(to_y / ahead + from_y / behind)
            place[k, 6] = to_x / ahead + from_x / behind
    return place


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


@_compiled
def filled(x, y, next_row, linked, rows, columns):
    """The cells (rows x columns,) of an ``OutlineMap``."""
    blocked, sample = np.zeros((rows, columns), np.bool_), np.full(rows * columns, -1, np.int32)
    flips = np.zeros((rows, columns), np.bool_)
    for k in range(len(x)):
        i, j, dx, dy = int(x[k]), int(y[k]), x[next_row[k]] - x[k], y[next_row[k]] - y[k]
        blocked[i, j], sample[i * columns + j] = True, k
        if not linked[k]:  # the chord over a gap
            count = int(2 * np.hypot(dx, dy)) + 1
            for c in range(count):
                part = (c + 0.5) / count
                blocked[int(x[k] + part * dx), int(y[k] + part * dy)] = True
        # The middles of cells that loops enclose, by parity along each line.
        u, v = x[k] - 0.5, y[k] - 0.5
        for line in range(int(np.ceil(min(u, u + dx))), int(np.ceil(max(u, u + dx)))):
            crossing = int(np.ceil(v + (line - u) / dx * dy))
            flips[line, crossing] = not flips[line, crossing]

    distance, where = nearest_cells(blocked)
    cells = np.empty(rows * columns, np.float32)
    for i in range(rows):
        inside = False
        for j in range(columns):
            inside ^= flips[i, j]
            far, row = -distance[i, j] if inside else distance[i, j], sample[where[i, j]]
            # Inside, a cell without outline says all that is asked: not outside.
            if row >= 0 and -0.5 < far < NEAR:
                cells[i * columns + j] = FIRST_ROW + row
            else:
                cells[i * columns + j] = np.nan if row < 0 and far > 0 else far
    return cells
