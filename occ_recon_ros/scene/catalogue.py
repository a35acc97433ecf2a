"""The objects that can stand on the virtual turntable, about 0.2 m in size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from .objects import SceneObject
from .part import Part
from .primitives import Lathe, Ring, UnitSphere

Array = NDArray[np.float64]


def sphere(radius: float = 0.1, centre: tuple[float, float, float] = (0, 0, 0)) -> SceneObject:
    """A sphere; radius and centre in metres."""
    return SceneObject("sphere", (Part(UnitSphere(), radius * np.eye(3), np.array(centre)),))


def vase() -> SceneObject:
    """An elliptic vase 0.2 m high about the turntable's axis: x = a f(z) cos(phi),
    y = b f(z) sin(phi), with foot, belly, neck and lip, rounded at the bottom and the top."""
    z, radius = [-1, -0.25, 0.25, 0.65, 1], [0.7, 1.0, 0.8, 0.55, 0.72]
    body = turned(Chebyshev.fit(z, radius, len(z) - 1, domain=[-1, 1]), roundness=7)
    return SceneObject("vase", (Part(body, np.diag([0.075, 0.06, 0.1]), np.zeros(3)),))


def torus(major: float = 0.07, minor: float = 0.025) -> SceneObject:
    """A torus lying flat about the turntable's axis; radii in metres."""
    return SceneObject("torus", (Part(Ring(minor / major), major * np.eye(3), np.zeros(3)),))


def turned(f: Chebyshev, roundness: int) -> Lathe:
    """A lathe of radius f(z) sqrt(1 - z^(2 roundness)), -1 <= z <= 1.

    The larger the roundness, the smaller the radius of its two ends.
    """
    z = Chebyshev([0, 1])
    # 1 - z^2m = (1 - z^2)(1 + z^2 + ... + z^(2m-2)) keeps the ends zero to rounding.
    rest = Chebyshev([1.0])
    for _ in range(roundness - 1):
        rest = 1 + z**2 * rest
    return Lathe((1 - z**2) * rest * f**2)


_MAKERS: dict[str, Callable[[], SceneObject]] = {"sphere": sphere, "vase": vase, "torus": torus}

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
