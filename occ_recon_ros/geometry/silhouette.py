"""A true rim point projects inside or on every other silhouette."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .outline_map import OutlineMap

Array = NDArray[np.float64]


class Silhouette:
    """The inside and outside of one view's contours.

    Works on the plane at distance 1 across the middle viewing direction. A coarse grid
    answers for points far from the outline, and the nearest sample's tangent for those
    near it. The grid is made when it is first asked.

    Args:
        contours: the outline, of at least one sample; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours

    @cached_property
    def _map(self) -> OutlineMap:
        return OutlineMap(self.contours)

    def outside(self, points: Array) -> Array:
        """How far points project outside the outline.

        Exact nearer to the outline than half a grid cell (a 64th of the silhouette's
        longer side), to about a cell farther away, and only roughly beyond its surroundings.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction (on the plane across the middle
            direction), negative inside; NaN for NaN, for points behind the camera, and
            beyond a gap of the outline, where nothing is known.
        """
        return self._map.outside(points)
