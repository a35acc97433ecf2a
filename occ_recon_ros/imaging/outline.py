"""One loop: edges found across it, in the image or in a mask, and fitted."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import median
from ..geometry.compiled import compiled
from .bends import inward_pull, pull_error
from .curves import along, for_loops, normals, resample
from .fit import fit_outline, quick_fit
from .marks import marked
from .settings import ContourSettings
from .subpixel import find_edges, interpolation_error
from .window import Window

Array = NDArray[np.floating]

_COARSE = 2.0
_SLOW_SHARE = 0.12  # of the error of interpolation, what smoothing leaves along a row
_MASK_BLUR, _MASK_FAR = 1.5, 20.0  # px, and beyond the search, of the widest profile and the blur
_MASK_SIGMA = 0.3
_MASK_FLOOR = 0.06
_MASK_TRUST = 0.7
_MASK_REACH = 0.75
_GRADED_SIGMA = 0.1  # px, of the edge of a mask of 8 bits of coverage
_MOSTLY = 0.6  # of an outline


@dataclass(frozen=True)
class Outline:
    """A closed loop.

    Attributes:
        points: (n, 2) float64, px, evenly spaced, object on the left as displayed.
        sigma: (n,) float64, px, across the loop; infinite where nothing may be made of it.
        inside: (n,) bool, False along the border of the image.
        contrast: (n,) float64, of the edge, grey levels.
        blur: (n,) float64, of the edge, px.
    """

    points: Array
    sigma: Array
    inside: NDArray[np.bool_]
    contrast: Array
    blur: Array

    def cut(self, min_loop_px: float, spacing: float) -> tuple[Array, Array] | None:
        """Points and sigma without the samples along the border, None if too few are left;
        a gap comes to lie where the closed loop is joined."""
        if self.inside.sum() * spacing < min_loop_px:
            return None
        starts = np.flatnonzero(self.inside & ~np.roll(self.inside, 1))
        rows = np.roll(np.arange(len(self.points)), -int(starts[0]) if len(starts) else 0)
        rows = rows[self.inside[rows]]
        return self.points[rows], self.sigma[rows]


def image_outline(
    image: NDArray, loop: Array, settings: ContourSettings, window: Window
) -> Outline:
    """The outline along the edge in the image.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16.
        loop: (n, 2) float64, the outline to within ``search_px``.
        settings: spacing, search, smoothing.
        window: where samples count.
    """
    points, blur = coarse_outline(image, loop, settings, window)
    out = normals(points, reach=2)
    edge = find_edges(image, points, out, settings.search_px, iterations=3, blur=blur)
    measured, inside = unbent(points, out, edge.offset, edge.blur), window.contains(points)
    grid = interpolation_error(edge.blur)
    fitted, sigma = fit_outline(
        measured, edge.sigma, inside, settings.smoothing_px, settings.spacing_px, grid, points
    )
    # Along a row of pixels the error of interpolation is too slow to be smoothed out.
    slope = np.abs(normals(fitted, reach=2)).min(axis=1)
    slow = _SLOW_SHARE * grid * np.exp(-0.5 * (slope * settings.smoothing_px) ** 2)
    sigma = np.hypot(np.hypot(sigma, slow), pull_error(fitted, edge.blur))
    sigma = marked(fitted, sigma, edge.blur, settings.spacing_px)
    return Outline(fitted, sigma, inside, edge.contrast, edge.blur)


def mask_outline(
    image: NDArray | None,
    mask: NDArray[np.uint8],
    loop: Array,
    settings: ContourSettings,
    window: Window,
) -> Outline:
    """The outline along the edge of a mask, taken from the image where that has one nearby.

    A mask that tells how much of each pixel is covered knows its edge better than that.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16; None: keep the edge of the mask.
        mask: (h, w) uint8, 255 = object, levels between are coverage.
        loop: (n, 2) float64, the outline of the mask to within ``search_px``.
        settings: spacing, search, smoothing.
        window: where samples count.
    """
    graded = _graded(mask, loop)
    soft = _softened(mask, loop, 2 * settings.search_px)
    points, blur = coarse_outline(soft, loop, settings, window)
    out, inside = normals(points, reach=2), window.contains(points)
    by_mask = find_edges(soft, points, out, settings.search_px, iterations=3, blur=blur)
    offset, blur_here = by_mask.offset, by_mask.blur
    sigma = np.where(np.isfinite(by_mask.sigma), _GRADED_SIGMA if graded else _MASK_SIGMA, np.inf)
    floor, seen = np.full(len(points), _MASK_FLOOR), by_mask
    if image is not None and not graded:
        seen = find_edges(image, points, out, settings.search_px)
        near = np.abs(seen.offset - by_mask.offset) < _MASK_TRUST
        near &= seen.sigma < _MASK_SIGMA
        offset = np.where(near, seen.offset, offset)
        blur_here = np.where(near, seen.blur, blur_here)
        sigma = np.where(near, seen.sigma, sigma)
        floor = _MASK_FLOOR * along((~near).astype(float), round(settings.smoothing_px / 2))
    measured = unbent(points, out, offset, blur_here)
    points, sigma = fit_outline(
        measured, sigma, inside, settings.smoothing_px, settings.spacing_px, start=points
    )
    points, moved = _kept_near(points, mask)
    sigma = marked(points, np.hypot(sigma, floor + moved), seen.blur, settings.spacing_px)
    return Outline(points, sigma, inside, seen.contrast, seen.blur)


def _graded(mask: NDArray[np.uint8], loop: Array) -> bool:
    """Whether levels between nothing and all lie along most of an outline in a mask."""
    x, y = np.rint(loop).astype(int).T
    x, y = np.clip(x, 1, mask.shape[1] - 2), np.clip(y, 1, mask.shape[0] - 2)
    near = np.stack([mask[y + dy, x + dx] for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))])
    return bool(np.mean(((near > 8) & (near < 247)).any(axis=0)) > _MOSTLY)


def _softened(mask: NDArray[np.uint8], loop: Array, reach: float) -> NDArray[np.uint8]:
    """The mask blurred around a loop, so far from it that edges of any blur are found, px."""
    far = int(reach + _MASK_FAR)
    x, y = np.maximum(loop.min(axis=0).astype(int) - far, 0)
    right, bottom = loop.max(axis=0).astype(int) + far
    soft = np.zeros_like(mask)
    part = mask[y:bottom, x:right]
    soft[y:bottom, x:right] = cv2.GaussianBlur(part, (0, 0), _MASK_BLUR)
    return soft


def _kept_near(points: Array, mask: NDArray[np.uint8]) -> tuple[Array, Array]:
    """The points, none farther than _MASK_REACH px from the edge of the mask, and how far each
    was moved (n,), px."""
    points, moved = points.copy(), np.zeros(len(points))
    rows = np.arange(len(points))
    for _ in range(2):
        away = compiled("imaging.pixel_kernels").outside_by(for_loops(mask), points[rows])
        excess = np.sign(away) * np.maximum(np.abs(away) - _MASK_REACH, 0.0)
        rows, excess = rows[excess != 0], excess[excess != 0]
        points[rows] -= excess[:, None] * normals(points, reach=2)[rows]
        moved[rows] += np.abs(excess)
    return points, moved


def coarse_outline(
    image: NDArray, loop: Array, settings: ContourSettings, window: Window
) -> tuple[Array, float]:
    """The loop moved to the edge to about a tenth of a pixel, sampled anew, and the blur of
    the edge, px."""
    spacing = _COARSE * settings.spacing_px
    points = resample(loop, spacing)
    out = normals(points)
    edge = find_edges(image, points, out, settings.search_px, iterations=2)
    measured = points + edge.offset[:, None] * out
    inside = window.contains(points)
    points = quick_fit(measured, edge.sigma, inside, settings.smoothing_px / 2, spacing)
    return resample(points, settings.spacing_px), median(edge.blur)


def unbent(points: Array, out: Array, offset: Array, blur: Array) -> Array:
    """The edge points, with the inward pull of blur on bent curves put back."""
    return points + (offset + inward_pull(points, blur))[:, None] * out
