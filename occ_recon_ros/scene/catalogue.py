"""The objects that can stand on the virtual turntable, about 0.2 m in size."""

from collections.abc import Callable

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike
from scipy.special import erf

from .objects import SceneObject
from .shapes import ball, limb, placed, ring, through, turned


def sphere(radius: float = 0.1, centre: ArrayLike = (0, 0, 0)) -> SceneObject:
    """A sphere; radius and centre in metres."""
    return SceneObject("sphere", (ball((radius, radius, radius), centre),))


def ellipsoid() -> SceneObject:
    """An ellipsoid of three different axes, off the turntable's axis and tilted."""
    return SceneObject("ellipsoid", (ball((0.09, 0.065, 0.1), (0.015, -0.01, 0.0), (0.3, 0.2, 1)),))


def vase() -> SceneObject:
    """An elliptic vase 0.2 m high about the turntable's axis: x = a f(z) cos(phi),
    y = b f(z) sin(phi), with foot, belly, neck and lip, rounded at the bottom and the top."""
    f = through([-1, -0.25, 0.25, 0.65, 1], [0.7, 1.0, 0.8, 0.55, 0.72])
    return SceneObject("vase", (placed(turned(f, 7), (0.075, 0.06, 0.1)),))


def torus(major: float = 0.07, minor: float = 0.025) -> SceneObject:
    """A torus lying flat about the turntable's axis; radii in metres."""
    return SceneObject("torus", (ring(major, minor),))


def gourd() -> SceneObject:
    """Two round lobes with a waist, off the turntable's axis and tilted."""
    f = through([-1, -0.5, 0.2, 0.65, 1], [0.85, 1.0, 0.42, 0.66, 0.6])
    body = placed(turned(f, 2), (0.068, 0.068, 0.11), (0.02, -0.012, 0), (0.3, -0.22, 1))
    return SceneObject("gourd", (body,))


def wavy() -> SceneObject:
    """A wavy surface of revolution, off the turntable's axis and tilted."""
    f = Chebyshev.interpolate(lambda z: 0.9 + 0.08 * np.cos(9 * z + 0.7) - 0.1 * z, 36)
    body = placed(turned(f, 3), (0.07, 0.07, 0.1), (-0.015, 0.012, 0), (-0.15, 0.18, 1))
    return SceneObject("wavy", (body,))


def bottle() -> SceneObject:
    """A bottle with shoulders and a slim neck, about the turntable's axis."""
    f = Chebyshev.interpolate(lambda z: 0.7 - 0.3 * erf((z - 0.3) / 0.24), 60)
    return SceneObject("bottle", (placed(turned(f, 7), (0.045, 0.045, 0.11)),))


def mug() -> SceneObject:
    """A mug with a lid: an upright body, and a handle that leaves a hole beside it."""
    body = placed(turned(Chebyshev([1.0, 0.03]), 8), (0.05, 0.05, 0.06))
    # The inner half of the ring is hidden in the body.
    handle = ring(0.036, 0.0085, (0.053, 0, 0), (0, -1, 0))
    return SceneObject("mug", (body, handle))


def figure() -> SceneObject:
    """A standing figure with separate limbs, its arms held away from the body."""
    parts = [
        ball((0.03, 0.022, 0.045), (0, 0, 0.02)),
        ball((0.02, 0.02, 0.024), (0.003, 0, 0.083)),
        limb((0, 0, 0.04), (0.002, 0, 0.075), 0.009),
    ]
    for side, lift in ((-1, 0.0), (1, 0.03)):
        parts += [
            limb((0, side * 0.014, 0), (0.004, side * 0.036, -0.1), 0.012),
            limb((0, side * 0.015, 0.046), (0.01 * side, side * 0.085, lift), 0.009),
        ]
    return SceneObject("figure", tuple(parts))


_MAKERS: dict[str, Callable[[], SceneObject]] = {
    maker.__name__: maker
    for maker in (sphere, vase, torus, ellipsoid, gourd, wavy, bottle, mug, figure)
}

OBJECTS = tuple(_MAKERS)
"""Names that ``make_object`` knows."""


def make_object(name: str) -> SceneObject:
    """The object of a name in OBJECTS.

    Raises:
        ValueError: an unknown name.
    """
    if name not in _MAKERS:
        raise ValueError(f"unknown object '{name}': use one of {', '.join(OBJECTS)}")
    return _MAKERS[name]()
