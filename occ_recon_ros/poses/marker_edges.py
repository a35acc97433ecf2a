"""The printed sides of markers: their blur, and corners where two sides meet.

A corner detector sees the corner of a black square pulled inwards by the blur, by a part of its
width. The sides are straight; where two of them cross is not moved. A side is found by fitting

    I = (1 + g t) (black + (white - black) (1 + erf(z)) / 2),  z = (s - a - b t) q,

to the pixels around it, s px outwards and t along it: where their noise is even and independent,
no estimate is better.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from occ_recon_ros.geometry.arrays import Array, sampled

_ALONG = np.linspace(0.12, 0.88, 16)  # places along a side, away from its ends
_STEPS = 25
_MOST_PX = 5.0
_OF_A_CELL = 0.8  # of the black rim, beyond which the code begins
_LEAST_PX = 1.2  # a narrower rim has no edge of its own
_LEAST_CONTRAST = 20.0  # grey levels
_FARTHEST_PX = 3.0  # that a corner may move
_PLACES = np.linspace(0.1, 0.9, 24)  # along a side, where its pixels are
_PIXELS = 11  # across it at each place
_BORDER_PX = 1.6  # by which the blur of the code comes nearer
_CUT = 2.5  # times as far off as usual: a place that something covers, and a side that is no worse
_EVEN = 0.02  # of the contrast: no print is closer to what is fitted
_FEWEST = 8  # places that make a line
_BLUR_PX = 1.0  # 1 sigma, to begin with
_ITERATIONS, _STILL_PX = 8, 0.005  # Gauss-Newton, until most sides move by less
_DAMPING = 1e-3  # of the diagonal
_STEP_PX, _STEP_SHARPER = 1.0, 0.3  # longest step of a side; of q, 1/px


def _sides(quads: Array, cells: int) -> tuple[Array, Array, Array]:
    """The sides of markers, from each corner to the next: their runs (m, 4, 2) px, their lengths
    (m, 4, 1) px, and (m, 4) px to each side of them where nothing but their edge is."""
    along = np.roll(quads, -1, axis=1) - quads
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
    arm = quads.mean(axis=1, keepdims=True) - quads
    # The marker as deep as it is seen across this side.
    depth = 2 * np.abs(along[..., 0] * arm[..., 1] - along[..., 1] * arm[..., 0]) / length
    return along, length[..., None], np.minimum(_MOST_PX, _OF_A_CELL * depth / cells)


def _outward(along: Array, length: Array) -> Array:
    """(..., 2) unit normals of runs (..., 2) of such lengths (..., 1)."""
    normal: Array = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length
    return normal


def edge_blur(grey: NDArray, quads: Array, cells: int) -> float:
    """How blurred the sides are, 1 sigma of the blur in pixels; NaN where none can be seen.

    An edge blurred by a Gaussian of width s has a largest slope of its contrast over
    s sqrt(2 pi). Of the two directions of the sides the worse one counts: that is what a moving
    camera smears.
    """
    if not len(quads):
        return float("nan")
    along, length, half = _sides(quads, cells)
    steps = half[..., None] * np.linspace(-1, 1, _STEPS)
    places = quads[:, :, None] + _ALONG[:, None] * along[:, :, None]
    out = _outward(along, length)[:, :, None, None]
    at = places[..., None, :] + steps[:, :, None, :, None] * out
    profiles = sampled(grey, at[..., 0], at[..., 1])
    slope = np.diff(profiles, axis=3).max(axis=3) / np.diff(steps, axis=2)[:, :, :1]
    contrast = profiles.max(axis=3) - profiles.min(axis=3)
    good = (contrast > _LEAST_CONTRAST) & (slope > 0)
    width = contrast / np.where(good, slope, np.nan) / np.sqrt(2 * np.pi)
    results = [width[:, k::2][good[:, k::2]] for k in (0, 1)]
    return max((float(np.median(w)) for w in results if len(w)), default=float("nan"))


def side_corners(grey: NDArray, quads: Array, cells: int) -> Array:
    """Corners of markers where lines fitted to their sides cross.

    Args:
        grey: (h, w) uint8.
        quads: (m, 4, 2) float64, corners of the markers, pixels, clockwise from top left, good to
            a pixel or two.
        cells: cells along a side, the black rim among them.

    Returns:
        (m, 4, 2) float64, pixels; NaN where a side cannot be fitted (covered, too small).
    """
    if not len(quads):
        return quads.copy()
    first, last = _Sides(grey, quads, cells).ends()
    # Each line: normal . x = distance.
    run = last - first
    normal = np.stack([run[..., 1], -run[..., 0]], axis=2)
    distance = np.einsum("mkd,mkd->mk", normal, first)
    before, far = np.roll(normal, 1, axis=1), np.roll(distance, 1, axis=1)
    det = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = np.stack(
            [
                (far * normal[..., 1] - distance * before[..., 1]) / det,
                (before[..., 0] * distance - normal[..., 0] * far) / det,
            ],
            axis=2,
        )
        moved = np.linalg.norm(corners - quads, axis=2)
        corners[~(moved < _FARTHEST_PX)] = np.nan
    return corners


class _Sides:
    """The pixels around the sides of markers, as they are: values between them would move an edge,
    by where it is between two rows of pixels."""

    def __init__(self, grey: NDArray, quads: Array, cells: int) -> None:
        along, length, half = _sides(quads, cells)
        self._start, self._along = quads.reshape(-1, 2), along.reshape(-1, 2)
        length, self._half = length.reshape(-1, 1), half.reshape(-1, 1, 1)
        self._outward, half = _outward(self._along, length), self._half
        steps = half * np.linspace(-1, 1, _PIXELS)
        at = self._start[:, None] + _PLACES[:, None] * self._along[:, None]
        pixel = np.rint(at[:, :, None] + steps[..., None] * self._outward[:, None, None])
        u, v = np.moveaxis(pixel.astype(np.intp), 3, 0)
        height, width = grey.shape
        seen = grey[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
        off = pixel - self._start[:, None, None]
        out = np.einsum("npid,nd->npi", off, self._outward)
        along = np.einsum("npid,nd->npi", off, self._along / length**2) - 0.5
        self._seen, self._s, self._t = (x.astype(np.float32) for x in (seen, out, along))
        self._rim = out > -np.maximum(half / _OF_A_CELL - _BORDER_PX, _LEAST_PX)

    def ends(self) -> tuple[Array, Array]:
        """(m, 4, 2) px each: where the sides begin and end; NaN where one cannot be fitted."""
        line, good = self._fit()
        line[~(good & (self._half.ravel() > _LEAST_PX))] = np.nan
        before, after = line[:, :1] - line[:, 1:] / 2, line[:, :1] + line[:, 1:] / 2
        first = self._start + before * self._outward
        last = self._start + self._along + after * self._outward
        return first.reshape(-1, 4, 2), last.reshape(-1, 4, 2)

    def _fit(self) -> tuple[Array, NDArray[np.bool_]]:
        """(n, 2) a, px outwards in the middle of a side, and b, by how much more at its end than at
        its start; (n,) whether there is an edge."""
        seen, n = self._seen, len(self._seen)
        # Of white, black, a, b, q, g.
        found = np.zeros((n, 6, 1, 1), np.float32)
        found[:, 0, 0, 0] = np.median(seen[:, :, -1], axis=1)
        found[:, 1, 0, 0] = np.median(seen[:, :, 0], axis=1)
        found[:, 4] = 1 / (np.sqrt(2) * _BLUR_PX)
        most = np.array([np.inf, np.inf, _STEP_PX, _STEP_PX, _STEP_SHARPER, np.inf], np.float32)
        J = np.empty((n, 6, *seen.shape[1:]), np.float32)
        for _ in range(_ITERATIONS):
            white, black, a, b, q, g = np.moveaxis(found, 1, 0)
            out = self._s - a - b * self._t
            z = q * out
            J[:, 0] = 0.5 * (1 + erf(z))
            J[:, 1] = 1 - J[:, 0]
            light = white * J[:, 0] + black * J[:, 1]
            slope = np.exp(-z * z) * ((white - black) / np.sqrt(np.pi))
            J[:, 2] = -q * slope
            J[:, 3] = J[:, 2] * self._t
            J[:, 4] = slope * out
            J[:, 5] = light * self._t
            rest = seen - light - g * J[:, 5]
            contrast = (white - black)[:, 0, 0]
            there = self._there(rest, contrast)
            weighted = (J * (there[..., None] & self._rim)[:, None]).reshape(n, 6, -1)
            A = weighted @ J.reshape(n, 6, -1).transpose(0, 2, 1)
            diagonal = np.einsum("nkk->nk", A)
            diagonal += _DAMPING * diagonal + 1e-6
            step = np.linalg.solve(A, weighted @ rest.reshape(n, -1, 1))[..., 0]
            found += np.clip(step, -most, most)[..., None, None]
            if np.median(np.abs(step[:, 2:4]).max(axis=1)) < _STILL_PX:
                break
        good = (there.sum(axis=1) >= _FEWEST) & (contrast > _LEAST_CONTRAST)
        return found[:, 2:4, 0, 0].astype(np.float64), good

    def _there(self, rest: NDArray, contrast: NDArray) -> NDArray[np.bool_]:
        """(n, places) where the pixels are no farther off than usual on this side, and that no
        farther than usual on all sides."""
        off = np.sqrt(np.mean(rest**2, axis=2, where=self._rim))
        off /= np.maximum(contrast, 1.0)[:, None]
        usual = max(float(np.median(off)), _EVEN)
        limit = _CUT * np.clip(np.median(off, axis=1), usual, _CUT * usual)
        return np.asarray(off <= limit[:, None])
