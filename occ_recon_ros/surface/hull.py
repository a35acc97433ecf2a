"""The visual hull of contours as a signed field, and as a mesh on a grid that follows it.

The hull is the intersection of the cones over all silhouettes (Laurentini 1994,
doi:10.1109/34.273735). A point's signed distance to a silhouette's outline, taken on a
plane across the view and scaled by the point's depth, tells how far it is outside that
cone; the largest over all views tells how far outside the hull. What no view shows, beyond
the borders of their images, is not there.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from ..geometry import Contours
from ..geometry.arrays import Array
from .bodies import without_specks
from .cone import Cone, middle_of

_LEAST_SPREAD = 0.1  # mean square sine of the angle between views and their common axis
_COARSE = 24  # cells across the longest side of the box that is searched for the object
_REFINEMENTS = 3
_FAR = 1e3
_NEAR = 3.0  # cells from the surface where a finer grid is found anew
_LEAST_SEEN = 0.5  # of the views have a point in their images, at least


class Hull:
    """The visual hull of contours.

    Args:
        views: contours or cones of at least two views with an outline.

    Attributes:
        slack: how far outside a silhouette still counts as inside, metres: with poses that
            are not quite right, cones that should touch an edge cut it off.

    Raises:
        ValueError: fewer than two such views.
    """

    def __init__(self, views: Sequence[Contours] | Sequence[Cone]) -> None:
        seen = [
            v if isinstance(v, Cone) else Cone(v)
            for v in views
            if isinstance(v, Cone) or len(v) > 2
        ]
        if len(seen) < 2:
            raise ValueError("a hull needs the contours of at least two views")
        self.slack = 0.0
        self.cones = seen
        quarter = max(len(seen) // 4, 1)
        stride = next(k for k in range(quarter, 0, -1) if np.gcd(k, len(seen)) == 1)
        self._spread = [self.cones[i * stride % len(seen)] for i in range(len(seen))]

    def outside(self, points: Array) -> Array:
        """How far points (n, 3) are outside the hull: (n,) float64, metres, inside
        negative."""
        worst = np.full(len(points), -np.inf)
        for cone in self.cones:
            cone.raise_to(points, worst)
        return np.maximum(worst - self.slack, self._unseen(points))

    def _unseen(self, points: Array) -> Array:
        """How far points (n, 3) are beyond what enough images have in them: (n,) float64,
        metres, within negative."""
        cut = [cone for cone in self.cones if cone.cut]
        enough = max(2, int(np.ceil(_LEAST_SEEN * len(self.cones))))
        lacking = enough - (len(self.cones) - len(cut))
        if lacking <= 0:
            return np.full(len(points), -np.inf)
        beyond = np.array([cone.beyond(points) for cone in cut])
        farther: Array = np.partition(beyond, lacking - 1, axis=0)[lacking - 1]
        return farther

    @property
    def pixel(self) -> float:
        """What a pixel covers at the object, metres, in the middle of the views."""
        middle, _ = middle_of(self.cones)
        sizes = [c.pixel * np.linalg.norm(c.centre - middle) for c in self.cones]
        return float(np.median(sizes))

    @property
    def bounded(self) -> bool:
        """Whether the views look from different enough sides for the cones to end: an arc of
        some 70 degrees, say. Along the common direction of fewer the hull is a long spike."""
        looks = np.array([cone.axes[2] for cone in self.cones])
        spread = 1 - np.linalg.eigvalsh(looks.T @ looks / len(looks))[-1]
        return bool(spread >= _LEAST_SPREAD)

    def mesh(self, cells: int) -> trimesh.Trimesh:
        """The hull's surface by marching cubes (Lewiner et al. 2003,
        doi:10.1080/10867651.2003.10487582).

        Args:
            cells: grid cells along the longest side of the hull.

        Raises:
            ValueError: the silhouettes have no volume in common that the grid could see.
        """
        low, high = self._box()
        cell = float((high - low).max()) / cells
        step = cell * 2**_REFINEMENTS
        counts = np.ceil((high - low) / step).astype(int) + 2
        low = low - 0.5 * (counts * step - (high - low))
        field = self._field(low, step, counts)
        for _ in range(_REFINEMENTS):
            step /= 2
            field = self._refined(field, low, step)
        if field.min() >= 0:
            raise ValueError("the silhouettes have no volume in common")
        field = np.clip(field, -4 * step, 4 * step)
        field[np.abs(field) < 1e-6 * step] = 1e-6 * step
        # Where the cones reach past the box, it closes them.
        field = np.pad(field, 1, constant_values=step)
        vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
        vertices = low + (vertices.astype(np.float64) - 1) * step
        return trimesh.Trimesh(*without_specks(vertices, faces), process=False)

    def _box(self) -> tuple[Array, Array]:
        """Corners (3,) of a box about the hull, a little too large."""
        middle, radius = middle_of(self.cones)
        half = 1.5 * radius
        low, high = middle - half, middle + half
        for _ in range(2):
            step = float((high - low).max()) / _COARSE
            counts = np.ceil((high - low) / step).astype(int)
            field = self._field(low, step, counts)
            near = np.argwhere(field < np.sqrt(3) / 2 * step)
            if not len(near):
                raise ValueError("the silhouettes have no volume in common")
            low, high = low + (near.min(axis=0) - 1) * step, low + (near.max(axis=0) + 1) * step
        return low, high

    def _field(self, low: Array, step: float, counts: NDArray[np.intp]) -> NDArray[np.float32]:
        at = np.indices(tuple(int(n) + 1 for n in counts)).reshape(3, -1)
        return self._rough(low, at, step).reshape(counts + 1)

    def _refined(self, field: NDArray[np.float32], low: Array, step: float) -> NDArray[np.float32]:
        """The field at twice the resolution, found anew where the surface may be."""
        for axis in range(3):
            f = np.moveaxis(field, axis, 0)
            finer = np.empty((2 * len(f) - 1, *f.shape[1:]), np.float32)
            finer[::2] = f
            finer[1::2] = 0.5 * (f[1:] + f[:-1])
            field = np.moveaxis(finer, 0, axis)
        field = np.ascontiguousarray(field)
        near = np.flatnonzero(np.abs(field) < _NEAR * step)
        at = np.array(np.unravel_index(near, field.shape))
        field.ravel()[near] = self._rough(low, at, step)
        return field

    def _rough(self, low: Array, at: NDArray[np.intp], step: float) -> NDArray[np.float32]:
        """How far grid points at (3, n) are outside, once it is more than 4 cells."""
        points = low + at.T * step
        worst = np.full(len(points), -np.inf)
        # Views far from each other first: most points outside are found out by a few.
        for cone in self._spread:
            cone.raise_to(points, worst, 4 * step + self.slack)
        found = np.maximum(worst - self.slack, self._unseen(points))
        return np.maximum(found, -_FAR).astype(np.float32)
