"""A true rim point projects inside or on every other silhouette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .contours import Contours

Array = NDArray[np.float64]


class Silhouette:
    """The inside and outside of one view's contours, on the sphere of directions.

    Args:
        contours: the outline; its samples lie about a pixel apart.
    """

    def __init__(self, contours: Contours) -> None:
        self.contours = contours
        self._tree = cKDTree(contours.T) if len(contours) else None

    def outside(self, points: Array) -> Array:
        """How far points project outside the outline.

        The distance to the tangent plane of the nearest contour sample: exact for
        points nearer to the outline than its radius of curvature.

        Args:
            points: (n, 3) float64, metres, object frame; may hold NaN.

        Returns:
            (n,) float64, radians of viewing direction, negative inside, NaN for NaN.
        """
        result = np.full(len(points), np.nan)
        known = np.isfinite(points).all(axis=1)
        if self._tree is None or not known.any():
            return result
        ray = points[known] - self.contours.centre
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        distance, row = self._tree.query(ray)
        across = np.einsum("nk,nk->n", ray - self.contours.T[row], self.contours.N[row])
        # Beside a corner the nearest sample's plane says too little: the distance does not.
        far = distance > 4 * np.abs(across)
        result[known] = np.where(far, np.sign(across) * distance, across)
        return result
