"""The space that all views look at, and a grid of voxels in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ...geometry import Camera
from ...geometry.arrays import Array, nearest_to_rays
from .each import each

_ALONG = 48  # voxels, in which the space that the views share is looked for
_PARALLEL = 1e-3  # radians
_SEEN = 0.7  # of the views must see a point that may belong to the object
_SLENDER = 0.5  # of the voxels of a cube: a box that has less of it is cut into smaller ones


@dataclass(frozen=True)
class Grid:
    """Voxels of a box.

    Attributes:
        low: (3,) float64, corner of the box, metres, object frame.
        size: edge of a voxel, metres.
        shape: number of voxels along x, y and z.
    """

    low: Array
    size: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(low: Array, high: Array, along: int) -> Grid:
        """A box in voxels, ``along`` of them along its longest side; more of a slender one, whose
        legs and spikes are thin beside its length."""
        sides = high - low
        size = float(sides.max()) / along
        size = min(size, float(sides.prod() / _SLENDER) ** (1 / 3) / along)
        counts = np.maximum(2, np.ceil((high - low) / size - 1e-6)).astype(int)
        return Grid(low, size, (int(counts[0]), int(counts[1]), int(counts[2])))

    def centres(self) -> Array:
        """(n, 3) float64, metres, in the order of a flattened array of ``shape``."""
        axes = [self.low[k] + self.size * (np.arange(self.shape[k]) + 0.5) for k in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def pixels(self, camera: Camera) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """``pixel_of`` the centres, much faster where the lens does not distort."""
        if len(camera.D):
            return pixel_of(camera, self.centres())
        P = camera.K @ np.column_stack([camera.R_camera_object, camera.t_camera_object])
        axes = [self.low[k] + self.size * (np.arange(self.shape[k]) + 0.5) for k in range(3)]
        u, v, w = (
            (
                (row[0] * axes[0] + row[3]).astype(np.float32)[:, None, None]
                + (row[1] * axes[1]).astype(np.float32)[:, None]
                + (row[2] * axes[2]).astype(np.float32)
            ).ravel()
            for row in P
        )
        before = w > 0
        w[~before] = 1.0
        u /= w
        v /= w
        inside = before & (u > -0.5) & (u < camera.width - 0.5)
        inside &= (v > -0.5) & (v < camera.height - 0.5)
        u[~inside] = v[~inside] = 0.0  # beside the camera they may be too large for an integer
        index = np.rint(v).astype(np.int32) * np.int32(camera.width) + np.rint(u).astype(np.int32)
        return index, inside

    def box_of(self, body: NDArray[np.bool_], margin: float) -> tuple[Array, Array]:
        """Lowest and highest corner of the occupied voxels and ``margin`` voxels more."""
        at = np.argwhere(body)
        low = self.low + self.size * (at.min(axis=0) - margin)
        return low, self.low + self.size * (at.max(axis=0) + 1 + margin)


def fixation(cameras: Sequence[Camera]) -> Array:
    """(3,) float64, the point nearest to all optical axes, metres, object frame.

    The axes are those through the middle of each image, for an image may have been cut out
    of a larger one. Parallel axes have no such point: the one nearest to the cameras' own
    centre is taken.
    """
    axes = optical_axes(cameras)
    centres = np.stack([c.centre for c in cameras])
    middle = centres.mean(axis=0)
    return middle + nearest_to_rays(centres - middle, axes, _PARALLEL)


def optical_axes(cameras: Sequence[Camera]) -> Array:
    """(n, 3) float64, unit viewing directions through the middle of each image, object frame."""
    return np.concatenate(
        [c.viewing_directions(np.array([[0.5 * c.width, 0.5 * c.height]])) for c in cameras]
    )


def usual_distance(cameras: Sequence[Camera]) -> float:
    """Distance of the cameras from their ``fixation``, metres, in the median."""
    centre = fixation(cameras)
    return float(np.median([np.linalg.norm(camera.centre - centre) for camera in cameras]))


def shared_space(cameras: Sequence[Camera]) -> tuple[Array, Array]:
    """Lowest and highest corner of the space that most views see.

    Raises:
        ValueError: no_common_space, where the views have none.
    """
    centre = fixation(cameras)
    reach = usual_distance(cameras)
    if not np.isfinite(reach) or reach <= 0:
        raise ValueError("the views look at no common space")
    for half in (0.9 * reach, 0.45 * reach, 0.2 * reach, 0.08 * reach, 0.03 * reach):
        grid = Grid.around(centre - half, centre + half, _ALONG)
        seen = np.zeros(int(np.prod(grid.shape)), np.int32)
        for camera in cameras:
            seen += grid.pixels(camera)[1]
        inside = (seen >= _SEEN * len(cameras)).reshape(grid.shape)
        if not inside.any():
            continue
        low, high = grid.box_of(inside, 0.5)
        if (high - low).max() > 0.5 * half:
            return low, high
    raise ValueError("the views look at no common space")


def pixel_of(camera: Camera, points: Array) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Flat index (n,) int32 of the pixel on which points fall (0 where none), and (n,) whether
    they fall into the image."""
    with np.errstate(invalid="ignore", over="ignore"):
        u, v = camera.project(points).T
        inside = (u > -0.5) & (v > -0.5) & (u < camera.width - 0.5) & (v < camera.height - 0.5)
    u, v = (np.rint(np.where(inside, c, 0.0)).astype(np.int32) for c in (u, v))
    return v * np.int32(camera.width) + u, inside


def silhouette(grid: Grid, body: NDArray[np.bool_], camera: Camera) -> NDArray[np.float32]:
    """``silhouettes`` in one view."""
    return silhouettes(grid, body, [camera])[0]


def silhouettes(
    grid: Grid, body: NDArray[np.bool_], cameras: Sequence[Camera]
) -> list[NDArray[np.float32]]:
    """Of each view, (h, w) float32, about the share of each pixel that occupied voxels cover.

    Only the voxels on the surface are drawn, each by eight points on a raster that is as
    coarse as they are, and what they enclose is not seen through: it is occupied too.
    """
    at = np.argwhere(body & ~_enclosed(body))
    if not len(at):
        return [np.zeros((c.height, c.width), np.float32) for c in cameras]
    middle = grid.low + grid.size * (at.mean(axis=0) + 0.5)
    parts = np.stack(np.meshgrid(*[(0.25, 0.75)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = grid.low + grid.size * (at[:, None, :] + parts).reshape(-1, 3)

    def drawn_in(camera: Camera) -> NDArray[np.float32]:
        away = float((camera.R_camera_object @ middle + camera.t_camera_object)[2])
        footprint = grid.size * float(camera.K[0, 0]) / max(away, 1e-9)
        scale = min(1.0, 1.3 / max(footprint, 1e-9))
        width, height = (max(1, round(scale * n)) for n in (camera.width, camera.height))
        small = camera.resized(width, height)
        index, inside = pixel_of(small, points)
        drawn = np.zeros(width * height, np.uint8)
        drawn[index[inside]] = 255
        closed = cv2.morphologyEx(
            drawn.reshape(height, width), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
        )
        soft = cv2.resize(closed, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)
        return soft.astype(np.float32) / np.float32(255)

    return each(drawn_in, cameras)


def convex_hull(body: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The voxels (nx, ny, nz) within the convex hull of a body; of a few that have no inside, the
    body. All against all faces take gigabytes: each column of voxels is cut by one after another.
    """
    try:
        faces = ConvexHull(np.argwhere(body), qhull_options="QJ").equations
    except QhullError:
        return body
    x, y = np.ogrid[: body.shape[0], : body.shape[1]]
    top, bottom = np.full((2, *body.shape[:2]), np.inf)
    bottom = -bottom
    for a, b, c, d in faces:
        end = -(a * x + b * y + d) / (c or np.finfo(float).tiny)
        if c < 0:
            np.maximum(bottom, end, out=bottom)
        else:
            np.minimum(top, end, out=top)
    z = np.arange(body.shape[2])
    inside: NDArray[np.bool_] = (z >= bottom[..., None]) & (z <= top[..., None])
    return inside | body


def _enclosed(body: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Voxels whose six neighbours are occupied."""
    p, inner = np.pad(body, 1), slice(1, -1)
    return np.asarray(
        p[:-2, inner, inner] & p[2:, inner, inner]
        & p[inner, :-2, inner] & p[inner, 2:, inner]
        & p[inner, inner, :-2] & p[inner, inner, 2:]
    )  # fmt: skip
