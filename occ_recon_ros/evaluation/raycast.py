"""What the rays of a camera meet, by Embree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array

_MARGIN_PX = 2.0


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays first meet a surface, one row a ray that meets it.

    Attributes:
        ray: (k,) intp, row of the ray.
        triangle: (k,) intp.
        weights: (k, 3) float64, barycentric, of the triangle's corners.
    """

    ray: NDArray[np.intp]
    triangle: NDArray[np.intp]
    weights: Array


class RayCaster:
    """Triangles that rays are cast at.

    Args:
        corners: (m, 3, 3) float, metres, object frame: triangle, corner, xyz.
    """

    def __init__(self, corners: NDArray) -> None:
        self.corners = np.asarray(corners, np.float64)
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        soup = trimesh.Trimesh(self.corners.reshape(-1, 3), faces, process=False)
        self._intersector = RayMeshIntersector(soup)

    def cast(self, camera: Camera, uv: Array) -> Hits:
        """What is seen at image points (n, 2), pixels in the image as received (distorted)."""
        near = np.flatnonzero(self._in_box(camera, uv))
        T = camera.viewing_directions(uv[near])
        origin = np.broadcast_to(camera.centre, T.shape)
        triangle = np.asarray(self._intersector.intersects_first(origin, T), np.intp)
        met = np.flatnonzero(triangle >= 0)
        weights = _weights(self.corners[triangle[met]] - camera.centre, T[met])
        return Hits(near[met], triangle[met], weights)

    def _in_box(self, camera: Camera, uv: Array) -> NDArray[np.bool_]:
        """(n,) whether image points lie in the box about the surface: others need no ray. A few
        rays cost less than to look for it."""
        near = np.ones(len(uv), bool)
        if len(uv) < self.corners.size // 3:
            return near
        for seen, asked in zip(camera.project(self.corners.reshape(-1, 3)).T, uv.T, strict=True):
            low, high = seen.min() - _MARGIN_PX, seen.max() + _MARGIN_PX
            if np.isfinite(high - low):  # no part of it is behind the camera
                near &= (asked >= low) & (asked <= high)
        return near

    def silhouette(self, camera: Camera) -> NDArray[np.bool_]:
        """(height, width) the pixels at whose centre the surface is seen."""
        return self.seen(camera)[0]

    def seen(self, camera: Camera) -> tuple[NDArray[np.bool_], Array]:
        """The silhouette, and (height, width, 3) the points that are seen at the centres of its
        pixels, metres; NaN beside it."""
        v, u = np.mgrid[: camera.height, : camera.width]
        hits = self.cast(camera, np.column_stack([u.ravel(), v.ravel()]).astype(float))
        points = np.full((u.size, 3), np.nan)
        points[hits.ray] = np.einsum("kc,kcj->kj", hits.weights, self.corners[hits.triangle])
        covered = np.zeros(u.size, bool)
        covered[hits.ray] = True
        return covered.reshape(u.shape), points.reshape(*u.shape, 3)


def mean_iou(pairs: Sequence[tuple[NDArray[np.bool_], NDArray[np.bool_]]]) -> float:
    """Of silhouettes (h, w) two by two, in the mean; 0 of two that are empty."""
    return float(np.mean([(a & b).sum() / max((a | b).sum(), 1) for a, b in pairs]))


def _weights(corners: Array, T: Array) -> Array:
    """(k, 3) barycentric weights of rays T from the origin in triangles (k, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = np.stack(
        [np.einsum("kj,kj->k", T, np.cross(p, q)) for p, q in ((b, c), (c, a), (a, b))], axis=1
    )
    total = volumes.sum(axis=1, keepdims=True)
    weights = np.clip(volumes / np.where(total == 0, 1, total), 0, 1)
    total = weights.sum(axis=1, keepdims=True)
    return np.where(total > 0, weights / np.maximum(total, 1e-300), 1 / 3)
