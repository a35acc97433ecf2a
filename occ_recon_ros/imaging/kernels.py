"""The hot loops of outlines, compiled: as ``geometry.kernels``."""

import numpy as np
from numba import njit

_compiled = njit(cache=True, nogil=True, error_model="numpy")

_ZERO, _HALF, _ONE, _LEAST_POWER = np.array([0, 0.5, 1, 1e-6], np.float32)
_ERF_P = np.float32(0.47047 * np.sqrt(0.5))
_ERF_1, _ERF_2, _ERF_3 = np.array([0.3480242, -0.0958798, 0.7478556], np.float32)
_LOG2_E, _LN_2 = np.float32(np.log2(np.e)), np.float32(np.log(2))
_C2, _C3, _C4, _C5, _C6 = np.array([1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720], np.float32)
_FEW = 1e-3  # of trust
_GAUSS = np.sqrt(2 / np.pi)
_SHARE = 41  # samples that share their blur and their noise
_SHARPEST, _MOST_BLURRED = 0.3, 3.5  # sigmas, px
_QUANTISATION = 1.0  # grey levels
_LEAST_EXPONENT = np.float32(-87)


@_compiled
def running_mean(values, width):
    """As ``curves.along``, of values (n, k) over an odd number of samples, n or fewer."""
    n, columns = values.shape
    found, total = np.empty((n, columns)), np.zeros(columns)
    old, new = n - width // 2, width // 2
    for i in range(old, old + width):
        for c in range(columns):
            total[c] += values[i % n, c]
    for i in range(n):
        new = new + 1 if new + 1 < n else 0
        old = old if old < n else 0
        for c in range(columns):
            found[i, c] = total[c] / width
            total[c] += values[new, c] - values[old, c]
        old += 1
    return found


@_compiled
def largest(values, width):
    """As ``curves.largest``."""
    n, found = len(values), values.copy()
    for off in range(-(width // 2), width - width // 2):
        start = off % n
        for i in range(n - start):
            found[i] = max(found[i], values[i + start])
        for i in range(n - start, n):
            found[i] = max(found[i], values[i + start - n])
    return found


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
def off_curve(points, curve, reach):
    """(n,) how far points lie outside of those of a curve (n, 2), along their normals."""
    out = normals(curve, reach)
    off = np.empty(len(points))
    for i in range(len(points)):
        off[i] = (points[i, 0] - curve[i, 0]) * out[i, 0]
        off[i] += (points[i, 1] - curve[i, 1]) * out[i, 1]
    return off


@_compiled
def scatter(off, weight, kept, width, limit, lags):
    """How edges scatter about a curve that was fitted to them.

    Args:
        off: (n,) how far they lie off it, px.
        weight: (n,) theirs.
        kept: (n,) share of their variance that the fit left.
        width: samples that share their noise.
        limit: px, where trust in one of weight 1 ends.
        lags: up to how many samples apart they err alike.

    Returns:
        (n,) variance of one of weight 1, and the sum over the lags of their correlation.
    """
    n = len(off)
    sums, scattered, square, trusted, power = np.empty((n, 2)), np.empty(n), 0.0, 0.0, 0.0
    for i in range(n):
        at = off[i] * np.sqrt(weight[i])
        trust = max(1 - (at / limit) ** 2, 0.0) ** 2 if weight[i] > 0 else 0.0
        scattered[i] = trust * at
        sums[i, 0], sums[i, 1] = trust * at**2 / kept[i], trust
        square, trusted = square + sums[i, 0], trusted + trust
        power += scattered[i] ** 2
    # Where hardly an edge is near, the whole loop tells of the noise.
    whole = max(square, 1e-12) / max(trusted, 1e-3)
    sums = running_mean(sums, min(width | 1, (n - 1) | 1))
    variance = np.empty(n)
    for i in range(n):
        trimmed = max((sums[i, 0] + _FEW * whole) / (sums[i, 1] + _FEW), 1e-12)
        # That of a normal distribution from its mean square weighted by the trust.
        variance[i] = trimmed
        for _ in range(3):
            q = min(variance[i] / limit**2, 0.1)
            variance[i] = trimmed * (1 - 2 * q + 3 * q**2) / (1 - 6 * q + 15 * q**2)
    alike = 0.0
    for i in range(n):
        for lag in range(1, lags + 1):
            alike += scattered[i] * scattered[(i + lag) % n]
    return variance, alike / max(power, 1e-12)


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
def smoothed(points, weight, k, pad, times):
    """As ``smooth.smooth_closed``: the loop (n, d) is gone on with for ``pad`` samples at both
    ends, and the banded system solved as L D L^T.

    Stiff as it may be, entries of 1e12 beside weights of 1, what is left over is solved for once
    more, ``times`` in all; third differences tell it without loss of digits.
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
    found, left, mean = np.empty((rows, d)), np.empty((rows, d)), np.zeros(d)
    for i in range(n):
        for c in range(d):
            mean[c] += points[i, c] / n
    for i in range(rows):
        for c in range(d):
            found[i, c] = mean[c]
    for turn in range(times):
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
        for i in range(rows):
            for c in range(d):
                found[i, c] += left[i, c]
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


@_compiled
def edge_step(u, values, x, blur, half):
    """One Gauss-Newton step of ``subpixel.find_edges``.

    Args:
        u: (m,) float32, px.
        values: (n, m) float32.
        x, blur: (n,) px, position and blur of the edge; written.
        half: (n,) half-contrast; written where it is NaN.

    Returns:
        (n,) sigma of the position, px.
    """
    n = len(values)
    even_power, even_rest, odd_power, odd_rest, rest_power, spread = _step_sums(
        u, values, x, blur, half
    )
    shared, sigma = np.empty((n, 3)), np.empty(n)
    for i in range(n):
        sharpness = half[i] * _GAUSS / blur[i]
        shared[i, 0], shared[i, 1] = sharpness * odd_rest[i], sharpness**2 * odd_power[i]
        shared[i, 2] = rest_power[i]
    shared = running_mean(shared, min(_SHARE, (n - 1) | 1))
    for i in range(n):
        sharpness, even = half[i] * _GAUSS / blur[i], max(even_power[i], 1e-6)
        variance = max(shared[i, 2], 0.0) + _QUANTISATION**2 / 12
        sigma[i] = np.sqrt(variance * spread[i]) / max(abs(sharpness) * even, 1e-6)
        move = -even_rest[i] / even / (sharpness if abs(sharpness) > 1e-3 else 1e-3)
        x[i] = min(max(x[i] + min(max(move, -1.0), 1.0), u[0]), u[-1])
        pull = shared[i, 0] / max(shared[i, 1], 1e-9)
        blur[i] = min(max(blur[i] - min(max(pull, -0.6), 0.6), _SHARPEST), _MOST_BLURRED)
    return sigma


@_compiled
def steepest(u, values, near):
    """(n,) the middle, px, of the steepest part of profiles (n, m) at u (m,): their rises, the mean
    of five neighbours', count by their cubes times the weights near (m,)."""
    n, m = values.shape
    found, rises = np.empty(n), np.empty(m)
    for i in range(n):
        rises[:] = 0.0
        for row in range(i - 2, i + 3):
            at = row % n
            for j in range(1, m - 1):
                rises[j] += values[at, j + 1] - values[at, j - 1]
        total, moment = 0.0, 0.0
        for j in range(1, m - 1):
            power = max(rises[j] / 5, 0.0) ** 3 * near[j]
            total, moment = total + power, moment + power * u[j]
        found[i] = moment / total if total > 0 else 0.0
    return found


@_compiled
def _step_sums(u, values, x, blur, half):
    """What a step is made of, of each profile; arguments as of ``edge_step``.

    erf(z / sqrt 2) is taken to 2.5e-5, given exp(-z^2 / 2): M. Abramowitz and I. Stegun, Handbook
    of Mathematical Functions, 1964, formula 7.1.25.

    Returns:
        (6, n) float32, means under the taper: square of the even part, that times the residual,
        the same two of the odd part, square of the residual; sum of the squares of taper and even.
    """
    n, m = values.shape
    found = np.empty((6, n), np.float32)
    taper, even, odd = np.empty(m, np.float32), np.empty(m, np.float32), np.empty(m, np.float32)
    step, value = np.empty(m, np.float32), np.empty(m, np.float32)
    for i in range(n):
        here, per_blur = np.float32(x[i]), np.float32(1 / blur[i])
        per_taper = np.float32(1 / (1 + 1.5 * blur[i]))
        for j in range(m):
            z = (u[j] - here) * per_taper
            taper[j] = _exp(-_HALF * z * z)
        for j in range(m):
            z = (u[j] - here) * per_blur
            even[j] = _exp(-_HALF * z * z)
            odd[j] = z * even[j]
            t = _ONE / (_ONE + _ERF_P * abs(z))
            rest = _ONE - t * (_ERF_1 + t * (_ERF_2 + t * _ERF_3)) * even[j]
            step[j] = rest if z >= 0 else -rest
        total = mean_step = mean_even = mean_value = _ZERO
        for j in range(m):
            total += taper[j]
            mean_step += taper[j] * step[j]
            mean_even += taper[j] * even[j]
            mean_value += taper[j] * values[i, j]
        power = with_value = with_odd = _ZERO
        for j in range(m):
            taper[j] /= total
            step[j] -= mean_step / total
            even[j] -= mean_even / total
            value[j] = values[i, j] - mean_value / total
            power += taper[j] * step[j] * step[j]
            with_value += taper[j] * step[j] * value[j]
            with_odd += taper[j] * step[j] * odd[j]
        power = max(power, _LEAST_POWER)
        if np.isnan(half[i]):
            half[i] = with_value / power
        contrast = np.float32(half[i])
        # Position lives on the even part of the residual, blur on the odd one, so that each
        # step solves for one alone.
        even_power = even_rest = odd_power = odd_rest = rest_power = spread = _ZERO
        for j in range(m):
            rest = value[j] - contrast * step[j]
            apart = odd[j] - step[j] * (with_odd / power)
            even_power += taper[j] * even[j] * even[j]
            even_rest += taper[j] * even[j] * rest
            odd_power += taper[j] * apart * apart
            odd_rest += taper[j] * apart * rest
            rest_power += taper[j] * rest * rest
            spread += taper[j] * even[j] * taper[j] * even[j]
        found[0, i], found[1, i], found[2, i] = even_power, even_rest, odd_power
        found[3, i], found[4, i], found[5, i] = odd_rest, rest_power, spread
    return found


@_compiled
def _exp(x):
    """exp of x <= 0, float32, without a branch, so that several are computed at once."""
    x = max(x, _LEAST_EXPONENT)
    twos = np.floor(x * _LOG2_E + _HALF)
    f = x - twos * _LN_2
    part = _ONE + f * (_ONE + f * (_C2 + f * (_C3 + f * (_C4 + f * (_C5 + f * _C6)))))
    bits = np.int32((np.int32(twos) + np.int32(127)) << np.int32(23))
    return part * bits.view(np.float32)
