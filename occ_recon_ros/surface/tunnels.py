"""Whether a hole that no other view sees through may be a hole all the same.

A hole of one silhouette is a tunnel through the hull of the others. A view that looks across it
cannot see through it, which says nothing. What speaks against it are rays inside, or on the
outline, of another silhouette on which the object can be nowhere but in the tunnel: that view shows
a surface where it would be empty. What is left are tunnels so narrow that hardly any view refutes
them; a view that happens to look along one is rarer than a spot that was taken for a hole.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from ..geometry import Contours
from ..geometry.arrays import Array, Index
from .agreement import Comparison
from .cone import Cone, inside

Mask = NDArray[np.bool_]

_SLACK_PX = 1.0  # that a right outline may be off
_SAMPLES = 100  # rays through a hole
_RAYS = 80  # of another view, on its outline and as many inside, where the tunnel is
_COARSE, _FINE = 96, 192  # depths along them
_WITNESSES = 2  # views that show a surface in a tunnel, each by so many rays, at least
_NARROW = 0.3  # side of a hole as a square, of the length that it pierces: 17 by 17 degrees see it


def holes_of(cone: Cone) -> Iterator[tuple[Index, Index]]:
    """Rows and columns of each hole of a silhouette: a picture of its own for each of hundreds
    takes gigabytes."""
    parts, _ = label((cone.image > 0) & ~cone.unknown)
    border = {0, *parts[[0, -1]].ravel().tolist(), *parts[:, [0, -1]].ravel().tolist()}
    for k, box in enumerate(find_objects(parts), 1):
        if k not in border:
            rows, columns = np.nonzero(parts[box] == k)
            yield rows + box[0].start, columns + box[1].start


def may_be(
    i: int,
    rows: Index,
    columns: Index,
    cones: Mapping[int, Cone],
    contours: Sequence[Contours],
    found: Comparison,
) -> bool:
    """Whether nothing speaks against a hole of view ``i``.

    Args:
        i: number of the view.
        rows, columns: (k,) the hole's pixels in the image of its cone.
        cones: of the views that are trusted.
        contours: of all views.
        found: all views held against each other.
    """
    cone, side_px = cones[i], np.sqrt(len(rows))
    hole = np.zeros(cone.image.shape, np.bool_)
    hole[rows, columns] = cone.image[rows, columns] > _SLACK_PX
    rows, columns = np.nonzero(hole)
    if not len(rows):
        return False
    picked = np.random.default_rng(0).permutation(len(rows))[:_SAMPLES]
    T = cone.rays(rows[picked], columns[picked])
    points, depths = found.along(cone, T, _COARSE)
    solid = inside(points, [cones[j] for j in cones if j != i])
    pierced = np.median(solid.sum(axis=1)) * (depths[1] - depths[0])
    if side_px < _NARROW * pierced / (depths.mean() * cone.pixel):
        return False
    tunnel = points[solid]
    against = 0
    for j, other in cones.items():
        if j != i and len(tunnel):
            rays = _through(other, contours[j].T, tunnel)
            judges = [cones[k] for k in cones if k not in (i, j)]
            against += _nowhere_else(other, rays, cone, hole, judges, found) >= _WITNESSES
    return against < _WITNESSES


def _through(view: Cone, outline: Array, tunnel: Array) -> Array:
    """(m, 3) rays of a view, of depth 1, through a tunnel's points (k, 3), and on its outline's
    viewing directions (n, 3) where the tunnel is."""
    at, on = view.pixels_of(tunnel), view.pixels_of(view.centre + outline)
    beside = outline[((on > at.min(axis=0) - 1) & (on < at.max(axis=0) + 1)).all(axis=1)]
    some = np.random.default_rng(1).permutation(len(tunnel))[:_RAYS]
    step = max(1, -(-len(beside) // _RAYS))
    T = np.concatenate([beside[::step], tunnel[some] - view.centre])
    return np.asarray(T / (T @ view.axes[2])[:, None])


def _nowhere_else(
    view: Cone, T: Array, cone: Cone, hole: Mask, judges: Sequence[Cone], found: Comparison
) -> int:
    """On how many rays T (m, 3) of a view the object can be in the tunnel of a cone's hole only.

    Args:
        view, T: the rays.
        cone, hole: that has the hole, and (h, w) where it is.
        judges: all other views.
        found: all views held against each other.
    """
    points, depths = found.along(view, T, _FINE)
    slack = _SLACK_PX * view.pixel * float(depths.mean())
    solid = inside(points, judges, slack)
    column, row = np.rint(cone.pixels_of(points.reshape(-1, 3))).astype(int).T
    h, w = hole.shape
    shown = (row >= 0) & (row < h) & (column >= 0) & (column < w)
    lost = np.zeros(shown.shape, np.bool_)
    lost[shown] = hole[row[shown], column[shown]]
    elsewhere = solid & inside(points, [cone], slack)
    only = (solid & lost.reshape(solid.shape)).any(axis=1) & ~elsewhere.any(axis=1)
    return int(only.sum())
