"""One loop: edges found across it, smoothed to an outline with a sigma at each sample."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .curves import along, curvature, normals, resample
from .settings import ContourSettings
from .smooth import NOISE_GAIN, smooth_closed, stiffness
from .subpixel import Edge, find_edges

Array = NDArray[np.float64]

_KEEP = 3.4  # f0 R that keeps a circle of radius R to R / 1500
_MASK_BLUR = 1.5
_MASK_SIGMA = 0.4
_MASK_FLOOR = 0.15
_COARSE = 2.0
_MASK_TRUST = 1.25


@dataclass(frozen=True)
class Outline:
    """A closed loop: points (n, 2) float64 px, sigma (n,) float64 px, infinite where no
    surface may be made from the sample."""

    points: Array
    sigma: Array


def image_outline(image: NDArray, loop: Array, settings: ContourSettings) -> Outline:
    """The outline along the edge in the image.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16.
        loop: (n, 2) float64, the outline to within ``search_px``.
        settings: spacing, search, smoothing.
    """
    points = resample(loop, _COARSE * settings.spacing_px)
    out = normals(points)
    edge = find_edges(image, points, out, settings.search_px, iterations=2)
    coarse, _ = smooth_outline(
        points + edge.offset[:, None] * out, edge.sigma, settings, _COARSE * settings.spacing_px
    )
    points = resample(coarse, settings.spacing_px)
    out = normals(points, reach=2)
    edge = find_edges(image, points, out, settings.search_px)
    return Outline(*smooth_outline(_unbend(points, out, edge), edge.sigma, settings))


def mask_outline(
    image: NDArray | None, mask: NDArray[np.uint8], loop: Array, settings: ContourSettings
) -> Outline:
    """The outline along the edge of a mask, taken from the image where that has one nearby.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16; None: keep the edge of the mask.
        mask: (h, w) uint8, 255 = object.
        loop: (n, 2) float64, the outline of the mask to within ``search_px``.
        settings: spacing, search, smoothing.
    """
    soft = cv2.GaussianBlur(mask, (0, 0), _MASK_BLUR)
    coarse = image_outline(soft, loop, settings)
    points = resample(coarse.points, settings.spacing_px)
    out = normals(points, reach=2)
    by_mask = find_edges(soft, points, out, settings.search_px)
    measured = _unbend(points, out, by_mask)
    sigma = np.where(np.isfinite(by_mask.sigma), _MASK_SIGMA, np.inf)
    floor = np.full(len(points), _MASK_FLOOR)
    if image is not None:
        seen = find_edges(image, points, out, settings.search_px)
        near = np.abs(seen.offset - by_mask.offset) < _MASK_TRUST
        near &= seen.sigma < _MASK_SIGMA
        measured = np.where(near[:, None], _unbend(points, out, seen), measured)
        sigma = np.where(near, seen.sigma, sigma)
        floor = _MASK_FLOOR * along((~near).astype(float), round(settings.smoothing_px / 2))
    points, sigma = smooth_outline(measured, sigma, settings)
    return Outline(points, np.hypot(sigma, floor))


def _unbend(points: Array, out: Array, edge: Edge) -> Array:
    """The edge points, with the inward pull of blur on bent curves put back."""
    bend = np.clip(along(curvature(points), 7), -0.25, 0.25)
    return points + (edge.offset + 0.5 * bend * edge.blur**2)[:, None] * out


def smooth_outline(
    measured: Array, sigma: Array, settings: ContourSettings, spacing: float | None = None
) -> tuple[Array, Array]:
    """Smoothed points and the sigma of the smoothed points."""
    spacing = spacing or settings.spacing_px
    known = np.isfinite(sigma)
    if not known.any():
        return measured, np.full(len(measured), np.inf)
    typical = max(float(np.median(sigma[known])), 1e-3)
    weight = np.where(known, (typical / np.maximum(sigma, 0.3 * typical)) ** 2, 0.0)
    bend = np.abs(curvature(measured, reach=max(2, round(4 / spacing))))
    bend = along(bend, round(9 / spacing))
    cutoff = np.maximum(2 * np.pi / settings.smoothing_px, _KEEP * bend) * spacing
    cutoff = np.clip(along(cutoff, round(9 / spacing)), 1e-3, 2.5)
    smoothed = smooth_closed(measured, weight, stiffness(cutoff))
    # The measured sigma is as right as its model; how far the points scatter is the proof.
    out = normals(smoothed, reach=2)
    scatter = ((measured - smoothed) * out).sum(axis=1) / np.where(known, sigma, 1.0)
    ratio = 1.4826 * float(np.median(np.abs(scatter[known])))
    gain = NOISE_GAIN * cutoff
    share = np.maximum(along(weight, round(2 * np.pi / float(np.median(cutoff)))), 1e-9)
    return smoothed, max(ratio, 0.2) * typical * np.sqrt(gain / share) + 0.003
