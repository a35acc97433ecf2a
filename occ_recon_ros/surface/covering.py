"""How a closed body covers the outlines that it was made from, and what few views leave of it."""

from collections.abc import Iterator, Sequence

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from ..geometry import Contours
from ..geometry.arrays import Array, Index, thinned
from .cone import Cone, Mask
from .evidence import CarvingCones, all_of, weigh
from .hull import Hull
from .tunnels import holes_of

LEAST_COVERED = 0.95  # of the outlines by the body that all of them leave, IoU
LEAST_COVERED_ONE = 0.93  # of one of them, where none contradicts the others
_CELLS = 96  # along the body that all outlines leave
_COMPARED = 12  # views that the body is held against
_ACROSS = 160  # rays across an outline
_SLACK_PX = 2.0  # that the border of a hole may be off
_RAYS = 100  # through a hole
_FILLED = 0.5  # of them, that meet the body where it fills the hole
_AT_BORDER = 0.02  # of the image's longer side: outlines end a little before its border


def body_iou(body: trimesh.Trimesh, contours: Sequence[Contours]) -> Array:
    """How well a body covers the outlines that it was made from.

    Args:
        body: metres, object frame.
        contours: of all views; some, spread evenly, are looked at.

    Returns:
        (m,) intersection over union, on a grid of viewing directions about each outline.
    """
    found = []
    for covered, shown in _held_against(body, contours):
        found.append((covered & shown).sum() / max(1, (covered | shown).sum()))
    return np.array(found)


def uncovered(body: trimesh.Trimesh, contours: Sequence[Contours]) -> Array:
    """(m,) how much a body lacks of outlines, of the area of each; arguments as ``body_iou``."""
    found = [
        (shown & ~covered).sum() / max(1, shown.sum())
        for covered, shown in _held_against(body, contours)
    ]
    return np.array(found)


def _held_against(
    body: trimesh.Trimesh, contours: Sequence[Contours]
) -> Iterator[tuple[Mask, Mask]]:
    """Of some of the views, where a body covers a grid of viewing directions about the outline, and
    where that shows the object."""
    intersector, seen = RayMeshIntersector(body), [c for c in contours if len(c) > 2]
    for view in thinned(seen, _COMPARED):
        cone = Cone(view)
        step = max(1, max(cone.image.shape) // _ACROSS)
        rows, columns = np.mgrid[: cone.image.shape[0] : step, : cone.image.shape[1] : step]
        covered = _meet(intersector, cone, rows.ravel(), columns.ravel())
        known = ~cone.unknown[::step, ::step].ravel()
        yield covered & known, (cone.image[::step, ::step].ravel() < 0) & known


def covered_by_hull(contours: Sequence[Contours]) -> float:
    """How well the body that all outlines leave covers them, IoU in the mean; 1.0 where no body is
    bounded by them, 0.0 where none is left."""
    return float(_each_covered(all_of(contours), contours).mean())


def doubt_of_hull(contours: Sequence[Contours]) -> str:
    """What speaks against outlines by the body that all of them leave, in their own images, ""
    where nothing does. Thin holes in few views, too small to be a contradiction in any, leave it
    in shreds; and of few views each may hold more than the object."""
    return _too_little(_each_covered(all_of(contours), contours), "that all outlines leave")


def doubt_of_holes(contours: Sequence[Contours]) -> str:
    """What speaks against outlines by the body that is closed over their holes, "" where nothing
    does. Crevices as dark as the backdrop are holes of most views, which carve nothing that any
    other view needs; but others show a surface there."""
    weighed = weigh(contours)
    if not weighed.mended:
        return ""
    count = len(weighed.mended)
    how = f"without holes or bites of {count} of {len(contours)} outlines, which others refute,"
    return _too_little(_each_covered(weighed, contours), how)


def _too_little(covered: Array, how: str) -> str:
    if covered.mean() < LEAST_COVERED:
        return f"the body {how} covers {covered.mean():.0%} of them"
    if covered.min() < LEAST_COVERED_ONE:
        return f"the body {how} covers one of them by {covered.min():.0%}"
    return ""


def _each_covered(carving: CarvingCones, contours: Sequence[Contours]) -> Array:
    try:
        hull = Hull(carving.cones)
        return body_iou(hull.mesh(_CELLS), contours) if hull.bounded else np.ones(1)
    except ValueError:
        return np.zeros(1)


def filled_holes(body: trimesh.Trimesh, contours: Sequence[Contours]) -> Array:
    """How much of each outline are holes that a body fills.

    Args:
        body: metres, object frame.
        contours: of all views.

    Returns:
        (n,) area of those holes, of that of the silhouette; 0 of a view without an outline.
    """
    intersector, found = RayMeshIntersector(body), np.zeros(len(contours))
    for k, view in enumerate(contours):
        if len(view) < 3:
            continue
        cone = Cone(view)
        inside = max(1, int((cone.image < 0).sum()))
        for rows, columns in holes_of(cone):
            deep = np.flatnonzero(cone.image[rows, columns] > _SLACK_PX)
            some = thinned(deep.tolist(), _RAYS)
            if some and _meet(intersector, cone, rows[some], columns[some]).mean() > _FILLED:
                found[k] += len(rows) / inside
    return found


def cut_off(view: Contours, size: tuple[int, int]) -> float:
    """How much of an outline is missing along the border of its image, of the outline's size.

    Args:
        view: the outline.
        size: width and height of the image, px.
    """
    if not len(view):
        return 0.0
    ends = np.flatnonzero(~view.linked)
    gaps = view.uv[[ends, view.next_row[ends]]]  # (2, m, 2)
    away = np.minimum(gaps, np.array(size) - 1.0 - gaps).min(axis=2).max(axis=0)
    missing = np.linalg.norm(gaps[1] - gaps[0], axis=1)[away < _AT_BORDER * max(size)]
    return float(missing.sum() / np.ptp(view.uv, axis=0).max())


def stands_off(step_deg: float) -> float:
    """How far off a round surface, of its radius, the cones of two views meet that are so many
    degrees apart; between them nothing else bounds what rims do not show."""
    return float(1 / np.cos(np.deg2rad(min(step_deg, 170.0)) / 2) - 1)


def _meet(body: RayMeshIntersector, cone: Cone, rows: Index, columns: Index) -> Mask:
    """(k,) whether the rays through pixels of a cone's image meet the body."""
    T = cone.rays(rows, columns)
    return np.asarray(body.intersects_any(np.broadcast_to(cone.centre, T.shape), T), np.bool_)
