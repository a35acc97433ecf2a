"""What a scene object needs to know of each of its parts, and of their rims."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array


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


class Solid(Protocol):
    """A closed surface in the object frame; points are (n, 3) float64, metres."""

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether points lie inside."""

    def distance(self, points: Array) -> Array:
        """(n,) signed distance to the surface, outside positive."""

    def bounds(self, points: Array) -> tuple[Array, Array]:
        """What the distance (n,) is not below and not above outside, at less cost."""

    def beyond(self, points: Array) -> Array:
        """What the distance (n,) is not below outside, at hardly any."""

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Outward unit normals (n, 3) and shape operators (n, 3, 3) on the surface."""

    def rims(self, centre: Array) -> list[RimCurve]:
        """All rims seen from centre (3,), the surface's image on their left."""

    def at_rim(self, points: Array, T: Array) -> tuple[Array, Array]:
        """Normals (n, 3) and curvatures (n,) along rays T (n, 3) that touch at points."""

    def graze(self, centre: Array, T: Array, points: Array) -> tuple[Array, Array]:
        """Depth and normal curvature where rays T (n, 3) touch the surface, near points."""

    def grid(self, n: int) -> tuple[Array, NDArray[np.intp]]:
        """Vertices (v, 3) on the surface, n of them around, and triangles (m, 3)."""
