"""Mild shading that varies slowly, so that the edge of the object is its coverage."""

import cv2
import numpy as np

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array

_CELL_PX = 8
_SMOOTH_CELLS = 2.0
_LIGHT = np.array([-0.5, -0.7, -0.5])


def shading(points: Array, normals: Array, camera: Camera) -> Array:
    """Diffuse light on a surface, smooth over the whole image.

    Surface samples are dropped into coarse cells, the nearest one winning, and the cells
    are smoothed and spread beyond the outline.

    Args:
        points, normals: (n, 3) float64, a dense sample of the surface, object frame.
        camera: the view; the light comes with it, from the upper left.

    Returns:
        (height, width) float64, 0 (dark) to 1 (lit).
    """
    rows, columns = -(-camera.height // _CELL_PX), -(-camera.width // _CELL_PX)
    depth = np.linalg.norm(points - camera.centre, axis=1)
    faces_us = ((camera.centre - points) * normals).sum(1) > 0.1 * depth
    uv = camera.project(points)
    cell = np.floor((uv + 0.5) / _CELL_PX)
    seen = faces_us & ((cell >= 0) & (cell < [columns, rows])).all(1)
    cell, depth = cell[seen].astype(np.intp), depth[seen]
    light = _LIGHT / np.linalg.norm(_LIGHT)
    lit = 0.5 + 0.5 * (normals[seen] @ camera.R_camera_object.T) @ light
    # Farther samples are written first, so the nearest one stays.
    order = np.argsort(-depth)
    value, weight = np.zeros((rows, columns)), np.zeros((rows, columns))
    value[cell[order, 1], cell[order, 0]] = lit[order]
    weight[cell[:, 1], cell[:, 0]] = 1.0
    coarse = _filled(value, weight)
    size = (columns * _CELL_PX, rows * _CELL_PX)
    smooth = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.float64)
    return smooth[: camera.height, : camera.width]


def _filled(value: Array, weight: Array) -> Array:
    """Smooth what is known and spread it over what is not (normalised convolution)."""
    mean = (value * weight).sum() / max(weight.sum(), 1.0)
    total, known = np.full_like(value, 1e-6 * mean), np.full_like(value, 1e-6)
    # The wide kernel fills only what the narrow one does not reach.
    for sigma, share in ((_SMOOTH_CELLS, 1.0), (4 * _SMOOTH_CELLS, 1e-2)):
        total = total + share * cv2.GaussianBlur(value * weight, (0, 0), sigma)
        known = known + share * cv2.GaussianBlur(weight, (0, 0), sigma)
    return np.asarray(total / known, np.float64)
