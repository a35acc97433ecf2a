"""Scattered edge points of one loop to a smooth outline with an honest sigma.

The smoother's cut-off rises with the curvature, so that tight bends keep their size, and
wherever a twice finer fit differs from the coarse one by more than the noise allows
(the idea of intersecting confidence intervals: A. Goldenshluger and A. Nemirovski, Math.
Methods of Statistics 6, 1997).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import median
from ..geometry.compiled import compiled
from .curves import along, curvature, largest, normals
from .smooth import NOISE_GAIN, smooth_closed, stiffness

Array = NDArray[np.floating]

_KEEP = 4.5  # f0 R that keeps a circle of radius R to R / 3000
_HIGHEST_CUTOFF = 1.5
_OUTLIER, _STRAY_PX = 4.0, 0.25
_NOISE_SHARE_PX = 60.0
_DOUBT = 2.7
_FLOOR_PX, _DETAIL_PX = 0.001, 0.003
_ROUNDS = 2
_WORTH_A_ROUND = 1.3
_USUAL_NOISE_PX = 0.188  # scatter of edges above which the fit starts out coarser
_COARSE, _COARSEST = 1.6, 16.0
_GROWTH = (
    1.5  # of the span with the noise: what is gained by averaging outweighs what is lost of waves
)
_LAGS = 2
# Variance of the mean of n neighbours a pixel apart, times n over their own: bilinear values share
# pixels; errors of interpolation change sign with the pixels.
_ALIKE, _GRID_ALIKE = 1.6, 0.7
_LEAST_ALIKE, _MOST_ALIKE = 0.7, 4.0
_PRIOR_SAMPLES = 150
_FREE = 1e-9
_START_PX = 3.0  # 1 sigma of the curve on which the search for edges begins


@dataclass(frozen=True)
class _Edges:
    """What is fitted: edge points (n, 2), px, their weights (n,), the curve that was searched
    (n, 2), px, and its weight, whether they lie inside of the image (n,), their distance, px,
    how far from the curve trust in one of weight 1 ends, px, and their error by interpolation
    between pixels, px."""

    points: Array
    weight: Array
    start: Array
    anchor: float
    inside: NDArray[np.bool_]
    spacing: float
    limit: float
    grid: float

    def trust(self, off: Array) -> Array:
        """(n,) Tukey's biweight: 1 on the curve, 0 from the limit on."""
        known = self.weight > 0
        return np.where(known, np.maximum(1 - (off / self.limit) ** 2, 0.0) ** 2, 0.0)

    def fitted(self, weight: Array, cutoff: Array) -> Array:
        """The curve by edges of some weight; where there are none, along the one searched."""
        return _solve(self.points, weight, cutoff, self.inside, self.start, self.anchor)


def fit_outline(
    measured: Array,
    sigma: Array,
    inside: NDArray[np.bool_],
    wave_px: float,
    spacing: float,
    grid_px: float = 0.0,
    start: Array | None = None,
) -> tuple[Array, Array]:
    """Smooth one closed loop of edge points.

    Args:
        measured: (n, 2) float64, edge points, px, about evenly spaced.
        sigma: (n,) float64, their sigma across the loop, px; infinite where there is no edge.
        inside: (n,) bool, False along the border of the image, where the loop is not the
            object's and must not bend it.
        wave_px: shortest wave kept on gently curved stretches, px.
        spacing: distance of the samples, px.
        grid_px: how much of their scatter comes from interpolation between pixels.
        start: (n, 2) float64, px, the curve across which edges were searched; the loop keeps to
            it where there are none. None: it bends as little as it can there.

    Returns:
        points: (n, 2) float64.
        sigma: (n,) float64, px, of the smoothed points across the loop; infinite where no edge
            is near enough to say more than the search did.
    """
    known = np.isfinite(sigma) & inside
    if not known.any():
        return measured if start is None else start, np.full(len(measured), np.inf)
    weight, anchor = _weights(sigma, known)
    if start is None:
        start, anchor = measured, _FREE
    base = 2 * np.pi / wave_px * spacing
    cutoff = _cutoff(measured, base, spacing)
    # Edges on something else stand off the curve; a second look leaves them out.
    points = _solve(
        measured, weight, np.minimum(2 * cutoff, _HIGHEST_CUTOFF), inside, start, anchor
    )
    off = _across(measured, points) * np.sqrt(weight)
    scale = np.hypot(1.4826 * median(np.abs(off[known])), _STRAY_PX)
    limit = float(_OUTLIER * scale)
    edges = _Edges(measured, weight, start, anchor, inside, spacing, limit, grid_px)
    trusted = weight * edges.trust(off)
    # Where edges scatter by more than is usual, short waves are noise until proven.
    coarser = float(np.clip((scale / _USUAL_NOISE_PX) ** _GROWTH, 1.0, _COARSEST))
    cutoff = _cutoff(points, base, spacing, coarser)
    if coarser > _COARSE:
        points = edges.fitted(trusted, cutoff)
        cutoff = _cutoff(points, base, spacing, coarser)
    points, cutoff, noise, stiff = _adapt(edges, trusted, cutoff)
    gain = NOISE_GAIN * cutoff
    reach = round(4 * np.pi / median(cutoff) / 3)
    share = along(trusted, reach)
    sigma = noise * np.sqrt(gain / np.maximum(share, 1e-6))
    sigma = np.hypot(sigma, stiff + _FLOOR_PX)
    return points, np.where(inside & (sigma < _START_PX), sigma, np.inf)


def quick_fit(
    measured: Array, sigma: Array, inside: NDArray[np.bool_], wave_px: float, spacing: float
) -> Array:
    """Smoothed points alone, by one solution; arguments as of ``fit_outline``."""
    known = np.isfinite(sigma) & inside
    if not known.any():
        return measured
    cutoff = _cutoff(measured, 2 * np.pi / wave_px * spacing, spacing)
    weight, anchor = _weights(sigma, known)
    return _solve(measured, weight, cutoff, inside, measured, anchor)


def _weights(sigma: Array, known: NDArray[np.bool_]) -> tuple[Array, float]:
    """(n,) inverse variances, 1 for the typical one; none counts more than ten. And that of
    the curve on which the search began."""
    typical = max(median(sigma[known]), 1e-3)
    weight = np.where(known, (typical / np.maximum(sigma, 0.3 * typical)) ** 2, 0.0)
    return weight, min((typical / _START_PX) ** 2, 1.0)


def _cutoff(points: Array, base: float, spacing: float, coarser: float = 1.0) -> Array:
    """Cut-off frequency, rad a sample, that keeps the bends of the curve.

    Coarser curves are seen over a stretch that is longer by that factor, and have a lower base,
    as far as the bends of the whole loop allow.
    """
    width = round(9 * coarser / spacing)
    bend = along(curvature(points, reach=max(2, round(4 * coarser / spacing))), width // 2)
    bend = _KEEP * spacing * np.abs(bend)
    base = float(np.clip(bend.mean(), base / coarser, base))
    cutoff = np.maximum(base, along(bend, width))
    return np.clip(along(cutoff, width), base, _HIGHEST_CUTOFF)


def _solve(
    measured: Array,
    weight: Array,
    cutoff: Array,
    inside: NDArray[np.bool_],
    start: Array,
    anchor: float,
) -> Array:
    """The smooth curve through edge points; where these count for less than the curve on which
    the search began, that takes their place by as much."""
    share = np.minimum(weight / anchor, 1.0)[:, None]
    stiff = np.where(inside, stiffness(cutoff), 0.0)
    return smooth_closed(start + share * (measured - start), np.maximum(weight, anchor), stiff)


def _unshrunk(points: Array, cutoff: Array, spacing: float) -> Array:
    """The curve with the pull of smoothing on its bends put back: k^5 / f0^6 inwards where the
    curvature is k."""
    bend = along(curvature(points, reach=max(2, round(4 / spacing))), round(9 / spacing))
    share = np.minimum(np.abs(bend) * (spacing / cutoff), 1 / _KEEP) ** 2
    shrunk = bend * (share * (spacing / cutoff)) ** 2
    return points + shrunk[:, None] * normals(points, reach=2)


def _across(a: Array, b: Array) -> Array:
    """(n,) how far a lies outside b, along b's normals."""
    off: Array = compiled("imaging.kernels").off_curve(a, b, 2)
    return off


def _adapt(edges: _Edges, trusted: Array, cutoff: Array) -> tuple[Array, Array, Array, Array]:
    """Fit, raising the cut-off where a finer fit departs from the coarse one for good
    reason.

    Returns:
        The points, the cut-off, the sigma (n,) of a measurement of weight 1, and how far
        (n,) a finer fit still departs for good reason, px.
    """
    spacing = edges.spacing
    points = _unshrunk(edges.fitted(trusted, cutoff), cutoff, spacing)
    for rounds in range(_ROUNDS + 1):
        fine_cutoff = np.minimum(2 * cutoff, _HIGHEST_CUTOFF)
        fine = edges.fitted(trusted, fine_cutoff)
        noise = _noise(edges, fine, fine_cutoff)
        allowed = noise * np.sqrt(NOISE_GAIN * (fine_cutoff - cutoff)) + _DETAIL_PX
        apart = _across(fine, points)
        gap = largest(np.abs(apart), max(3, round(6 / spacing)))
        factor = np.clip(gap / (_DOUBT * allowed), 1.0, 2.0)
        if factor.max() < _WORTH_A_ROUND or rounds == _ROUNDS:
            break
        cutoff = np.minimum(cutoff * along(factor, round(9 / spacing)), _HIGHEST_CUTOFF)
        points = _unshrunk(edges.fitted(trusted, cutoff), cutoff, spacing)
    noise = _noise(edges, points, cutoff)
    hidden = np.sqrt(max(float(np.mean((apart**2 - allowed**2)[trusted > 0])), 0.0))
    return points, cutoff, noise, np.maximum(gap - _DOUBT * allowed, hidden)


def _noise(edges: _Edges, fitted: Array, cutoff: Array) -> Array:
    """Sigma (n,) of a measurement of weight 1, grown for neighbours that err alike, from how
    far they lie off a curve (n, 2) that was fitted with a cut-off (n,)."""
    # The fit follows part of the noise, at low frequency all of it: what lacks in the
    # variance and in the sum of 2 _LAGS + 1 covariances.
    followed = (2 / 3 - NOISE_GAIN) * _ALIKE * cutoff
    power, alike = compiled("imaging.kernels").scatter(
        _across(edges.points, fitted),
        edges.weight,
        np.maximum(1 - followed, 0.3),
        round(_NOISE_SHARE_PX / edges.spacing),
        edges.limit,
        _LAGS,
    )
    typical = median(followed)
    left = max(0.3, 1 - (2 * _LAGS + 1) * typical / _ALIKE)
    seen = (1 + 2 * alike) * (1 - min(typical, 0.7)) / left
    n = len(fitted) * left**2
    grid_share = min(1.0, edges.grid**2 / median(power))
    expected = _ALIKE + grid_share * (_GRID_ALIKE - _ALIKE)
    factor = (n * seen + _PRIOR_SAMPLES * expected) / (n + _PRIOR_SAMPLES)
    return np.sqrt(power * np.clip(factor, _LEAST_ALIKE, _MOST_ALIKE))
