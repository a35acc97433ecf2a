"""The hot loops, compiled: point by point what took some thousand steps over small arrays.

What each loop means stands with the function that calls it; the tests hold the loops against
closed forms and against slower ones in NumPy.

Compiled once on a machine and kept beside this file (or in the user's cache). The loops let go
of Python's lock: other callbacks of a node go on.
"""

import numpy as np
from numba import njit

from .outline_map import FARTHEST, FIRST_ROW, WALKS
from .quadric import SAME

LEAST_COS = 0.1  # of normal and plane, where the outline is taken to cross the planes
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


@_compiled
def crossed_candidates(phi, sample, way, here, there, along, baseline):
    """The epipolar candidates of samples, and where their rays cross.

    Between two samples the outline bulges from the chord towards its normals, and the chord is
    itself bent in (phi, alpha): rays are followed to second order in the step. In the triangle of
    the baseline b and both rays d_i = b sin alpha_i / sin(alpha_i - alpha), and with cos b_i =
    |N.n| and T_i.N_i = sign(N.n) sin(alpha_i - alpha) the paper's a_i is
    (N.n) tan(alpha_i - alpha).

    Args:
        phi: (k,) of the samples that are asked for, ascending.
        sample: (k,) their rows.
        way: (n,) of all samples.
        here: cos, sin, N_n, N_v (n,) of their PencilView.
        there: phi, alpha, cos, sin, N_n, N_v (m,) of the other.
        along: the other contours' next_row, linked and turning (m,).
        baseline: metres.

    Returns:
        sample, row (c,), and (9, c): fraction, cos and sin of alpha, d, a, sin, cos_b, d_other,
        turned.
    """
    start, alpha, cos_there, sin_there, N_n_there, N_v_there = there
    cos_here, sin_here, N_n_here, N_v_here = here
    next_row, linked, turning = along
    m, k = len(start), len(phi)
    low, high = np.zeros(m, np.intp), np.zeros(m, np.intp)
    place = np.zeros(len(way) + 1, np.intp)
    at = 0
    for row in range(m):
        one, two = start[row], start[next_row[row]]
        if not linked[row] or one == two or not abs(two - one) < np.pi:
            continue
        # A segment owns its lower end and not its upper one. The next one is near.
        while at > 0 and phi[at - 1] >= min(one, two):
            at -= 1
        while at < k and phi[at] < min(one, two):
            at += 1
        low[row] = at
        while at < k and phi[at] < max(one, two):
            if way[sample[at]] == np.sign(two - one):
                place[sample[at] + 1] += 1
            at += 1
        high[row] = at
    total = 0
    for s in range(len(place)):
        total += place[s]
        place[s] = total

    of_sample, of_row = np.empty(total, np.intp), np.empty(total, np.intp)
    found = np.empty((9, total))
    for row in range(m):
        if low[row] == high[row]:
            continue
        after = next_row[row]
        step = start[after] - start[row]
        # The chord from this row to the next, and how far the outline bulges from it.
        bent = 0.5 * (alpha[after] - alpha[row]) ** 2
        cos, sin = (cos_there[row] + cos_there[after]) / 2, (sin_there[row] + sin_there[after]) / 2
        N_n = (N_n_there[row] + N_n_there[after]) / 2
        N_n = np.copysign(max(abs(N_n), LEAST_COS), N_n)
        bulge = 0.5 * (turning[row] / N_n - cos * (step**2 * sin + 4 * bent / sin))
        cos_bulge, sin_bulge = cos * bent - sin * bulge, sin * bent + cos * bulge
        for at in range(low[row], high[row]):
            s = sample[at]
            if way[s] != np.sign(step):
                continue
            c = place[s]
            place[s] += 1
            f = (phi[at] - start[row]) / step
            cos_i = cos_there[row] + f * (cos_there[after] - cos_there[row] + (1 - f) * cos_bulge)
            sin_i = sin_there[row] + f * (sin_there[after] - sin_there[row] + (1 - f) * sin_bulge)
            N_n_i = N_n_there[row] + f * (N_n_there[after] - N_n_there[row])
            N_v_i = N_v_there[row] + f * (N_v_there[after] - N_v_there[row])
            sin_apart = sin_i * cos_here[s] - cos_i * sin_here[s]
            cos_apart = cos_i * cos_here[s] + sin_i * sin_here[s]
            turn = N_n_here[s] * N_n_i * cos_apart + N_v_here[s] * N_v_i
            of_sample[c], of_row[c] = s, row
            found[0, c], found[1, c], found[2, c] = f, cos_i, sin_i
            found[3, c] = baseline / sin_apart * sin_i
            found[4, c] = N_n_here[s] * sin_apart / abs(cos_apart)
            found[5, c] = np.copysign(sin_apart, N_n_here[s] * sin_apart)
            found[6, c] = abs(N_n_here[s])
            found[7, c] = baseline / sin_apart * sin_here[s]
            turned = np.arccos(min(max(turn, -1.0), 1.0)) - np.arcsin(min(abs(sin_apart), 1.0))
            found[8, c] = max(turned, 0.0)
    return of_sample, of_row, found


@_compiled
def cheapest_pairs(before, after, variance, limits, least_cost, pair):
    """The cheapest pair of candidates of each sample, of those that are possible.

    Args:
        before, after: of each partner the entries of usable candidates (k,), their samples (k,);
            of all candidates d, a, sin, cos_b, d_other, turned and the variance of its contour.
        variance: (n,) of the samples' own contours.
        limits: least and most q, the radius that costs, the turn that costs, sigmas believed.
        least_cost: (n,) inf; written where a pair is possible.
        pair: (2, n) entries in both partners; written there.
    """
    one, of_one, d_one, a_one, sin_one, cos_b_one, other_one, turned_one, variance_one = before
    two, of_two, d_two, a_two, sin_two, cos_b_two, other_two, turned_two, variance_two = after
    least, most, size, scale, believed = limits
    first = 0
    for at in range(len(one)):
        s, i = of_one[at], one[at]
        while first < len(two) and of_two[first] < s:
            first += 1
        cos = np.sqrt(1 - sin_one[i] ** 2)
        own_i, their_i = d_one[i] * cos, other_one[i]
        own_i, their_i = own_i / (cos_b_one[i] * sin_one[i]), their_i / (cos_b_one[i] * sin_one[i])
        k = first
        while k < len(two) and of_two[k] == s:
            j = two[k]
            k += 1
            gap, slope = d_one[i] - d_two[j], a_two[j] - a_one[i]
            q = gap / slope
            left = gap - slope * min(max(q, least), most)
            lever = cos_b_two[j] * sin_two[j]
            own_j = d_two[j] * np.sqrt(1 - sin_two[j] ** 2) / lever
            doubt = (own_i - own_j) ** 2 * variance[s] + their_i**2 * variance_one[i]
            doubt += (other_two[j] / lever) ** 2 * variance_two[j]
            if left**2 > believed**2 * doubt:
                continue
            cost = (turned_one[i] / scale) ** 2 + (turned_two[j] / scale) ** 2
            if abs(slope) > SAME * (abs(a_one[i]) + abs(a_two[j])):
                # On a rim that is seen, k_t is not negative: the surface would hide it.
                cost += np.log1p(((8 * q if q < 0 else 2 * q) / size) ** 2)
            if cost < least_cost[s]:
                pair[0, s], pair[1, s], least_cost[s] = i, j, cost


@_compiled
def propagated(before, after, q, sigma, pose, found):
    """As ``belief.propagated``, of which see the arguments. Where they are finite, ``found``
    (5, n) gets the variances of depth and q, their covariance, the variance of the depth by
    poses, and the gain."""
    d0, a0, sin0, cos_b0, d_other0 = before
    d1, a1, sin1, cos_b1, d_other1 = after
    own, one, two = sigma
    for k in range(len(q)):
        # By how much d_i + a_i q moves for an error across the own contour, and the partner's.
        cos = np.sqrt(1 - sin0[k] ** 2)
        slope = q[k] / cos**2
        own0 = d0[k] * cos / (cos_b0[k] * sin0[k]) - slope
        their0 = slope - d_other0[k] / (cos_b0[k] * sin0[k])
        cos = np.sqrt(1 - sin1[k] ** 2)
        slope = q[k] / cos**2
        own1 = d1[k] * cos / (cos_b1[k] * sin1[k]) - slope
        their1 = slope - d_other1[k] / (cos_b1[k] * sin1[k])
        # q = (d_-1 - d_1) / (a_1 - a_-1), and depth = part d_-1 + (1 - part) d_1.
        per_gap = 1 / (a1[k] - a0[k])
        part = a1[k] * per_gap
        x0, x1, x2 = part * own0 + (1 - part) * own1, part * their0, (1 - part) * their1
        q0, q1, q2 = (own0 - own1) * per_gap, their0 * per_gap, -their1 * per_gap
        gain = np.sqrt(x0 * x0 + x1 * x1 + x2 * x2) * abs(sin0[k] / d0[k])
        if np.isfinite(gain):
            found[4, k] = gain
        by_pose = (x0 * pose) ** 2 + (x1 * pose) ** 2 + (x2 * pose) ** 2
        x0, x1, x2 = x0 * own[k], x1 * one[k], x2 * two[k]
        q0, q1, q2 = q0 * own[k], q1 * one[k], q2 * two[k]
        depth, bend = x0 * x0 + x1 * x1 + x2 * x2, q0 * q0 + q1 * q1 + q2 * q2
        if np.isfinite(depth) and np.isfinite(bend):
            found[0, k], found[1, k] = depth, bend
            found[2, k], found[3, k] = x0 * q0 + x1 * q1 + x2 * q2, by_pose


@_compiled
def nearest(sample, cos, sin, here, baseline, blur, depth, q, entries):
    """The candidate of each known point whose ray passes nearest to it.

    Args:
        sample, cos, sin: (c,) of the candidates, the samples ascending.
        here: alpha, cos, sin (n,) of the samples' PencilView.
        baseline: metres.
        blur: rad that a ray may pass by.
        depth, q: (n,) of the points.
        entries: (n,) of the candidates; written where there is one.
    """
    alpha, cos_here, sin_here = here
    c = 0
    while c < len(sample):
        s, best, least = sample[c], -1, np.inf
        x, y = depth[s] * cos_here[s] - baseline, depth[s] * sin_here[s]
        distance = np.sqrt(x * x + y * y)
        while c < len(sample) and sample[c] == s:
            miss = abs(sin[c] * x - cos[c] * y) / distance
            if miss < least:
                best, least = c, miss
            c += 1
        if best >= 0:
            turn = np.arctan2(sin[best], cos[best]) - alpha[s]
            if least <= blur + 2 * (turn**2 * abs(q[s]) / distance):
                entries[s] = best
