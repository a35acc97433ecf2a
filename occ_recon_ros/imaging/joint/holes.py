"""Holes of the body through which its views see the dark backdrop.

A shadow in a hollow may be as dark as the backdrop, and colours alone do not tell it from a hole.
But a hole looks exactly as the backdrop about the object does, what is around it is lit, and from
the other side it is a hole at the same place in space, where behind a hollow a side is lit.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes

from .each import each
from .evidence import differing
from .regions import Mask, grown, opened, shrunk, square
from .scenes import USUAL, Scene, strongest
from .small_view import SmallView
from .space import Grid, pixel_of

_DARK = 64.0  # grey levels, up to which a backdrop is dark
_LIKE = 3.0  # sigmas of the backdrop about the object
_LEAST_SIGMA = 1.0  # grey level
_ABOUT = 0.5  # of the object's size, sigma of the surroundings of a place
_LARGE = 0.005  # of the object's area
_LIT = 15.0  # grey levels by which the border of a hole is lighter
_ENCLOSED = 0.6  # of that border
_OPPOSITE = -0.3  # cosine between the directions of two views that look from either side
_CONFIRMED = 0.5  # of what a hole passes through that is passed through from the other side too
_MOSTLY = 0.55  # of what all pass through
_AS_EMPTY = 0.5  # of a hole, what looks as its place does when empty: shadows move over the rest


def holes_of(
    views: Sequence[SmallView], grid: Grid, body: Mask, masks: Sequence[Mask]
) -> list[Mask]:
    """Of each view, (h, w) where it sees the dark backdrop through the body.

    Args:
        views: n of them.
        grid, body: (nx, ny, nz) occupied voxels.
        masks: of each view, (h, w) the outline of the body.
    """
    regions = each(_dark_regions, views, masks)
    nothing = [np.zeros(mask.shape, np.bool_) for mask in masks]
    if not any(regions):
        return nothing
    points = grid.low + grid.size * (np.argwhere(body) + 0.5)
    away = np.array([view.camera.centre for view in views]) - points.mean(axis=0)
    away /= np.linalg.norm(away, axis=1)[:, None]
    seen = [pixel_of(view.camera, points) for view in views]
    through = [
        inside & np.any([*found, none], axis=0).ravel()[pixels]
        for (pixels, inside), found, none in zip(seen, regions, nothing, strict=True)
    ]
    holes = [none.copy() for none in nothing]
    told = confirmed = 0
    for k, (pixels, inside) in enumerate(seen):
        others = np.flatnonzero(away @ away[k] < _OPPOSITE)
        open_behind = np.any([through[j] for j in others], axis=0) & inside
        for region in regions[k]:
            rays = inside & region.ravel()[pixels]
            whole, some = int(rays.sum()), int((rays & open_behind).sum())
            told, confirmed = told + whole, confirmed + some
            if some > _CONFIRMED * whole:
                holes[k] |= region
    # Of dark places on all sides some lie before each other.
    return holes if confirmed > _MOSTLY * told else nothing


def seen_through(view: SmallView, mask: Mask, scenes: Sequence[Scene]) -> Mask:
    """(h, w) the holes of an outline that show what lies behind them: a light backdrop, exactly as
    it is at that place where nothing hides it. A shaded part of the object is not as exact, and
    what is dark may be a hollow.

    Args:
        view: whose outline.
        mask: (h, w).
        scenes: pictures of the backdrop.
    """
    gaps = np.asarray(binary_fill_holes(mask)) & ~mask
    if not gaps.any():
        return gaps
    off = np.full(mask.shape, np.inf)
    for scene in scenes:
        told = np.isfinite(scene[1]) & (strongest(scene[0]) > _DARK)
        off = np.where(told, np.minimum(off, differing(view, scene)[0]), off)
    _, parts = cv2.connectedComponents(gaps.astype(np.uint8), connectivity=4)
    whole = np.bincount(parts.ravel())
    as_empty = np.bincount(parts[gaps & (off < USUAL)], minlength=len(whole))
    return gaps & (as_empty > _AS_EMPTY * whole)[parts]


def _dark_regions(view: SmallView, mask: Mask) -> list[Mask]:
    """Within the outline, what looks as the dark backdrop and has lit borders, one by one."""
    area = int(np.count_nonzero(mask))
    beyond = ~grown(mask, square(7)) & view.picture
    if not area or not beyond.any() or np.median(view.image[beyond]) > _DARK:
        return []
    like = opened(_as_backdrop(view.even, beyond, np.sqrt(area)) & _within(mask), square(3))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        like.astype(np.uint8), connectivity=4
    )
    light = view.even.max(axis=2).astype(np.float32)
    found = []
    for k in range(1, count):
        region = labels == k
        inner = shrunk(region, square(3))
        if stats[k, cv2.CC_STAT_AREA] < _LARGE * area or not inner.any():
            continue
        border = grown(region, square(3), 3) & ~grown(region, square(3), 2)
        if np.mean(light[border] > np.median(light[inner]) + _LIT) > _ENCLOSED:
            found.append(region)
    return found


def _within(mask: Mask) -> Mask:
    return shrunk(np.asarray(binary_fill_holes(mask)), square(3))


def _as_backdrop(image: NDArray[np.uint8], beyond: Mask, size: float) -> Mask:
    """(h, w) where an image without noise looks as what is around the object nearby."""
    levels = image.astype(np.float32)
    sigma = _ABOUT * size

    def blurred(values: NDArray) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(values.astype(np.float32), (0, 0), sigma))

    there = np.maximum(blurred(beyond), 1e-4)[..., None]
    away = levels - blurred(levels * beyond[..., None]) / there
    spread = 1.48 * np.median(np.abs(away[beyond]), axis=0)
    off = away / np.maximum(spread, _LEAST_SIGMA)
    return np.asarray((off**2).mean(axis=2) < _LIKE**2)
