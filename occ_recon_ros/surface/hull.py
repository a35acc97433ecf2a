"""The visual hull of contours as a signed field, and as a mesh on a grid that follows it.

The hull is the intersection of the cones over all silhouettes (Laurentini 1994,
doi:10.1109/34.273735). A point's signed distance to a silhouette's outline, taken on a
plane across the view and scaled by the point's depth, tells how far it is outside that
cone; the largest over all views tells how far outside the hull.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from ..geometry import Contours
from .bodies import without_specks

Array = NDArray[np.float64]

_BAND_PX = 2.5  # to either side of the outline, where the distance is exact
_BORDER_PX = 4
_MOST_PIXELS = 1500  # on a side of a silhouette's image
_LEAST_SPREAD = 0.1  # mean square sine of the angle between views and their common axis
_COARSE = 24  # cells across the longest side of the box that is searched for the object
_REFINEMENTS = 3
_FAR = 1e3
_NEAR = 3.0  # cells from the surface where a finer grid is found anew
_SIFTED = (1, 3, 7)  # after so many views, points far outside are left
_ROW = 16384  # OpenCV takes no map longer than 32767 on a side


class Cone:
    """One silhouette as an image of signed distances to its outline.

    The image lies on the plane at distance 1 across the middle viewing direction, its
    pixels as large as those of the camera. Holes of the silhouette count as outside.

    Args:
        contours: closed loops of together at least 3 samples.
    """

    def __init__(self, contours: Contours) -> None:
        self.centre = contours.centre
        middle = contours.T.mean(axis=0)
        z = middle / np.linalg.norm(middle)
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x = x / np.linalg.norm(x)
        self.axes = np.stack([x, np.cross(z, x), z])
        local = contours.T @ self.axes.T
        plane = local[:, :2] / local[:, 2:]
        low, high = plane.min(axis=0), plane.max(axis=0)
        size = float((high - low).max())
        self.pixel = max(contours.radians_per_pixel, size / _MOST_PIXELS)
        self.low = low - _BORDER_PX * self.pixel
        self.radius = 0.5 * float(np.linalg.norm(high - low))
        shape = np.ceil((high - self.low) / self.pixel).astype(int)[::-1] + _BORDER_PX + 1
        to_pixels = np.diag([1 / self.pixel, 1 / self.pixel, 1.0])
        to_pixels[:2, 2] = -self.low / self.pixel
        P = to_pixels @ self.axes
        self._P = np.column_stack([P, -P @ self.centre]).astype(np.float32)
        self.image = _distances((plane - self.low) / self.pixel, contours, tuple(shape))

    def outside(self, points: Array) -> Array:
        """How far points (n, 3) are outside the cone: (n,) float64, metres, inside
        negative. Behind the camera nothing is known: -infinity."""
        local = (points - self.centre) @ self.axes.T
        ahead = local[:, 2] > 0
        depth = np.where(ahead, local[:, 2], 1.0)
        at = (local[:, :2] / depth[:, None] - self.low) / self.pixel
        clipped = np.clip(at, 0, np.array(self.image.shape[::-1]) - 1.0)
        distance = map_coordinates(self.image, clipped.T[::-1], order=1, prefilter=False)
        distance += np.linalg.norm(at - clipped, axis=1)
        return np.where(ahead, distance * self.pixel * depth, -np.inf)

    def roughly_outside(self, xyz: NDArray[np.float32]) -> NDArray[np.float32]:
        """As ``outside`` for points (3, n) float32, good to a 50th of a pixel and many
        times faster."""
        n = xyz.shape[1]
        local = self._P[:, :3] @ xyz + self._P[:, 3:]
        ahead = local[2] > 0
        depth = np.where(ahead, local[2], np.float32(1))
        maps = np.zeros((2, -(-n // _ROW) * _ROW), np.float32)
        np.divide(local[:2], depth, out=maps[:, :n])
        height, width = self.image.shape
        u, v = maps.reshape(2, -1, _ROW)
        distance = np.empty(maps.shape[1], np.float32)
        for first in range(0, len(u), _ROW):
            part = slice(first, first + _ROW)
            near = cv2.remap(
                self.image, u[part], v[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            distance[first * _ROW : first * _ROW + near.size] = near.ravel()
        u, v = maps[:, :n]
        off_u = np.maximum(np.maximum(-u, u - (width - 1)), 0)
        off_v = np.maximum(np.maximum(-v, v - (height - 1)), 0)
        distance = (distance[:n] + np.maximum(off_u, off_v)) * depth * np.float32(self.pixel)
        return np.where(ahead, distance, np.float32(-_FAR))


def _distances(xy: Array, contours: Contours, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Image of signed distances to closed loops with corners xy (n, 2), in its pixels.

    Exact to either side of the outline, and within a few hundredths of a pixel beyond.
    """
    starts = contours.loop_starts
    shift = 8
    loops = [np.round(xy[a:b] * 2**shift).astype(np.int32) for a, b in pairwise(starts)]
    filled = np.zeros(shape, np.uint8)
    cv2.fillPoly(filled, loops, 1, shift=shift)
    into = cv2.distanceTransform(filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    out = cv2.distanceTransform(1 - filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    image = np.where(filled > 0, 0.5 - into, out - 0.5).astype(np.float32)
    v, u = np.nonzero(np.abs(image) < _BAND_PX)
    image[v, u] = _to_outline(np.column_stack([u, v]).astype(np.float64), xy, contours)
    return image


def _to_outline(points: Array, xy: Array, contours: Contours) -> Array:
    """Signed distance (n,) of points (n, 2) to the polygon, outside positive."""
    row = cKDTree(xy).query(points)[1]
    before = contours.previous_row
    # Two sides meet at the nearest corner; one of them is nearest but in odd cases.
    ways = [_to_side(points, xy, first, contours.next_row) for first in (row, before[row])]
    (d0, s0), (d1, s1) = ways
    nearest = np.minimum(d0, d1)
    # At the corner itself both sides count: the point is outside of the sharper.
    both = np.abs(d0 - d1) < 1e-9
    side = np.where(d0 < d1, s0, s1)
    side = np.where(both, s0 + s1, side)
    result: Array = np.copysign(nearest, side)
    return result


def _to_side(
    points: Array, xy: Array, first: NDArray[np.intp], after: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Distances to sides that start at rows, and a number positive outside them."""
    a = xy[first]
    along = xy[after[first]] - a
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    away = points - a
    part = np.clip((away * along).sum(axis=1) / length**2, 0, 1)
    distance = np.linalg.norm(away - part[:, None] * along, axis=1)
    turn = (along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / length
    return distance, turn


class Hull:
    """The visual hull of contours.

    Args:
        contours: of at least two views with an outline.
        slack: how far outside a silhouette still counts as inside, metres: with poses that
            are not quite right, cones that should touch an edge cut it off.

    Raises:
        ValueError: fewer than two such views.
    """

    def __init__(self, contours: Sequence[Contours], slack: float = 0.0) -> None:
        seen = [c for c in contours if len(c) >= 3]
        if len(seen) < 2:
            raise ValueError("a hull needs the contours of at least two views")
        self.slack = slack
        self.cones = [Cone(c) for c in seen]
        quarter = max(len(seen) // 4, 1)
        stride = next(k for k in range(quarter, 0, -1) if np.gcd(k, len(seen)) == 1)
        self._spread = [self.cones[i * stride % len(seen)] for i in range(len(seen))]

    def outside(self, points: Array) -> Array:
        """How far points (n, 3) are outside the hull: (n,) float64, metres, inside
        negative."""
        return np.max([cone.outside(points) for cone in self.cones], axis=0) - self.slack

    def roughly_outside(self, points: Array) -> Array:
        """As ``outside``, good to a 50th of a pixel and many times faster."""
        xyz = np.ascontiguousarray(points.T, np.float32)
        worst = np.max([cone.roughly_outside(xyz) for cone in self.cones], axis=0)
        return worst.astype(np.float64) - self.slack

    @property
    def pixel(self) -> float:
        """What a pixel covers at the object, metres, in the middle of the views."""
        middle = self._middle()
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

    def _middle(self) -> Array:
        """(3,) the point nearest to all middle viewing rays."""
        centres = np.array([cone.centre for cone in self.cones])
        looks = np.array([cone.axes[2] for cone in self.cones])
        across = np.eye(3) - looks[:, :, None] * looks[:, None, :]
        b = np.einsum("nij,nj->ni", across, centres).ravel()
        middle: Array = np.linalg.lstsq(across.reshape(-1, 3), b, rcond=None)[0]
        return middle

    def _box(self) -> tuple[Array, Array]:
        """Corners (3,) of a box about the hull, a little too large."""
        centres, middle = np.array([cone.centre for cone in self.cones]), self._middle()
        away = np.linalg.norm(centres - middle, axis=1)
        half = 1.5 * float(np.median([c.radius * d for c, d in zip(self.cones, away, strict=True)]))
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
        xyz = (low[:, None] + at * step).astype(np.float32)
        worst = np.full(xyz.shape[1], -_FAR, np.float32)
        rows = np.arange(len(worst))
        # Views far from each other first: most points outside are found out by a few.
        for k, cone in enumerate(self._spread):
            worst[rows] = np.maximum(worst[rows], cone.roughly_outside(xyz))
            if k in _SIFTED:
                kept = worst[rows] <= 4 * step + self.slack
                rows, xyz = rows[kept], np.ascontiguousarray(xyz[:, kept])
        return worst - np.float32(self.slack)
