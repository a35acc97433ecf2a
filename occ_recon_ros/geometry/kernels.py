"""The hot loops, compiled: point by point what took some thousand steps over small arrays.

What each loop means stands with the function that calls it; the tests hold the loops against
closed forms and against slower ones in NumPy.

Compiled once on a machine and kept beside this file (or in the user's cache). The loops let go
of Python's lock: other callbacks of a node go on.
"""

import numpy as np
from numba import njit

from .quadric import SAME, TRIPLE
from .rim import Status

GOOD, DOUBLE = int(Status.GOOD), int(Status.DOUBLE)
ILL_CONDITIONED, MOTION_ALONG_RAY = int(Status.ILL_CONDITIONED), int(Status.MOTION_ALONG_RAY)
LEAST_COS = 0.1  # of normal and plane, where the outline is taken to cross the planes
_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def pencil_view(frame, T, N):
    """The five arrays of a ``PencilView``, (5, n), of the rays T and normals N (n, 3) in a frame
    of rows e, e1, e2."""
    found = np.empty((5, len(T)))
    for k in range(len(T)):
        cos, x, y = _turned(frame, T[k])
        along, N_x, N_y = _turned(frame, N[k])
        sin = np.sqrt(x * x + y * y)
        found[0, k], found[1, k], found[2, k] = np.arctan2(y, x), cos, sin
        found[3, k] = cos * (N_x * x + N_y * y) / sin - sin * along
        found[4, k] = (N_y * x - N_x * y) / sin
    return found


@_compiled
def tangent_planes(T, uv, before, after):
    """Outward normals (n, 3) and the angle of a pixel (n,), infinite where there is no tangent, of
    samples with rays T (n, 3) at pixels uv (n, 2), by the rows (n,) before and after each."""
    N, scale = np.zeros((len(T), 3)), np.full(len(T), np.inf)
    for k in range(len(T)):
        a, b = before[k], after[k]
        x, y, z = T[b, 0] - T[a, 0], T[b, 1] - T[a, 1], T[b, 2] - T[a, 2]
        # The object is on the left of the tangent as displayed, so outward is T x t.
        X = T[k, 1] * z - T[k, 2] * y
        Y = T[k, 2] * x - T[k, 0] * z
        Z = T[k, 0] * y - T[k, 1] * x
        length = np.sqrt(X * X + Y * Y + Z * Z)
        pixels = np.sqrt((uv[b, 0] - uv[a, 0]) ** 2 + (uv[b, 1] - uv[a, 1]) ** 2)
        if length != 0 and pixels != 0:
            N[k, 0], N[k, 1], N[k, 2] = X / length, Y / length, Z / length
            scale[k] = np.sqrt(x * x + y * y + z * z) / pixels
    return N, scale


@_compiled
def on_rays(centre, T, rows, depth):
    """(k, 3) points at depths (k,) along the rays of rows (k,), of (n, 3)."""
    points = np.empty((len(rows), 3))
    for k in range(len(rows)):
        for axis in range(3):
            points[k, axis] = centre[axis] + depth[k] * T[rows[k], axis]
    return points


@_compiled
def _turned(frame, v):
    """A vector in a frame."""
    x = frame[0, 0] * v[0] + frame[0, 1] * v[1] + frame[0, 2] * v[2]
    y = frame[1, 0] * v[0] + frame[1, 1] * v[1] + frame[1, 2] * v[2]
    return x, y, frame[2, 0] * v[0] + frame[2, 1] * v[1] + frame[2, 2] * v[2]


@_compiled
def crossed_candidates(samples, here, there, own, along, baseline):
    """The epipolar candidates of samples, and where their rays cross.

    Between two samples the outline bulges from the chord towards its normals, and the chord is
    itself bent in (phi, alpha): rays are followed to second order in the step. In the triangle of
    the baseline b and both rays d_i = b sin alpha_i / sin(alpha_i - alpha), and with cos b_i =
    |N.n| and T_i.N_i = sign(N.n) sin(alpha_i - alpha) the paper's a_i is
    (N.n) tan(alpha_i - alpha).

    Args:
        samples: (k,) rows of those that are asked for, by ascending phi.
        here, there: phi, cos, sin, N_n, N_v (n,) and (m,) of both ``PencilView``.
        own: the contours' previous_row, next_row and linked (n,).
        along: the other contours' next_row, linked and turning (m,).
        baseline: metres.

    Returns:
        sample, row (c,), and (9, c): fraction, cos and sin of alpha, d, a, sin, cos_b, d_other,
        turned.
    """
    phi_here, cos_here, sin_here, N_n_here, N_v_here = here
    start, cos_there, sin_there, N_n_there, N_v_there = there
    previous_row, own_next, own_linked = own
    next_row, linked, turning = along
    n, m, k = len(phi_here), len(start), len(samples)
    phi, way = np.empty(k), np.empty(n)  # which way phi runs along the contour
    for at in range(k):
        s = samples[at]
        before, after = previous_row[s], own_next[s]
        turn = phi_here[after if own_linked[s] else s]
        turn -= phi_here[before if own_linked[before] else s]
        phi[at], way[s] = phi_here[s], np.sign(-turn if abs(turn) > np.pi else turn)
    low, high = np.zeros(m, np.intp), np.zeros(m, np.intp)
    place = np.zeros(n + 1, np.intp)
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
            if way[samples[at]] == np.sign(two - one):
                place[samples[at] + 1] += 1
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
        turn = sin_there[after] * cos_there[row] - cos_there[after] * sin_there[row]
        bent = 0.5 * np.arcsin(turn) ** 2
        cos, sin = (cos_there[row] + cos_there[after]) / 2, (sin_there[row] + sin_there[after]) / 2
        N_n = (N_n_there[row] + N_n_there[after]) / 2
        N_n = np.copysign(max(abs(N_n), LEAST_COS), N_n)
        bulge = 0.5 * (turning[row] / N_n - cos * (step**2 * sin + 4 * bent / sin))
        cos_bulge, sin_bulge = cos * bent - sin * bulge, sin * bent + cos * bulge
        for at in range(low[row], high[row]):
            s = samples[at]
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
def turns(phi, starts, linked, parabola):
    """Where an angle (n,) turns back along loops: position, angle, and 1 (a maximum) or -1.

    Args:
        phi, linked: (n,) of the samples.
        starts: (loops + 1,) their loop_starts.
        parabola: (3, 2 reach + 1), which takes the angles about a sample, as far as they must
            run towards the turn and away, to the coefficients of their parabola.
    """
    found = np.empty((3, len(phi)))
    count, reach = 0, parabola.shape[1] // 2
    for loop in range(len(starts) - 1):
        first, n = starts[loop], starts[loop + 1] - starts[loop]
        last = -2  # where the last turn was found
        for k in range(n if n >= 4 * reach else 0):
            # Over a reach the angle has gone forth as far as back, nearly.
            slope = phi[first + (k + reach) % n] - phi[first + (k - reach) % n]
            next_ = phi[first + (k + 1 + reach) % n] - phi[first + (k + 1 - reach) % n]
            if not np.sign(slope) * np.sign(next_) <= 0:
                continue
            c0, c1, c2, way, whole = 0.0, 0.0, 0.0, 0.0, True
            for j in range(2 * reach + 1):
                row = first + (k + j - reach) % n
                c0 += parabola[0, j] * phi[row]
                c1 += parabola[1, j] * phi[row]
                c2 += parabola[2, j] * phi[row]
                whole &= linked[row]
                if j < 2 * reach:
                    step = phi[first + (k + 1 + j - reach) % n] - phi[row]
                    whole &= abs(step) < np.pi / 2
                    way += np.sign(step) if j >= reach else -np.sign(step)
            s = -c1 / (2 * c2)
            # The turn is at this sample, and the angle runs one way up to it and one way on.
            if not (whole and abs(s) <= 1 and way * np.sign(c2) >= 1.5 * reach):
                continue
            if last != k - 1:  # not found from both sides
                found[0, count] = first + (k + s) % n
                found[1, count], found[2, count] = c0 + c1 * s + c2 * s**2, -np.sign(c2)
                count += 1
            last = k
    return found[:, :count]


@_compiled
def cheapest_pairs(before, after, sigma, pose, limits, least_cost, pair):
    """The cheapest pair of candidates of each sample, of those that are possible.

    Args:
        before, after: of each partner the entries of usable candidates (k,); of all candidates
            the samples, d, a, sin, cos_b, d_other, turned and the sigma of its contour.
        sigma: (n,) of the samples' own contours, rad.
        pose: 1 sigma of a view's pose, rad.
        limits: least and most q, the radius that costs, the turn that costs, sigmas believed.
        least_cost: (n,) inf; written where a pair is possible.
        pair: (2, n) entries in both partners; written there.
    """
    one, of_one, d_one, a_one, sin_one, cos_b_one, other_one, turned_one, sigma_one = before
    two, of_two, d_two, a_two, sin_two, cos_b_two, other_two, turned_two, sigma_two = after
    least, most, size, scale, believed = limits
    first = 0
    for i in one:
        s = of_one[i]
        while first < len(two) and of_two[two[first]] < s:
            first += 1
        cos = np.sqrt(1 - sin_one[i] ** 2)
        own_i, their_i = d_one[i] * cos, other_one[i]
        own_i, their_i = own_i / (cos_b_one[i] * sin_one[i]), their_i / (cos_b_one[i] * sin_one[i])
        k = first
        while k < len(two) and of_two[two[k]] == s:
            j = two[k]
            k += 1
            gap, slope = d_one[i] - d_two[j], a_two[j] - a_one[i]
            q = gap / slope
            left = gap - slope * min(max(q, least), most)
            lever = cos_b_two[j] * sin_two[j]
            own_j = d_two[j] * np.sqrt(1 - sin_two[j] ** 2) / lever
            doubt = (own_i - own_j) ** 2 * (sigma[s] ** 2 + pose**2)
            doubt += their_i**2 * (sigma_one[i] ** 2 + pose**2)
            doubt += (other_two[j] / lever) ** 2 * (sigma_two[j] ** 2 + pose**2)
            if left**2 > believed**2 * doubt:
                continue
            cost = (turned_one[i] / scale) ** 2 + (turned_two[j] / scale) ** 2
            if abs(slope) > SAME * (abs(a_one[i]) + abs(a_two[j])):
                # On a rim that is seen, k_t is not negative: the surface would hide it.
                cost += np.log1p(((8 * q if q < 0 else 2 * q) / size) ** 2)
            if cost < least_cost[s]:
                pair[0, s], pair[1, s], least_cost[s] = i, j, cost


@_compiled
def solved(d0, a0, d1, a1, depth, curvature, status):
    """As ``quadric.solve``: depth, k_t and Status (n,) are written."""
    for k in range(len(d0)):
        apart, both = abs(a1[k] - a0[k]), abs(a0[k]) + abs(a1[k])
        zero0, zero1 = abs(a0[k]) < TRIPLE, abs(a1[k]) < TRIPLE
        depth[k] = curvature[k] = np.nan
        if not np.isfinite(d0[k] + d1[k] + a0[k] + a1[k]):
            status[k] = MOTION_ALONG_RAY
        elif zero0 and zero1:
            status[k], depth[k] = DOUBLE, (d0[k] + d1[k]) / 2
        elif apart <= SAME * both:
            status[k] = ILL_CONDITIONED
        else:
            status[k] = DOUBLE if zero0 or zero1 else GOOD
            depth[k] = (d0[k] * a1[k] - d1[k] * a0[k]) / (a1[k] - a0[k])
            curvature[k] = (a1[k] - a0[k]) / (2 * (d0[k] - d1[k]))
            if zero0:
                depth[k] = d0[k]
            elif zero1:
                depth[k] = d1[k]


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
        here: cos, sin (n,) of the samples' PencilView.
        baseline: metres.
        blur: rad that a ray may pass by.
        depth, q: (n,) of the points.
        entries: (n,) of the candidates; written where there is one.
    """
    cos_here, sin_here = here
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
            across = sin[best] * cos_here[s] - cos[best] * sin_here[s]
            turn = np.arctan2(across, cos[best] * cos_here[s] + sin[best] * sin_here[s])
            if least <= blur + 2 * (turn**2 * abs(q[s]) / distance):
                entries[s] = best


@_compiled
def projected(points, R, t, K, D, equidistant):
    """As ``Camera.project``, of points (n, 3); D (12,) holds zeros where the lens has fewer."""
    found = np.empty((len(points), 2))
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = D
    for i in range(len(points)):
        X, Y, Z = points[i]
        z = R[2, 0] * X + R[2, 1] * Y + R[2, 2] * Z + t[2]
        if not z > 0:
            found[i] = np.nan
            continue
        x = (R[0, 0] * X + R[0, 1] * Y + R[0, 2] * Z + t[0]) / z
        y = (R[1, 0] * X + R[1, 1] * Y + R[1, 2] * Z + t[1]) / z
        r2 = x * x + y * y
        if equidistant:
            r = np.sqrt(r2)
            theta = np.arctan(r)
            q = theta * theta
            scale = theta * (1 + q * (k1 + q * (k2 + q * (p1 + q * p2)))) / r if r > 1e-12 else 1.0
            x, y = x * scale, y * scale
        else:
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            radial /= 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
            dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
            dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
            x, y = x * radial + dx, y * radial + dy
        found[i, 0] = K[0, 0] * x + K[0, 1] * y + K[0, 2]
        found[i, 1] = K[1, 1] * y + K[1, 2]
    return found
