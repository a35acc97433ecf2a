"""A primitive put in its place: stretched, turned and moved into the object frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from occ_recon_ros.geometry.arrays import Array

from .primitives import Primitive, RimCurve

_START_SAMPLES = 160
_ITERATIONS = 60
_TOLERANCE_M = 1e-13
_GRAZING_STEPS = 6
_ORIENTING_THETA = np.linspace(0, 2 * np.pi, 257)


@dataclass(frozen=True)
class Part:
    """A smooth closed surface in the object frame: X = M x + t of a primitive.

    Attributes:
        primitive: the surface in its own coordinates.
        M: (3, 3) float64, any invertible map with positive determinant, metres.
        t: (3,) float64, metres.
    """

    primitive: Primitive
    M: Array
    t: Array

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.M), np.float64)

    def _own(self, points: Array) -> Array:
        own: Array = (points - self.t) @ self._inverse.T
        return own

    def _implicit(self, points: Array) -> tuple[Array, Array, Array]:
        """F, its gradient and Hessian in the object frame."""
        F, gradient, hessian = self.primitive.implicit(self._own(points))
        inverse = self._inverse
        return F, gradient @ inverse, inverse.T @ hessian @ inverse

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) lie inside."""
        return self.primitive.inside(self._own(points))

    def rims(self, centre: Array) -> list[RimCurve]:
        """All rims seen from a camera centre (3,), visible or not, in the object frame,
        each walked so that the image of the surface is on its left as displayed.

        Raises:
            ValueError: the camera is inside the object.
        """
        if self.inside(centre[None])[0]:
            raise ValueError("the camera is inside the object")
        curves = self.primitive.rims(self._own(centre[None])[0])
        return [self._placed(curve, centre) for curve in curves]

    def _placed(self, curve: RimCurve, centre: Array) -> RimCurve:
        def rim(theta: Array) -> Array:
            return curve.at(theta) @ self.M.T + self.t

        points = rim(_ORIENTING_THETA)
        T = points - centre
        T /= np.linalg.norm(T, axis=1, keepdims=True)
        normals, k_t = self.at_rim(points[:-1], T[:-1])
        right = (np.cross(T[:-1], np.diff(T, axis=0)) * normals).sum(1)
        # A fold that is concave along the ray has its surface on the outer side.
        if (right * np.sign(k_t)).sum() < 0:
            return RimCurve(lambda theta: rim(-theta))
        return RimCurve(rim)

    def at_rim(self, points: Array, T: Array) -> tuple[Array, Array]:
        """Outward unit normals (n, 3) and normal curvatures (n,) along rays T (n, 3), 1/m
        and positive where convex, at points (n, 3) where they touch the surface."""
        normals, S = self.shape(points)
        return normals, np.einsum("ni,nij,nj->n", T, S, T)

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Normals and shape operators at points on the surface.

        Args:
            points: (n, 3) float64, metres, on the surface.

        Returns:
            normals: (n, 3) outward unit normals.
            S: (n, 3, 3), symmetric, 1/m: v . S v is the normal curvature along a unit
                tangent v, positive where the surface is convex; S n = 0.
        """
        _, gradient, hessian = self._implicit(points)
        length = np.linalg.norm(gradient, axis=1)
        normals = gradient / length[:, None]
        tangential = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        return normals, tangential @ hessian @ tangential / length[:, None, None]

    def graze(self, centre: Array, T: Array, points: Array) -> tuple[Array, Array]:
        """Where rays touch the surface, or come nearest to it if they miss by a little.

        Args:
            centre: (3,) float64, metres.
            T: (n, 3) float64, unit directions.
            points: (n, 3) float64, metres, places on the surface to start from.

        Returns:
            depth: (n,) float64, metres along the rays.
            k_t: (n,) float64, normal curvature of the surface there along the rays, 1/m.
        """
        depth, feet = ((points - centre) * T).sum(1), points
        for _ in range(_GRAZING_STEPS):
            on_ray = centre + depth[:, None] * T
            feet = self._feet(on_ray, feet)
            normals, S = self.shape(feet)
            height = ((on_ray - feet) * normals).sum(1)
            # Along the ray the foot moves by (I + height S)^-1 T, the normal by S of that.
            moved = np.linalg.solve(np.eye(3) + height[:, None, None] * S, T[:, :, None])
            bend = np.einsum("ni,nij,nj->n", T, S, moved[:, :, 0])
            step = (normals * T).sum(1) / np.where(bend == 0, np.inf, bend)
            depth = depth - step
        normals, S = self.shape(self._feet(centre + depth[:, None] * T, feet))
        along = T - (normals * T).sum(1, keepdims=True) * normals
        return depth, np.einsum("ni,nij,nj->n", along, S, along) / (along**2).sum(1)

    def grid(self, n: int) -> tuple[Array, NDArray[np.intp]]:
        """Vertices (v, 3) on the surface, n of them around, and outward triangles (m, 3)."""
        vertices, faces = self.primitive.grid(n)
        return vertices @ self.M.T + self.t, faces

    @cached_property
    def _start(self) -> tuple[cKDTree, Array]:
        vertices, _ = self.grid(_START_SAMPLES)
        return cKDTree(vertices), vertices

    def bounds(self, points: Array) -> tuple[Array, Array]:
        """What the distance (n,) of points (n, 3) outside of the surface is not below and not
        above, metres."""
        above = self._start[0].query(points)[0]
        return above - self._gap, above

    def beyond(self, points: Array) -> Array:
        """What the distance (n,) of points (n, 3) is not below, metres, by a box alone."""
        _, vertices = self._start
        inside = np.clip(points, vertices.min(axis=0), vertices.max(axis=0))
        return _length(points - inside) - self._gap

    @cached_property
    def _gap(self) -> float:
        """The longest edge between the places that feet are looked for from: none of the surface
        is farther from all of them."""
        vertices, faces = self.grid(_START_SAMPLES)
        return float(np.linalg.norm(np.diff(vertices[faces], axis=1), axis=2).max())

    def distance(self, points: Array) -> Array:
        """Signed distance (n,) of points (n, 3) to the surface, metres, outside positive."""
        tree, vertices = self._start
        feet = self._feet(points, vertices[tree.query(points)[1]])
        normals, _ = self.shape(feet)
        away = points - feet
        return np.copysign(_length(away), (away * normals).sum(1))

    def _feet(self, points: Array, start: Array) -> Array:
        """The nearest points on the surface, found from places on it (n, 3) nearby."""
        feet = start.copy()
        active, scale = np.arange(len(points)), np.ones(len(points))
        for _ in range(_ITERATIONS):
            q, old = points[active], feet[active]
            new = self._towards_foot(q, old, scale[active])
            # A step that leads away is taken back and shortened.
            nearer = _length(q - new) <= _length(q - old) + _TOLERANCE_M
            feet[active] = np.where(nearer[:, None], new, old)
            scale[active] *= np.where(nearer, np.minimum(2, 1 / scale[active]), 0.25)
            active = active[~nearer | (_length(new - old) > _TOLERANCE_M)]
            if not len(active):
                break
        return feet

    def _towards_foot(self, points: Array, feet: Array, scale: Array) -> Array:
        """One Newton step, shortened by scale (n,), of the nearest point on the surface."""
        normals, S = self.shape(feet)
        away = points - feet
        height = (away * normals).sum(1)
        along = away - height[:, None] * normals
        # The tangential part of (point - foot) changes by -(I + height S) per unit of
        # motion of the foot; beyond a centre of curvature that is no descent.
        descends = height * np.linalg.norm(S, axis=(1, 2)) > -0.8
        system = np.eye(3) + np.where(descends, height, 0.0)[:, None, None] * S
        step = np.linalg.solve(system, along[:, :, None])[:, :, 0]
        feet = feet + scale[:, None] * step
        for _ in range(3):
            F, own, _ = self.primitive.implicit(self._own(feet))
            gradient = own @ self._inverse
            feet = feet - (F / (gradient**2).sum(1))[:, None] * gradient
        return feet


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt((vectors**2).sum(1))
    return length
