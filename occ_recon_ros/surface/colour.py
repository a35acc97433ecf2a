"""Colour of a surface, from the views that see each place most frontally."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

from ..geometry import Camera
from ..geometry.arrays import Array, sampled

Colours = NDArray[np.uint8]

_MOST_VIEWS = 48
_APART = np.cos(np.radians(8.0))  # views that look along nearer axes tell little more
_FRONTAL = 16  # power of the cosine: a view at 17 degrees counts half
_NEARLY_BEST = 0.8  # of the best cosine
_GRAZING = 0.03  # cosine that places seen edge-on, or a little from behind, still get
_INWARD_PX = 2.0
_EDGE_ON = 0.3  # cosine
_CELLS = 256  # of a depth map along the width of the image
_SAMPLES_A_CELL = 4.0
_STEEPEST = 0.1  # cosine
_UNSEEN = 128


@dataclass(eq=False)
class _View:
    """An image, and how far away the surface is in cells of it."""

    pixels: Colours
    camera: Camera
    depth: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def cell_px(self) -> float:
        return self.camera.width / _CELLS

    def cells(self, uv: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """Row and column of image points (n, 2), and whether they are in the image."""
        size = np.array([self.camera.width, self.camera.height])
        inside = np.asarray(((uv > -0.5) & (uv < size - 0.5)).all(axis=1))
        cell = np.where(inside[:, None], (uv + 0.5) / self.cell_px, 0).astype(np.intp)
        return cell[:, 1], cell[:, 0], inside


class ViewColours:
    """A bounded number of views, spread over the directions they look along.

    Memory: at most 48 images as they are handed in.
    """

    def __init__(self) -> None:
        self._views: list[_View] = []

    def __len__(self) -> int:
        return len(self._views)

    @property
    def nbytes(self) -> int:
        """Memory of the images, bytes."""
        return sum(view.pixels.nbytes for view in self._views)

    def kept(self) -> Iterator[tuple[Colours, Camera]]:
        """The views: image, (h, w, 3) uint8, and camera."""
        return ((view.pixels, view.camera) for view in self._views)

    def wants(self, camera: Camera) -> bool:
        """Whether a view would tell more than those that are there."""
        return bool((self._axes() @ camera.R_camera_object[2] < _APART).all())

    def add(self, image: NDArray[np.uint8], camera: Camera) -> None:
        """Keep a view. If there are too many, one goes that looks nearly as another does.

        Args:
            image: (h, w, 3) uint8, red green blue; kept, not copied.
            camera: its calibrated view.

        Raises:
            ValueError: the image is not of that shape, or not of the camera's size.
        """
        if image.shape != (camera.height, camera.width, 3) or image.dtype != np.uint8:
            raise ValueError(f"colour needs (h, w, 3) uint8, got {image.shape} {image.dtype}")
        self._views.append(_View(image, camera))
        if len(self._views) > _MOST_VIEWS:
            alike = self._axes() @ self._axes().T - 2 * np.eye(len(self._views))
            del self._views[int(alike.max(axis=1).argmax())]

    def _axes(self) -> Array:
        return np.array([v.camera.R_camera_object[2] for v in self._views]).reshape(-1, 3)

    def hide_behind(self, corners: NDArray) -> None:
        """Take a surface for what hides places from the views, from now on.

        Args:
            corners: (m, 3, 3) float, metres: triangle, corner, xyz.
        """
        corners = np.asarray(corners, np.float64)
        if not len(corners) or not self._views:
            return
        middle = corners.reshape(-1, 3).mean(axis=0)
        spacing = min(
            float(_metres_per_pixel(v.camera, middle)[0]) * v.cell_px for v in self._views
        )
        points = _scattered(corners, spacing / np.sqrt(_SAMPLES_A_CELL))
        for view in self._views:
            rows = int(np.ceil(view.camera.height / view.cell_px))
            depth = np.full((rows + 1, _CELLS + 1), np.inf)
            row, column, inside = view.cells(view.camera.project(points))
            away = np.linalg.norm(points - view.camera.centre, axis=1)
            np.minimum.at(depth, (row[inside], column[inside]), away[inside])
            view.depth = minimum_filter(depth, 3, mode="nearest")

    def of(self, points: NDArray, normals: NDArray) -> Colours:
        """Colours of places on the surface.

        Each is the mean over the views that see it, those that look at it most frontally
        counting most by far. A place at the edge of all views so far takes the colour just
        inside that edge; one that no view sees takes that of the nearest place seen.

        Args:
            points: (n, 3) float, metres, object frame.
            normals: (n, 3) float, outward unit normals.

        Returns:
            (n, 3) uint8, red green blue; grey where nothing is seen at all.
        """
        points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
        total, weight = np.zeros((len(points), 3)), np.zeros(len(points))
        cosines = [_cosine(view, points, normals) for view in self._views]
        best = np.max(cosines, axis=0, initial=0)
        # Other views hardly count where the best are not blocked.
        for least in (_NEARLY_BEST * best, np.full(len(points), -_GRAZING)):
            unseen = weight == 0
            for view, cosine in zip(self._views, cosines, strict=True):
                rows = np.flatnonzero(unseen & (cosine > least))
                rows, w, colour = _seen(view, points, normals, cosine, rows)
                weight[rows] += w
                total[rows] += w[:, None] * colour
        seen = weight > 0
        if not seen.any():
            return np.full((len(points), 3), _UNSEEN, np.uint8)
        colours = total / np.where(seen, weight, 1)[:, None]
        if not seen.all():
            nearest = cKDTree(points[seen]).query(points[~seen])[1]
            colours[~seen] = colours[seen][nearest]
        return colours.round().astype(np.uint8)


def reduced_camera(camera: Camera, width: int, height: int) -> Camera:
    """The camera of an image that is reduced to another size, pixel centres at whole numbers."""
    return camera.resized(width, height)


def _cosine(view: _View, points: Array, normals: Array) -> Array:
    """(n,) how frontally a view looks at places."""
    to_camera = view.camera.centre - points
    across = np.einsum("nk,nk->n", to_camera, normals)
    return np.asarray(across / np.linalg.norm(to_camera, axis=1))


def _seen(
    view: _View, points: Array, normals: Array, cosine: Array, rows: NDArray[np.intp]
) -> tuple[NDArray[np.intp], Array, Array]:
    """Those of the rows that a view sees, their weights (k,) and colours (k, 3)."""
    camera, points, normals, cosine = view.camera, points[rows], normals[rows], cosine[rows]
    pixel = _metres_per_pixel(camera, points)
    # Just inside the edge where a place is seen edge-on: at the edge colours are mixed.
    inward = _INWARD_PX * pixel * np.clip(1 - cosine / _EDGE_ON, 0, 1)
    uv = camera.project(points - inward[:, None] * normals)
    row, column, good = view.cells(uv)
    if view.depth.size:
        steep = np.maximum(cosine, _STEEPEST)
        slack = view.cell_px * pixel * (1 + 1.5 * np.sqrt(1 - steep**2) / steep)
        away = np.linalg.norm(points - camera.centre, axis=1)
        good &= away - slack <= view.depth[row, column]
    colour = sampled(view.pixels, *uv[good].T)
    return rows[good], np.maximum(cosine[good], _GRAZING) ** _FRONTAL, colour


def _metres_per_pixel(camera: Camera, points: Array) -> Array:
    z = np.atleast_2d(points) @ camera.R_camera_object[2] + camera.t_camera_object[2]
    return np.asarray(np.abs(z) / camera.K[0, 0])


def _scattered(corners: Array, spacing: float) -> Array:
    """Points over triangles, about one to each square of a spacing, by area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    share = np.cumsum(0.5 * np.linalg.norm(across, axis=1)) / spacing**2
    count = np.diff(np.floor(share), prepend=0).astype(np.intp)
    triangle = np.repeat(np.arange(len(corners)), count)
    # A sequence that fills the unit square evenly, folded on to the triangle.
    k = np.arange(len(triangle))
    s, t = (k * 0.7548776662466927) % 1, (k * 0.5698402909980532) % 1
    fold = s + t > 1
    s, t = np.where(fold, 1 - s, s)[:, None], np.where(fold, 1 - t, t)[:, None]
    a, b, c = (corners[triangle, i] for i in range(3))
    return np.asarray(a + s * (b - a) + t * (c - a))
