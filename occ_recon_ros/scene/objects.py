"""Solids with smooth parts, of which everything is known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, axes_along

from .part import Part
from .silhouette import Silhouette, silhouette

if TYPE_CHECKING:
    import trimesh

_NORMAL_WEIGHT_PX = 5.0
_FACING_PX = 600.0


@dataclass(frozen=True)
class SceneObject:
    """The union of closed parts, in the object frame.

    Attributes:
        name: what it is called.
        parts: the closed surfaces whose union it is; whatever has the methods of a ``Part``.
    """

    name: str
    parts: tuple[Part, ...]

    def silhouette(self, camera: Camera, spacing_px: float = 1.0) -> Silhouette:
        """The visible occluding contour and its rim, see ``silhouette.silhouette``."""
        return silhouette(self.parts, camera, spacing_px)

    def exact_contours(
        self,
        camera: Camera,
        spacing_px: float = 1.0,
        stamp_ns: int = 0,
        sigma_px: float = 0.01,
    ) -> Contours:
        """The occluding contours that bound the silhouette, without an image.

        Directions and normals are those of the true rim to rounding error; a loop that
        the image border cuts keeps its samples inside the image.

        Args:
            camera: the view.
            spacing_px: distance of samples along the contour.
            stamp_ns: as in Contours; the frame is "turntable".
            sigma_px: what to declare as the contour's 1 sigma; samples beside a corner
                of the outline (a T-junction) get infinity.

        Raises:
            ValueError: the camera is inside the object or has it not wholly in front.
        """
        s = self.silhouette(camera, spacing_px)
        size = np.array([camera.width, camera.height])
        inside = ((s.uv >= -0.5) & (s.uv <= size - 0.5)).all(1)
        uv, N = s.uv[inside], s.normals[inside]
        T = s.points[inside] - camera.centre
        T /= np.linalg.norm(T, axis=1, keepdims=True)
        sigma = np.where(s.corner[inside], np.inf, sigma_px * _pixel_angle(camera, uv, T, N))
        return Contours(stamp_ns, "turntable", camera.centre, T, N, uv, s.loop[inside], sigma)

    def exact_depth(self, contours: Contours) -> tuple[Array, Array]:
        """True rim depth and curvature of rays that graze the object.

        Args:
            contours: rays near the visible occluding contour, exact or measured.

        Returns:
            depth: (n,) metres along T from the camera centre to the place where the ray
                touches (or comes nearest to) the surface.
            k_t: (n,) normal curvature there along T, 1/m, positive where convex.
        """
        camera = _facing(contours.centre, contours.T)
        rim = self.silhouette(camera)
        rim_T = rim.points - contours.centre
        rim_T /= np.linalg.norm(rim_T, axis=1, keepdims=True)
        # Beside a T-junction two rims share a direction, and the normal tells them apart.
        known = cKDTree(np.hstack([camera.K[0, 0] * rim_T, _NORMAL_WEIGHT_PX * rim.normals]))
        wanted = np.hstack([camera.K[0, 0] * contours.T, _NORMAL_WEIGHT_PX * contours.N])
        nearest = known.query(wanted)[1]
        depth, k_t = np.zeros(len(contours)), np.zeros(len(contours))
        for number, part in enumerate(self.parts):
            mine = rim.part[nearest] == number
            if not mine.any():
                continue
            T = contours.T[mine]
            start = rim.points[nearest[mine]]
            depth[mine], k_t[mine] = part.graze(contours.centre, T, start)
        return depth, k_t

    def distance(self, points: Array) -> Array:
        """Signed distance to the surface, outside positive.

        Exact to rounding outside and near the surface of one part; deep inside several
        parts at once it is the distance to the deepest one's surface.

        Args:
            points: (n, 3) float64, metres, object frame.

        Returns:
            (n,) float64, metres.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        if len(self.parts) == 1:
            return self.parts[0].distance(points)
        least, nearest = self._asked(points, lambda part, at: part.bounds(at))
        found = np.full(len(points), np.inf)
        for part, below in zip(self.parts, least, strict=True):
            # Where it may be the nearest, or the deepest of those that a point is in.
            mine = (below <= nearest) | part.inside(points)
            found[mine] = np.minimum(found[mine], part.distance(points[mine]))
        return found

    def _asked(
        self, points: Array, ask: Callable[[Part, Array], tuple[Array, Array]]
    ) -> tuple[Array, Array]:
        """What the distances (parts, n) of points (n, 3) to each part are not below, infinite where
        another is nearer for certain, and what the least of them (n,) is not above.

        ``ask``: bounds of the distance to a part, from below and from above.
        """
        beyond = np.array([part.beyond(points) for part in self.parts])
        first, nearest = beyond.argmin(axis=0), np.full(len(points), np.inf)
        least = np.full(beyond.shape, np.inf)
        for likely in (True, False):
            for k, part in enumerate(self.parts):
                asked = (first == k) if likely else (first != k) & (beyond[k] <= nearest)
                least[k, asked], above = ask(part, points[asked])
                nearest[asked] = np.minimum(nearest[asked], above)
        return least, nearest

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) lie inside."""
        return np.any([part.inside(points) for part in self.parts], axis=0)

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Normals and shape operators at points on the surface.

        Args:
            points: (n, 3) float64, metres, object frame.

        Returns:
            normals: (n, 3) float64, outward unit normals.
            S: (n, 3, 3) float64, 1/m: v . S v is the normal curvature along a unit
                tangent v, positive where convex.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        away, _ = self._asked(points, lambda part, at: (np.abs(part.distance(at)),) * 2)
        owner = away.argmin(axis=0)
        normals, S = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
        for number, part in enumerate(self.parts):
            mine = owner == number
            normals[mine], S[mine] = part.shape(points[mine])
        return normals, S

    def surface_samples(self, resolution: int = 256) -> tuple[Array, Array]:
        """Points on the true surface, those inside other parts left out, and normals.

        Args:
            resolution: samples around each part.

        Returns:
            points, normals: (n, 3) float64, metres and unit vectors, object frame.
        """
        points, normals = [], []
        for part in self.parts:
            vertices, _ = part.grid(resolution)
            free = np.ones(len(vertices), bool)
            for other in self.parts:
                if other is not part:
                    free &= ~other.inside(vertices)
            points.append(vertices[free])
            normals.append(part.shape(vertices[free])[0])
        return np.concatenate(points), np.concatenate(normals)

    @cached_property
    def lit_samples(self) -> tuple[Array, Array]:
        """``surface_samples`` as dense as shading an image takes, kept for the next image."""
        return self.surface_samples(round(160 / np.sqrt(len(self.parts))))

    def mesh(self, resolution: int = 256) -> trimesh.Trimesh:
        """A closed mesh with its vertices on the true surface.

        Args:
            resolution: vertices around each part.

        Raises:
            ImportError: the object has several parts and manifold3d is not installed.
        """
        import trimesh  # here: nodes know the objects by name only

        meshes = [trimesh.Trimesh(*part.grid(resolution), process=False) for part in self.parts]
        return meshes[0] if len(meshes) == 1 else trimesh.boolean.union(meshes, engine="manifold")


def _pixel_angle(camera: Camera, uv: Array, T: Array, N: Array) -> Array:
    """Angle (n,) that a pixel across the contour subtends."""
    step = 0.5
    ahead = camera.project(camera.centre + T + 1e-6 * N) - camera.project(camera.centre + T)
    across = step * ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    turned = camera.viewing_directions(uv + across) - camera.viewing_directions(uv - across)
    angle: Array = np.linalg.norm(turned, axis=1) / (2 * step)
    return angle


def _facing(centre: Array, T: Array) -> Camera:
    """A camera at a centre that looks along the mean of some directions, which reach
    _FACING_PX from the middle of its image."""
    z = T.mean(0)
    R = axes_along(z / np.linalg.norm(z))
    across = T @ R.T
    f = _FACING_PX / np.hypot(across[:, 0] / across[:, 2], across[:, 1] / across[:, 2]).max()
    K = np.array([[f, 0, 0], [0, f, 0], [0, 0, 1]])
    return Camera(K=K, width=1, height=1, R_camera_object=R, t_camera_object=-R @ centre)
