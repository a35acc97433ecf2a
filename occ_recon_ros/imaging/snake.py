"""Snake tracking: the last contour, moved on as it moved before, relaxes onto the new image.

An active contour (M. Kass, A. Witkin and D. Terzopoulos, IJCV 1(4), 1988,
doi:10.1007/BF00133570; M.-O. Berger, "Tracking rigid and non polyhedral objects", 1994).
The internal force holds the displacement from the predicted curve smooth, so that the snake
keeps its shape over stretches without an edge; the external one pulls to the edge that
looks as the edge did before: the same step from the object's to the background's colour.
Each relaxation is one banded linear system.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .bends import inward_pull, pull_error
from .curves import along, normals, resample
from .fit import fit_outline
from .marks import marked
from .outline import Outline
from .settings import ContourSettings
from .smooth import smooth_closed, stiffness
from .subpixel import across, find_edges
from .window import Window

Array = NDArray[np.floating]

_GATES = (8.0, 5.0, 3.0)
_CALM_PX = 60.0  # wavelength that the displacement from the prediction may have
_LEVEL_PX = (3.5, 5.0, 6.5)
_LEVEL_SHARE_PX = 25.0
_LIKE = (0.45, 2.2)
_OFF_LEVEL = 0.45
_FAINT = 0.15
_MEMORY = 0.7
_LOST_SIGMA = 1.0
_SURE_SIGMA = 0.3
_STRAY_PX = 2.0
_WIDER_PX = 8.0
_END_PX, _END_SHARE = 24.0, 0.8
_HELD = 0.1


@dataclass(frozen=True)
class Snake:
    """What is kept of a tracked loop.

    Attributes:
        points: (n, 2) float64, px, of the last image.
        motion: (n, 2) float64, px an image.
        inside, outside: (n, channels) float64, colours on either side of the edge.
        seen: (n,) bool, where the last image had the edge.
    """

    points: Array
    motion: Array
    inside: Array
    outside: Array
    seen: NDArray[np.bool_]


def start_snake(
    image: NDArray, outline: Outline, settings: ContourSettings, before: Snake | None = None
) -> Snake:
    """A snake on an outline found by segmentation, moving on as the snake before it did."""
    points = outline.points
    out = normals(points, reach=2)
    inside, outside = edge_colours(image, points, out)
    contrast = np.linalg.norm(outside - inside, axis=1)
    seen = np.isfinite(outline.sigma) | outline.inside
    seen &= contrast > _LIKE[0] * np.median(contrast)
    width = round(_LEVEL_SHARE_PX / settings.spacing_px)
    inside, outside = (_filled(c, seen, width) for c in (inside, outside))
    motion = np.zeros_like(points)
    if before is not None:
        motion = before.motion[_nearest(points, before.points)[0]]
    return Snake(points, motion, inside, outside, seen)


def follow(
    image: NDArray, snake: Snake, settings: ContourSettings, window: Window
) -> tuple[Outline, Snake]:
    """Relax a snake onto the next image.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16.
        snake: as the last image left it.
        settings: spacing, search, smoothing.
        window: where samples count.

    Returns:
        The outline (sigma of a pixel or more where the edge was not to be seen) and the
        snake for the next image.
    """
    spacing = settings.spacing_px
    start = snake.points + snake.motion
    points = resample(start, spacing)
    nearest = cKDTree(start).query(points)[1]
    inside, outside = snake.inside[nearest], snake.outside[nearest]
    out = normals(points, reach=2)
    gain = _exposure(image, points, out, inside, outside)
    inside, outside = gain * inside, gain * outside
    calm = np.full(len(points), 2 * np.pi * spacing / _CALM_PX)
    shift: Array = np.zeros(len(points))
    valid = window.contains(points)
    for gate in _GATES:
        pull, weight = _attraction(image, points + shift[:, None] * out, out, inside, outside, gate)
        weight = np.where(valid, weight, 0.0)
        if weight.sum() < 0.1 * len(points):
            break
        shift = _smooth_shift(shift + pull, weight + 1e-4, calm)
    held = _ends_cut(weight > _HELD, spacing)
    relaxed = points + _bridged(shift, held, round(_WIDER_PX / spacing))[:, None] * out
    outline, seen, sure = _refine(image, relaxed, inside, outside, settings, window)
    known, fresh = _nearest(outline.points, relaxed)
    moved = outline.points - snake.points[nearest][known]
    # Motion along the curve cannot be seen, nor any where there is no edge.
    out = normals(outline.points, reach=2)
    width = round(_LEVEL_SHARE_PX / spacing)
    speed = _bridged((moved * out).sum(axis=1), sure & fresh, width)
    now_inside, now_outside = edge_colours(image, outline.points, out)
    keep = np.where(sure & fresh, _MEMORY, 1.0)[:, None]
    return outline, Snake(
        points=outline.points,
        motion=along(speed[:, None] * out, width),
        inside=keep * inside[known] + (1 - keep) * now_inside,
        outside=keep * outside[known] + (1 - keep) * now_outside,
        seen=seen,
    )


def edge_colours(image: NDArray, points: Array, out: Array) -> tuple[Array, Array]:
    """(n, channels) colours a few pixels inside and outside of a curve."""
    near = len(_LEVEL_PX)
    values = across(image, points, out, np.array([-px for px in _LEVEL_PX] + [*_LEVEL_PX]))
    inside, outside = values[:, :near].mean(axis=1), values[:, near:].mean(axis=1)
    return inside.astype(np.float64), outside.astype(np.float64)


def _exposure(image: NDArray, points: Array, out: Array, inside: Array, outside: Array) -> float:
    """How much brighter the image is than the colours kept."""
    now = np.concatenate([c.sum(axis=1) for c in edge_colours(image, points, out)])
    before = np.concatenate([inside.sum(axis=1), outside.sum(axis=1)])
    return float(np.clip(np.median((now + 1) / (before + 1)), 0.4, 2.5))


def _attraction(
    image: NDArray, points: Array, out: Array, inside: Array, outside: Array, gate: float
) -> tuple[Array, Array]:
    """Where along the normal the expected step is, and how much it looks like it (0-1)."""
    u = np.arange(-np.ceil(gate) - 2, np.ceil(gate) + 3)
    values = across(image, points, out, u)
    step = outside - inside
    contrast = np.maximum(np.linalg.norm(step, axis=1), 1e-3)
    # 0 on the object, 1 on the background; clipped, so that nothing draws more than the edge.
    grade = np.einsum("nmc,nc->nm", values, step) - np.einsum("nc,nc->n", inside, step)[:, None]
    grade = along(np.clip(grade / contrast[:, None] ** 2, -0.3, 1.3), 5)
    rise = np.maximum(grade[:, 3:] - grade[:, :-3], 0.0)
    middle = 0.5 * (u[3:] + u[:-3])
    power = np.exp(-0.5 * (middle / (0.5 * gate)) ** 2) * rise**4
    pull = (power * middle).sum(axis=1) / np.maximum(power.sum(axis=1), 1e-9)
    best = rise.max(axis=1)
    return pull, np.clip((best - _FAINT) / 0.5, 0.0, 1.0) ** 2


def _refine(
    image: NDArray,
    points: Array,
    inside: Array,
    outside: Array,
    settings: ContourSettings,
    window: Window,
) -> tuple[Outline, NDArray[np.bool_], NDArray[np.bool_]]:
    """Sub-pixel edges where they look as expected, the relaxed curve elsewhere; where that is,
    and where it is sure to be the edge of the object."""
    spacing = settings.spacing_px
    out = normals(points, reach=2)
    edge = find_edges(image, points, out, settings.search_px)
    valid = window.contains(points)
    contrast = np.linalg.norm(outside - inside, axis=1)
    now_inside, now_outside = edge_colours(image, points + edge.offset[:, None] * out, out)
    like = edge.contrast > _LIKE[0] * contrast
    like &= edge.contrast < _LIKE[1] * contrast
    # One side may change (a shadow, a new face of the object), not both.
    off_inside = np.linalg.norm(now_inside - inside, axis=1)
    off_outside = np.linalg.norm(now_outside - outside, axis=1)
    like &= np.minimum(off_inside, off_outside) < _OFF_LEVEL * contrast
    # The object before a shadow on the backdrop: a faint edge, but one beyond doubt.
    like |= (
        (off_inside < 0.5 * _OFF_LEVEL * contrast)
        & (edge.contrast > _FAINT * contrast)
        & (edge.sigma < _SURE_SIGMA)
    )
    seen = like & np.isfinite(edge.sigma) & (np.abs(edge.offset) < _STRAY_PX) & valid
    seen = along(seen.astype(float), round(_WIDER_PX / spacing)) > 0.6
    seen &= np.isfinite(edge.sigma) & (np.abs(edge.offset) < _STRAY_PX)
    sure = _ends_cut(seen, spacing)
    shift = np.where(sure, edge.offset + inward_pull(points, edge.blur), 0.0)
    measured = points + _bridged(shift, sure, round(_WIDER_PX / spacing))[:, None] * out
    sigma = np.where(sure, edge.sigma, _LOST_SIGMA)
    fitted, sigma = fit_outline(measured, sigma, valid, settings.smoothing_px, spacing)
    sigma = np.where(sure, sigma, np.maximum(sigma, _LOST_SIGMA))
    sigma = np.hypot(sigma, pull_error(fitted, edge.blur))
    sigma = marked(fitted, sigma, edge.blur, spacing)
    return Outline(fitted, sigma, valid, edge.contrast, edge.blur), seen, sure


def _smooth_shift(shift: Array, weight: Array, cutoff: Array) -> Array:
    return smooth_closed(shift[:, None], weight, stiffness(cutoff))[:, 0]


def _ends_cut(seen: NDArray[np.bool_], spacing: float) -> NDArray[np.bool_]:
    """What is seen without the ends, from where the edge of another thing may lead away."""
    return seen & (along(seen.astype(float), round(_END_PX / spacing)) > _END_SHARE)


def _bridged(values: Array, known: NDArray[np.bool_], width: int) -> Array:
    """(n,) values along the loop, drawn straight from end to end of the unknown stretches; each
    end is the mean of what is known over a width."""
    if known.all() or not known.any():
        return values
    share = along(known.astype(float), width)
    mean = along(np.where(known, values, 0.0), width) / np.maximum(share, 1e-9)
    rows = np.arange(len(values))
    return np.where(known, values, np.interp(rows, rows[known], mean[known], period=len(values)))


def _nearest(points: Array, reference: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    distance, index = cKDTree(reference).query(points)
    return index, distance < 5.0


def _filled(colours: Array, seen: NDArray[np.bool_], width: int) -> Array:
    """Colours smoothed along the loop, those of unseen stretches from their neighbours."""
    weight = seen.astype(float)[:, None]
    share = along(weight, width)
    mean = along(colours * weight, width) / np.maximum(share, 1e-9)
    whole = (colours * weight).sum(axis=0) / max(weight.sum(), 1.0)
    return np.where(share > 0.05, mean, whole)
