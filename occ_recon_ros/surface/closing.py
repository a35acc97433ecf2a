"""The closed surface: rims where there are rims, the visual hull where there are none.

The hull's mesh is watertight and of the right genus, and touches the surface along the
rims; between two rims it is too large. There its vertices are moved on to the surface
that the rims and the epipolar curves between them sample; where no rim comes they span the
edges of the cones (``fairing``).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..geometry import Contours, Rim, Status
from ..geometry.arrays import Array, thinned
from ..geometry.compiled import compiled
from ..geometry.settings import setting
from .agreement import Agreement
from .bodies import without_phantoms
from .crossing import uncrossed, unfolded
from .evidence import all_of, weigh
from .fairing import faired, mean_of_neighbours, vertex_normals
from .hull import Hull
from .sweep import Samples, swept_samples

_MOST_VIEWS = 120  # that carve
_SPACING = 0.7  # cells between samples along the epipolar curves
_NEIGHBOURS = 24
_REACH = 2.5  # cells: samples farther away say nothing of a vertex
_KERNEL = 1.0  # cells, standard deviation of the weights
_FACING = 0.5  # least cosine between the normals of a sample and of the vertex
_LEAST_AGREEMENT = 0.9  # length of the mean normal of a vertex' samples
_FARTHEST = 1.5  # cells that a vertex may move
_PROJECTIONS = 3
_MOST_NAMED = 6  # views
_STALE = 0.1  # cells that a vertex may move before its neighbours are looked for again
_EVENING = 4  # rounds of tangential smoothing of the hull's mesh
_SOME_POINTS = 5000
_ONE_SIGMA = 84  # percentile
_HOLDS = 3
_REFUTED_PX = 1.0  # beyond the noise: the silhouettes rather than what rims show
_PROBE = 0.1  # cells aside, to find which way is in


@dataclass(frozen=True)
class ClosingSettings:
    """How the closed surface is made."""

    cells: int = setting(
        200,
        "Grid cells along the longest side of the object. Parts thinner than one "
        "cell may be lost; time and size grow with the square.",
        within=(16, 600),
    )
    deepest: float = setting(
        1.0,
        "How far inside the hull a rim may still be believed, in cells. A true rim "
        "touches the hull.",
        within=(0.1, 20.0),
    )
    weighed: bool = setting(
        True,
        "Hold the silhouettes against each other first, and leave out those, and "
        "holes and bites of others, that most of the rest refute.",
    )


@dataclass(frozen=True)
class ClosedSurface:
    """The closed surface, and which views did not make it.

    Attributes:
        mesh: a closed 2-manifold, metres, object frame, triangles outward by the right-hand rule.
        left_out: stamps of the views whose silhouettes contradict those of the others; neither
            they nor their rims were used.
        mended: stamps of the views of which a hole or a bite was not believed.
        agreement: of the views with each other; None if that was not asked or cannot be told.
        compared: stamps of the views that it is of.
        undecided: so many views contradict each other that all were used.
        outside_px: (vertices,) how far outside the worst of the silhouettes used, pixels.
    """

    mesh: trimesh.Trimesh
    left_out: tuple[int, ...]
    mended: tuple[int, ...]
    agreement: Agreement | None
    compared: tuple[int, ...]
    undecided: bool
    outside_px: Array

    def doubt(self) -> str:
        """What its own outlines say against it, in words; "" for nothing."""
        if self.agreement is None or not (self.undecided or self.left_out):
            return ""
        shares = dict(zip(self.compared, self.agreement.share, strict=True))
        bad = np.array(self.compared)[self.agreement.doubtful]
        who = self.left_out or tuple(bad.tolist())
        most = max(shares.get(stamp, 0.0) for stamp in who)
        what = (
            f"{len(who)} of {len(self.compared)} views contradict the others, by up to {most:.0%}"
        )
        if self.undecided:
            return f"{what}: masks, poses or calibration are wrong, and so is the body"
        named = ", ".join(f"{stamp * 1e-9:.3f}" for stamp in self.left_out[:_MOST_NAMED])
        more = " ..." if len(self.left_out) > _MOST_NAMED else ""
        return f"{what}, and are left out: look at pose and outline at stamp {named}{more}"


def close_surface(
    contours: Sequence[Contours],
    rims: Sequence[Rim],
    settings: ClosingSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> trimesh.Trimesh:
    """The mesh of ``close_views``, of which see the arguments."""
    return close_views(contours, rims, settings, progress).mesh


def close_views(
    contours: Sequence[Contours],
    rims: Sequence[Rim],
    settings: ClosingSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ClosedSurface:
    """One watertight sheet around the object.

    Args:
        contours: all views, in the object frame. Of very many some, spread evenly, carve; the
            rims of all count.
        rims: those made from them, one a stamp; may be empty: the hull comes back.
        settings: the defaults if None.
        progress: told how much of the work is done, of how much.

    Raises:
        ValueError: fewer than two views with an outline, views from so nearly one side that they
            do not bound the object, or nothing that all of them see.
    """
    s = settings or ClosingSettings()
    carving = list(thinned(contours, _MOST_VIEWS))
    evidence = weigh(carving) if s.weighed else all_of(carving)
    left_out = tuple(carving[i].stamp_ns for i in evidence.left_out)
    rims = [rim for rim in rims if rim.stamp_ns not in left_out]
    hull = Hull(evidence.cones)
    if not hull.bounded:
        raise ValueError(
            "the views span too small an angle to close the surface: turn by 70 degrees or more"
        )
    rim_points = _some_points(rims)
    hull.slack = _noise(hull, rim_points)
    progress(20, 100)  # shares of the time, as measured
    mesh = hull.mesh(s.cells)
    progress(35, 100)
    x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    cell = float(np.ptp(x, axis=0).max()) / s.cells
    grid, faces = without_phantoms(x, faces, rim_points)
    links = mean_of_neighbours(faces, len(grid))
    x = _evened(grid, faces, links, hull, cell)
    progress(42, 100)
    samples = swept_samples(contours, rims, _SPACING * cell)
    if len(samples):
        samples = _believed(samples, hull, s.deepest * cell)
    progress(50, 100)
    if len(samples):
        target, trust, covered = _projected(x, vertex_normals(x, faces), samples, cell)
        progress(85, 100)
        x = faired(x, faces, target, trust, covered, hull, cell)
        progress(95, 100)
    x = unfolded(_held_inside(x, hull, cell), faces, links)
    x = uncrossed(x, faces, grid)
    progress(100, 100)
    return ClosedSurface(
        trimesh.Trimesh(x, faces, process=False),
        left_out,
        tuple(carving[i].stamp_ns for i in evidence.mended),
        evidence.agreement,
        tuple(view.stamp_ns for view in carving),
        evidence.undecided,
        hull.outside(x) / hull.pixel,
    )


def _some_points(rims: Sequence[Rim]) -> Array:
    """Good rim points (n, 3), a few thousand at most, from all rims."""
    points = np.concatenate([np.zeros((0, 3)), *(r.points[r.status == Status.GOOD] for r in rims)])
    return points[:: max(1, len(points) // _SOME_POINTS)]


def _noise(hull: Hull, rim_points: Array) -> float:
    """How far the silhouettes contradict each other, 1 sigma, metres.

    A rim point lies on its own cone and inside or on all others, so that without noise it
    is on the hull.
    """
    if not len(rim_points):
        return 0.0
    sigma = np.percentile(hull.outside(rim_points), _ONE_SIGMA)
    return float(np.clip(sigma, 0.0, hull.pixel))


def _evened(x: Array, faces: NDArray[np.intp], links: csr_matrix, hull: Hull, cell: float) -> Array:
    """Vertices spread evenly over the hull: marching cubes leaves slivers."""
    for _ in range(_EVENING):
        normals = vertex_normals(x, faces)
        step = links @ x - x
        step -= (step * normals).sum(axis=1)[:, None] * normals
        x = x + 0.5 * step
        x = x - np.clip(hull.outside(x), -cell, cell)[:, None] * normals
    return x


def _believed(samples: Samples, hull: Hull, deepest: float) -> Samples:
    """Samples that the hull bears out."""
    out = hull.outside(samples.points)
    keep = (out > -deepest) & (out < _REFUTED_PX * hull.pixel)
    return Samples(samples.points[keep], samples.normals[keep], samples.weights[keep])


def _projected(
    x: Array, normals: Array, samples: Samples, cell: float
) -> tuple[Array, Array, Array]:
    """Where vertices come to lie on the surface that samples show, and how far to trust it.

    Implicit moving least squares. Planes through the samples bend away from the surface on
    the one side as far as planes across the vertex' own normal do on the other: their mean
    follows curved surfaces to third order.

    Returns:
        (n, 3) places; (n,) trust, 0 to 1: 0 where no samples are near, or those that are do not
        agree; and (n,) whether some are near, 0 to 1.
    """
    tree = cKDTree(samples.points, balanced_tree=False, compact_nodes=False)
    target, n = x.copy(), normals.copy()
    covered, agreed = np.zeros(len(x)), np.ones(len(x))
    near = np.arange(len(x))
    row = np.empty((len(x), _NEIGHBOURS), np.intp)
    asked = np.full(len(x), np.inf)  # how far each has moved since its neighbours were found
    for _ in range(_PROJECTIONS):
        new = np.flatnonzero(asked > _STALE * cell)
        reach = _REACH * cell
        _, row[new] = tree.query(target[near[new]], _NEIGHBOURS, 0, 2, reach, workers=-1)
        asked[new] = 0
        shown = samples.points, samples.normals, samples.weights
        step = compiled("surface.kernels").projected(
            target[near], n[near], row, *shown, _KERNEL * cell, _FACING
        )
        some = step[0] > 1e-3
        near, row, asked, total, mean, move, aside = (
            part[some] for part in (near, row, asked, *step)
        )
        agreement = np.linalg.norm(mean, axis=1)
        n[near] = mean / agreement[:, None]
        target[near] -= move[:, None] * n[near]
        asked += np.abs(move)
        aside = aside / (_KERNEL * cell)
        covered[:] = 0
        covered[near] = np.clip(total, 0, 1) * np.clip(1.5 - aside, 0, 1)
        # About an edge sharper than the grid the samples do not speak of one surface.
        agreed[near] = np.clip((agreement - _LEAST_AGREEMENT) / (0.98 - _LEAST_AGREEMENT), 0, 1)
    agreed[np.linalg.norm(target - x, axis=1) > _FARTHEST * cell] = 0
    return target, covered * agreed, covered


def _held_inside(x: Array, hull: Hull, cell: float) -> Array:
    """Vertices outside of a silhouette pulled back on to its cone, the shortest way: along the
    sheet's normals they would cross each other where it is sharply bent."""
    x = x.copy()
    rows = np.arange(len(x))
    for _ in range(_HOLDS):
        out = hull.outside(x[rows])
        rows, out = rows[out > 0], out[out > 0]
        # By how much more outside they are per metre to each side.
        ways = _PROBE * cell * np.eye(3)
        slope = np.stack([hull.outside(x[rows] + way) - out for way in ways], axis=1)
        slope /= _PROBE * cell
        steep = np.maximum((slope * slope).sum(axis=1), 0.25)
        x[rows] -= (np.minimum(out, cell) / steep)[:, None] * slope
    return x
