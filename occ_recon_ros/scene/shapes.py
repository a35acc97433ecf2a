"""Ways to make and place parts: spheres, turned bodies, rings."""

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from occ_recon_ros.geometry.arrays import Array

from .part import Part
from .primitives import Lathe, Primitive, Ring, UnitSphere


def placed(
    primitive: Primitive,
    size: Sequence[float],
    centre: ArrayLike = (0, 0, 0),
    axis: ArrayLike = (0, 0, 1),
) -> Part:
    """Stretch a primitive, lean its z axis over and move it.

    Args:
        primitive: the surface in its own coordinates.
        size: factors along its own three axes, metres.
        centre: where its origin goes, metres.
        axis: where its z axis points, any length; the turn is the shortest one.
    """
    return Part(primitive, _leaning(axis) @ np.diag(size), np.asarray(centre, np.float64))


def ball(size: Sequence[float], centre: ArrayLike = (0, 0, 0), axis: ArrayLike = (0, 0, 1)) -> Part:
    """An ellipsoid by its three semi-axes, metres."""
    return placed(UnitSphere(), size, centre, axis)


def limb(start: ArrayLike, stop: ArrayLike, radius: float) -> Part:
    """A round rod between two points that its ends reach, all in metres."""
    a, b = np.asarray(start, np.float64), np.asarray(stop, np.float64)
    size = (radius, radius, 0.5 * float(np.linalg.norm(b - a)))
    return placed(turned(Chebyshev([1.0]), 3), size, 0.5 * (a + b), b - a)


def ring(
    radius: float, tube: float, centre: ArrayLike = (0, 0, 0), axis: ArrayLike = (0, 0, 1)
) -> Part:
    """A torus by the radius of its centre line and that of its tube, metres."""
    return placed(Ring(tube / radius), (radius, radius, radius), centre, axis)


def turned(f: Chebyshev, roundness: int) -> Lathe:
    """A lathe of radius f(z) sqrt(1 - z^(2 roundness)), -1 <= z <= 1.

    The larger the roundness, the smaller the radius of its two ends.
    """
    z = Chebyshev([0, 1])
    # 1 - z^2m = (1 - z^2)(1 + z^2 + ... + z^(2m-2)) keeps the ends zero to rounding.
    rest = Chebyshev([1.0])
    for _ in range(roundness - 1):
        rest = 1 + z**2 * rest
    return Lathe(((1 - z**2) * rest * f**2).trim(1e-15))


def through(z: Sequence[float], radius: Sequence[float]) -> Chebyshev:
    """The polynomial through some radii at heights -1 to 1."""
    return Chebyshev.fit(z, radius, len(z) - 1, domain=[-1, 1])


def _leaning(axis: ArrayLike) -> Array:
    """The rotation (3, 3) that takes z to a direction by the shortest way."""
    d = np.asarray(axis, np.float64)
    d = d / np.linalg.norm(d)
    if d[2] <= -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, 0, d[0]], [0, 0, d[1]], [-d[0], -d[1], 0]])
    rotation: Array = np.eye(3) + cross + cross @ cross / (1 + d[2])
    return rotation
