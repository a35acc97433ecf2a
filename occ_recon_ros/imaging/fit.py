"""Scattered edge points of one loop to a smooth outline with an honest sigma.

The smoother's cut-off rises with the curvature, so that tight bends keep their size, and
wherever a twice finer fit differs from the coarse one by more than the noise allows
(the idea of intersecting confidence intervals: A. Goldenshluger and A. Nemirovski, Math.
Methods of Statistics 6, 1997).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from .curves import along, curvature, normals, shifted
from .smooth import NOISE_GAIN, smooth_closed, stiffness

Array = NDArray[np.floating]

_KEEP = 3.8  # f0 R that keeps a circle of radius R to R / 3000
_HIGHEST_CUTOFF = 1.5
_OUTLIER, _STRAY_PX = 4.0, 0.25
_NOISE_SHARE_PX = 60.0
_DOUBT = 2.5
_FLOOR_PX = 0.003
_ROUNDS = 2
_WORTH_A_ROUND = 1.3
_USUAL_NOISE_PX = 0.18  # scatter of edges above which the fit starts out coarser
_COARSEST = 6.0
_LAGS = 2
# Of the variance of a normal distribution, weighted by its trust, with 4 sigma as limit.
_TRUSTED_SHARE = 0.77
# Bilinear neighbours a pixel apart share pixels: variance of their mean, times n.
_ALIKE = 1.5
_PRIOR_SAMPLES = 150


def fit_outline(
    measured: Array, sigma: Array, inside: NDArray[np.bool_], wave_px: float, spacing: float
) -> tuple[Array, Array]:
    """Smooth one closed loop of edge points.

    Args:
        measured: (n, 2) float64, edge points, px, about evenly spaced.
        sigma: (n,) float64, their sigma across the loop, px; infinite where there is no edge.
        inside: (n,) bool, False along the border of the image, where the loop is not the
            object's and must not bend it.
        wave_px: shortest wave kept on gently curved stretches, px.
        spacing: distance of the samples, px.

    Returns:
        points: (n, 2) float64.
        sigma: (n,) float64, px, of the smoothed points across the loop.
    """
    known = np.isfinite(sigma) & inside
    if not known.any():
        return measured, np.full(len(measured), np.inf)
    weight = _weights(sigma, known)
    base = 2 * np.pi / wave_px * spacing
    cutoff = _cutoff(measured, base, spacing)
    # Edges on something else stand off the curve; a second look leaves them out.
    points = _solve(measured, weight, np.minimum(2 * cutoff, _HIGHEST_CUTOFF), inside)
    off = _across(measured, points) * np.sqrt(weight)
    scale = np.hypot(1.4826 * np.median(np.abs(off[known])), _STRAY_PX)
    trust = np.where(known, np.maximum(1 - (off / (_OUTLIER * scale)) ** 2, 0.0) ** 2, 0.0)
    # Where edges scatter by more than is usual, short waves are noise until proven.
    coarser = float(np.clip(scale / _USUAL_NOISE_PX, 1.0, _COARSEST))
    cutoff = _cutoff(points, base / coarser, spacing)
    if coarser > 1:
        points = _solve(measured, weight * trust, cutoff, inside)
        cutoff = _cutoff(points, base / coarser, spacing, coarser)
    points, cutoff, noise, stiff = _adapt(measured, weight, trust, cutoff, inside, spacing)
    weight = weight * trust
    gain = NOISE_GAIN * cutoff
    reach = round(4 * np.pi / float(np.median(cutoff)) / 3)
    share = along(weight, reach)
    sigma = noise * np.sqrt(gain / np.maximum(share, 1e-6))
    return points, np.hypot(np.where(inside, sigma, np.inf), stiff + _FLOOR_PX)


def quick_fit(
    measured: Array, sigma: Array, inside: NDArray[np.bool_], wave_px: float, spacing: float
) -> Array:
    """Smoothed points alone, by one solution; arguments as of ``fit_outline``."""
    known = np.isfinite(sigma) & inside
    if not known.any():
        return measured
    cutoff = _cutoff(measured, 2 * np.pi / wave_px * spacing, spacing)
    return _solve(measured, _weights(sigma, known), cutoff, inside)


def _weights(sigma: Array, known: NDArray[np.bool_]) -> Array:
    """(n,) inverse variances, 1 for the typical one; none counts more than ten."""
    typical = max(float(np.median(sigma[known])), 1e-3)
    return np.where(known, (typical / np.maximum(sigma, 0.3 * typical)) ** 2, 0.0)


def _cutoff(points: Array, base: float, spacing: float, coarser: float = 1.0) -> Array:
    """Cut-off frequency, rad a sample, that keeps the bends of the curve, as seen over a
    stretch that is longer by a factor for coarser curves."""
    bend = np.abs(curvature(points, reach=max(2, round(4 * coarser / spacing))))
    width = round(9 * coarser / spacing)
    cutoff = np.maximum(base, _KEEP * spacing * along(bend, width))
    return np.clip(along(cutoff, width), base, _HIGHEST_CUTOFF)


def _solve(measured: Array, weight: Array, cutoff: Array, inside: NDArray[np.bool_]) -> Array:
    return smooth_closed(measured, weight, np.where(inside, stiffness(cutoff), 0.0))


def _across(a: Array, b: Array) -> Array:
    """(n,) how far a lies outside b, along b's normals."""
    return np.einsum("ij,ij->i", a - b, normals(b, reach=2))


def _adapt(
    measured: Array,
    weight: Array,
    trust: Array,
    cutoff: Array,
    inside: NDArray[np.bool_],
    spacing: float,
) -> tuple[Array, Array, Array, Array]:
    """Fit, raising the cut-off where a finer fit departs from the coarse one for good
    reason.

    Returns:
        The points, the cut-off, the sigma (n,) of a measurement of weight 1, and how far
        (n,) a finer fit still departs for good reason, px.
    """
    weight_now = weight * trust
    points = _solve(measured, weight_now, cutoff, inside)
    for rounds in range(_ROUNDS + 1):
        fine_cutoff = np.minimum(2 * cutoff, _HIGHEST_CUTOFF)
        fine = _solve(measured, weight_now, fine_cutoff, inside)
        noise = _noise(measured, fine, weight, trust, fine_cutoff, spacing)
        allowed = noise * np.sqrt(NOISE_GAIN * (fine_cutoff - cutoff)) + _FLOOR_PX
        gap = maximum_filter1d(
            np.abs(_across(fine, points)), max(3, round(6 / spacing)), mode="wrap"
        )
        factor = np.clip(gap / (_DOUBT * allowed), 1.0, 2.0)
        if factor.max() < _WORTH_A_ROUND or rounds == _ROUNDS:
            break
        cutoff = np.minimum(cutoff * along(factor, round(9 / spacing)), _HIGHEST_CUTOFF)
        points = _solve(measured, weight_now, cutoff, inside)
    noise = _noise(measured, points, weight, trust, cutoff, spacing)
    return points, cutoff, noise, np.maximum(gap - _DOUBT * allowed, 0.0)


def _noise(
    measured: Array, fitted: Array, weight: Array, trust: Array, cutoff: Array, spacing: float
) -> Array:
    """Sigma (n,) of a measurement of weight 1, grown for neighbours that err alike.

    Args:
        measured, fitted: (n, 2).
        weight: (n,) of the measurements.
        trust: (n,) 0-1, lower for what looks like an outlier.
        cutoff: (n,) of the fit.
    """
    scatter = _across(measured, fitted) * np.sqrt(weight)
    width = round(_NOISE_SHARE_PX / spacing)
    # The fit follows part of the noise, at low frequency all of it: what lacks in the
    # variance and in the sum of 2 _LAGS + 1 covariances.
    followed = (2 / 3 - NOISE_GAIN) * cutoff
    usual = float(np.median(followed))
    kept = np.maximum(1 - followed, 0.3) * _TRUSTED_SHARE
    power = np.maximum(along(trust * scatter**2 / kept, width), 1e-12)
    power /= np.maximum(along(trust, width), 1e-3)
    off = scatter * trust
    total = max(float(off @ off), 1e-12)
    alike = sum(float(off @ shifted(off, lag)) for lag in range(1, _LAGS + 1))
    lost = min(0.7, (2 * _LAGS + 1) * usual)
    seen = (1 + 2 * alike / total) * (1 - usual) / (1 - lost)
    n = len(scatter)
    factor = np.clip((n * seen + _PRIOR_SAMPLES * _ALIKE) / (n + _PRIOR_SAMPLES), 1.0, 4.0)
    return np.sqrt(power * factor)
