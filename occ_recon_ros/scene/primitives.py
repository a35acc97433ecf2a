"""Smooth closed surfaces whose rims have closed forms, in their own coordinates.

Each is given twice: by an implicit function F (negative inside) with its derivatives,
from which normals, curvatures and distances follow, and by the closed form of its rim,
the points X with grad F(X) . (C - X) = 0. Affine maps keep both, so ellipsoids and
elliptic vases are placed, stretched copies (see ``part``).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebval
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array, axes_along

from .intervals import around, positive_intervals

Faces = NDArray[np.intp]

_GRID = 2000


@dataclass(frozen=True)
class RimCurve:
    """A closed rim.

    Attributes:
        at: (n,) float64 angles theta, of period 2 pi, to (n, 3) float64 points, metres.
        nodes: how many even steps of theta follow it to begin with; a polygon has its
            corners there.
    """

    at: Callable[[Array], Array]
    nodes: int = 512


class Primitive(ABC):
    """A smooth closed surface in its own coordinates."""

    @abstractmethod
    def implicit(self, x: Array) -> tuple[Array, Array, Array]:
        """F (n,), its gradient (n, 3) and Hessian (n, 3, 3) at x (n, 3)."""

    @abstractmethod
    def inside(self, x: Array) -> NDArray[np.bool_]:
        """(n,) whether x (n, 3) lies inside."""

    @abstractmethod
    def rims(self, c: Array) -> list[RimCurve]:
        """All rims, visible or not, seen from c (3,) outside the surface."""

    @abstractmethod
    def grid(self, n: int) -> tuple[Array, Faces]:
        """Vertices (v, 3) on the surface, n of them around, and outward triangles (m, 3)."""


class UnitSphere(Primitive):
    """The sphere of radius 1 about the origin."""

    def implicit(self, x: Array) -> tuple[Array, Array, Array]:
        return (x**2).sum(1) - 1, 2 * x, np.broadcast_to(2 * np.eye(3), (len(x), 3, 3))

    def inside(self, x: Array) -> NDArray[np.bool_]:
        return (x**2).sum(1) < 1

    def rims(self, c: Array) -> list[RimCurve]:
        # The polar plane X . c = 1 cuts the sphere in the rim.
        distance = np.linalg.norm(c)
        axis = c / distance
        first, second, _ = axes_along(axis)
        radius = np.sqrt(1 - 1 / distance**2)

        def rim(theta: Array) -> Array:
            circle = np.outer(np.cos(theta), first) + np.outer(np.sin(theta), second)
            return axis / distance + radius * circle

        return [RimCurve(rim)]

    def grid(self, n: int) -> tuple[Array, Faces]:
        s = np.linspace(0, np.pi, n // 2 + 1)
        return _lathe_grid(np.sin(s), -np.cos(s), n)


@dataclass(frozen=True)
class Lathe(Primitive):
    """The surface of revolution x^2 + y^2 = w(z), -1 <= z <= 1.

    Attributes:
        w: squared radius over [-1, 1], with simple zeros at the two ends and positive
            between them: the surface is then smooth at its poles too.
    """

    w: Chebyshev

    @cached_property
    def _derivatives(self) -> Array:
        """(n, 3) coefficients of w, w' and w'', to be evaluated at once; -1 <= z <= 1 is also the
        domain of w."""
        found = np.zeros((len(self.w.coef), 3))
        for k, part in enumerate((self.w, self.w.deriv(), self.w.deriv(2))):
            found[: len(part.coef), k] = part.coef
        return found

    def implicit(self, x: Array) -> tuple[Array, Array, Array]:
        w, slope, bend = chebval(x[:, 2], self._derivatives)
        F = x[:, 0] ** 2 + x[:, 1] ** 2 - w
        gradient = np.column_stack([2 * x[:, 0], 2 * x[:, 1], -slope])
        hessian = np.zeros((len(x), 3, 3))
        hessian[:, 0, 0] = hessian[:, 1, 1] = 2
        hessian[:, 2, 2] = -bend
        return F, gradient, hessian

    def inside(self, x: Array) -> NDArray[np.bool_]:
        z = np.clip(x[:, 2], -1, 1)
        return (np.abs(x[:, 2]) < 1) & (x[:, 0] ** 2 + x[:, 1] ** 2 < self.w(z))

    def rims(self, c: Array) -> list[RimCurve]:
        # On the ring at height z: 2 h sqrt(w) cos(phi - phi_c) = 2 w + w' (c_z - z), with
        # (h, phi_c, c_z) the cylindrical coordinates of c.
        h, phi_c = np.hypot(c[0], c[1]), np.arctan2(c[1], c[0])
        if h < 1e-9:
            raise ValueError("the camera lies on the axis of revolution")

        def sides(z: Array) -> tuple[Array, Array]:
            """w and the right-hand side."""
            w, slope = chebval(z, self._derivatives[:, :2])
            return w, 2 * w + slope * (c[2] - z)

        def discriminant(z: Array) -> Array:
            w, right = sides(z)
            return np.asarray(4 * h**2 * w - right**2)

        grid = -np.cos(np.linspace(0, np.pi, _GRID))
        intervals = positive_intervals(discriminant, grid, periodic=False) or []

        def curve(interval: tuple[float, float]) -> RimCurve:
            def rim(theta: Array) -> Array:
                z, sign = around(interval, theta)
                w, right = sides(z)
                root = np.sqrt(np.maximum(4 * h**2 * w - right**2, 0))
                phi = phi_c + sign * np.arctan2(root, right)
                radius = np.sqrt(np.maximum(w, 0))
                return np.column_stack([radius * np.cos(phi), radius * np.sin(phi), z])

            return RimCurve(rim)

        return [curve(interval) for interval in intervals]

    def grid(self, n: int) -> tuple[Array, Faces]:
        z = -np.cos(np.linspace(0, np.pi, n // 2 + 1))
        return _lathe_grid(np.sqrt(np.maximum(self.w(z), 0)), z, n)


@dataclass(frozen=True)
class Ring(Primitive):
    """The torus (hypot(x, y) - 1)^2 + z^2 = r^2.

    Attributes:
        r: radius of the tube; that of its centre line is 1.
    """

    r: float

    def implicit(self, x: Array) -> tuple[Array, Array, Array]:
        rho = np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-12)
        e = x[:, :2] / rho[:, None]
        F = (rho - 1) ** 2 + x[:, 2] ** 2 - self.r**2
        gradient = 2 * np.column_stack([(rho - 1)[:, None] * e, x[:, 2]])
        hessian = np.zeros((len(x), 3, 3))
        # The Hessian of (rho - 1)^2 is 2 e e^T + 2 (1 - 1/rho) (I - e e^T).
        outer = e[:, :, None] * e[:, None, :]
        across = (1 - 1 / rho)[:, None, None]
        hessian[:, :2, :2] = 2 * outer + 2 * across * (np.eye(2) - outer)
        hessian[:, 2, 2] = 2
        return F, gradient, hessian

    def inside(self, x: Array) -> NDArray[np.bool_]:
        return (np.hypot(x[:, 0], x[:, 1]) - 1) ** 2 + x[:, 2] ** 2 < self.r**2

    def rims(self, c: Array) -> list[RimCurve]:
        # On the meridian at azimuth phi: A cos s + B sin s = r, with s the angle around
        # the tube, A = h cos(phi - phi_c) - 1 and B = c_z.
        h, phi_c = np.hypot(c[0], c[1]), np.arctan2(c[1], c[0])

        def towards(phi: Array) -> tuple[Array, Array]:
            return h * np.cos(phi - phi_c) - 1, np.full_like(phi, c[2])

        def discriminant(phi: Array) -> Array:
            A, B = towards(phi)
            return A**2 + B**2 - self.r**2

        def on_branch(phi: Array, sign: Array) -> Array:
            root = np.sqrt(np.maximum(discriminant(phi), 0))
            A, B = towards(phi)
            s = np.arctan2(B, A) + sign * np.arctan2(root, self.r)
            rho = 1 + self.r * np.cos(s)
            return np.column_stack([rho * np.cos(phi), rho * np.sin(phi), self.r * np.sin(s)])

        def whole(sign: float) -> RimCurve:
            return RimCurve(lambda theta: on_branch(theta, np.full_like(theta, sign)))

        def part(interval: tuple[float, float]) -> RimCurve:
            return RimCurve(lambda theta: on_branch(*around(interval, theta)))

        # The grid starts behind the ring, seen from c, where no interval ends.
        grid = phi_c + np.linspace(-np.pi, np.pi, _GRID)
        intervals = positive_intervals(discriminant, grid, periodic=True)
        if intervals is None:
            return [whole(1.0), whole(-1.0)]
        return [part(interval) for interval in intervals]

    def grid(self, n: int) -> tuple[Array, Faces]:
        m = max(8, round(n * self.r))
        phi, s = np.meshgrid(_circle(n), _circle(m), indexing="ij")
        rho = 1 + self.r * np.cos(s)
        vertices = np.stack([rho * np.cos(phi), rho * np.sin(phi), self.r * np.sin(s)], axis=-1)
        here = np.arange(n * m).reshape(n, m)
        faces = _quads(here, np.roll(here, -1, 0), np.roll(here, -1, 1))
        return vertices.reshape(-1, 3), faces


def _circle(n: int) -> Array:
    return np.linspace(0.0, 2 * np.pi, n, endpoint=False)


def _quads(here: Faces, right: Faces, up: Faces) -> Faces:
    """Two outward triangles for each cell of a grid of vertex numbers."""
    across = np.roll(up, -1, 0)
    halves = (here, right, across), (here, across, up)
    return np.concatenate([np.stack(half, -1).reshape(-1, 3) for half in halves])


def _lathe_grid(radius: Array, z: Array, n: int) -> tuple[Array, Faces]:
    """Rings between two poles; the first and last radius are those of the poles."""
    phi = _circle(n)
    rings = len(z) - 2
    x, y = (np.outer(way(phi), radius[1:-1]) for way in (np.cos, np.sin))
    body = np.stack([x, y, np.broadcast_to(z[1:-1], (n, rings))], axis=-1).reshape(-1, 3)
    here = np.arange(n * rings).reshape(n, rings)
    right = np.roll(here, -1, 0)
    bottom, top = np.full(n, n * rings), np.full(n, n * rings + 1)
    faces = [
        _quads(here[:, :-1], right[:, :-1], here[:, 1:]),
        np.column_stack([bottom, right[:, 0], here[:, 0]]),
        np.column_stack([top, here[:, -1], right[:, -1]]),
    ]
    return np.vstack([body, [0, 0, z[0]], [0, 0, z[-1]]]), np.concatenate(faces)
