"""The point of a triangle that is closest to a point."""

import numpy as np

from occ_recon_ros.geometry.arrays import Array


def closest_on_triangles(points: Array, triangles: Array) -> Array:
    """Barycentric weights of the closest points, one triangle a point.

    Args:
        points: (n, 3) float64.
        triangles: (n, 3, 3) float64, corners.

    Returns:
        (n, 3) float64, weights of the corners, not negative, summing to 1.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    # The foot on the triangle's plane, in barycentric coordinates.
    u, v, w = b - a, c - a, points - a
    uu, uv, vv, wu, wv = _dot(u, u), _dot(u, v), _dot(v, v), _dot(w, u), _dot(w, v)
    area = uu * vv - uv * uv
    area = np.where(area > 0, area, np.inf)
    beta, gamma = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    best = np.column_stack([1 - beta - gamma, beta, gamma])
    on_plane = (best >= 0).all(1) & np.isfinite(area)
    nearest = np.where(on_plane, _squared(points, triangles, best), np.inf)
    # Where that falls outside, or the triangle has hardly an area, it is on one of the sides.
    for i, j in ((0, 1), (1, 2), (2, 0)):
        side = triangles[:, j] - triangles[:, i]
        length = np.maximum(_dot(side, side), 1e-300)
        along = np.clip(_dot(points - triangles[:, i], side) / length, 0, 1)
        weights = np.zeros((len(points), 3))
        weights[:, i], weights[:, j] = 1 - along, along
        squared = _squared(points, triangles, weights)
        closer = squared < nearest
        best[closer], nearest[closer] = weights[closer], squared[closer]
    return best


def _dot(p: Array, q: Array) -> Array:
    return np.asarray((p * q).sum(1), np.float64)


def _squared(points: Array, triangles: Array, weights: Array) -> Array:
    away = points - np.einsum("ni,nij->nj", weights, triangles)
    return _dot(away, away)
