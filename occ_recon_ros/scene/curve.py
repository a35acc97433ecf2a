"""A closed curve in space, given at any parameter."""

from collections.abc import Callable
from dataclasses import dataclass

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
