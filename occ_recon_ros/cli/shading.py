"""A shaded view of triangles as a given camera sees them."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.surface import Strip

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]

_OVERSAMPLING = 2
_BACKGROUND = np.array([250, 248, 246], np.float32)  # BGR
_FRONT = np.array([214, 190, 160], np.float32)
_BACK = np.array([110, 110, 205], np.float32)
_AMBIENT = 0.2
_LIGHT = np.array([-0.5, -0.6, -0.8])  # camera frame: from the upper left behind the camera
_POINTS_A_CHUNK = 2_000_000


Box = tuple[float, float, float, float]
"""left, top, right, bottom of a part of an image, pixels."""


def shade(surface: Strip, camera: Camera, box: Box, size: int) -> NDArray[np.uint8]:
    """Draw a surface with a depth buffer.

    Args:
        surface: triangles; fronts are drawn in a light colour, backs in red.
        camera: the view, as calibrated.
        box: the part of its image to draw.
        size: height of the picture, pixels.

    Returns:
        (size, width, 3) uint8 BGR with the aspect of the box.
    """
    scale = size * _OVERSAMPLING / (box[3] - box[1])
    height, width = size * _OVERSAMPLING, round((box[2] - box[0]) * scale)
    width += width % _OVERSAMPLING
    uvz, colours = _projected(surface, camera, box, scale)
    depth = np.full(height * width, np.inf, np.float32)
    canvas = np.tile(_BACKGROUND, (height * width, 1))
    for corners, tint, along, across in _batches(uvz, colours):
        _splat(corners, tint, along, across, (height, width), depth, canvas)
    picture = canvas.reshape(height, width, 3)
    small = cv2.resize(picture, (width // _OVERSAMPLING, size), interpolation=cv2.INTER_AREA)
    return small.round().astype(np.uint8)


def _projected(surface: Strip, camera: Camera, box: Box, scale: float) -> tuple[Pixels, Pixels]:
    """(m, 3, 3) corners as column, row, depth in the picture, and (m, 3, 3) BGR at them.

    The corner opposite the shortest edge comes first.
    """
    points = surface.corners.reshape(-1, 3).astype(np.float64)
    uv = (camera.project(points) - np.array(box[:2])) * scale
    z = points @ camera.R_camera_object[2] + camera.t_camera_object[2]
    uvz = np.column_stack([uv, z]).reshape(-1, 3, 3).astype(np.float32)
    edge1, edge2 = uvz[:, 1, :2] - uvz[:, 0, :2], uvz[:, 2, :2] - uvz[:, 0, :2]
    # Rows count downwards, so that an outward triangle turns clockwise in numbers.
    front = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0] < 0
    facing = np.where(front, 1.0, -1.0)[:, None] * (surface.normals @ _to_light(camera))
    light = _AMBIENT + (1 - _AMBIENT) * (0.5 + 0.5 * facing) ** 1.5
    colours = light[..., None] * np.where(front[:, None], _FRONT, _BACK)[:, None, :]
    opposite = np.linalg.norm(uvz[:, [2, 0, 1], :2] - uvz[:, [1, 2, 0], :2], axis=2)
    order = (np.argmin(opposite, axis=1)[:, None] + np.arange(3)) % 3
    inside = np.isfinite(uvz).all(axis=(1, 2))
    rows = np.flatnonzero(inside)[:, None]
    order = order[inside]
    return uvz[rows, order], colours[rows, order].astype(np.float32)


def _to_light(camera: Camera) -> Array:
    return _LIGHT / np.linalg.norm(_LIGHT) @ camera.R_camera_object


def _batches(uvz: Pixels, colours: Pixels) -> Iterator[tuple[Pixels, Pixels, int, int]]:
    """Triangles of about the same size in the picture, and the samples that fill them."""
    along = np.linalg.norm(uvz[:, 1:, :2] - uvz[:, :1, :2], axis=2).max(axis=1, initial=0)
    across = np.linalg.norm(uvz[:, 2, :2] - uvz[:, 1, :2], axis=1)
    steps = np.column_stack([_samples(along), _samples(across)])
    kinds, which = np.unique(steps, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(which.ravel(), minlength=len(kinds)))
    for (n, m), rows in zip(kinds, np.split(order, ends[:-1]), strict=True):
        batch = max(1, _POINTS_A_CHUNK // int(n * m))
        for first in range(0, len(rows), batch):
            chosen = rows[first : first + batch]
            yield uvz[chosen], colours[chosen], int(n), int(m)


def _samples(length: Pixels) -> NDArray[np.intp]:
    """Samples along an edge, at most 0.7 of a pixel apart; few different numbers."""
    n = np.clip(length / 0.7, 1, 2000)
    return np.ceil(2 ** (np.ceil(np.log2(n) * 3) / 3)).astype(np.intp) + 1


def _splat(
    corners: Pixels,
    tint: Pixels,
    along: int,
    across: int,
    shape: tuple[int, int],
    depth: Pixels,
    canvas: Pixels,
) -> None:
    """Write samples of triangles where nothing nearer has been written."""
    s = np.linspace(0, 1, along, dtype=np.float32)[:, None, None]
    t = np.linspace(0, 1, across, dtype=np.float32)[None, :, None]
    weights = np.concatenate(np.broadcast_arrays(1 - s, s * (1 - t), s * t), axis=2).reshape(-1, 3)
    at = np.einsum("sk,mkd->msd", weights, corners, optimize=True).reshape(-1, 3)
    column, row = at[:, 0].round().astype(np.int64), at[:, 1].round().astype(np.int64)
    z = at[:, 2]
    keep = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0]) & (z > 0)
    pixel = (row * shape[1] + column)[keep]
    z = z[keep]
    np.minimum.at(depth, pixel, z)
    nearest = np.flatnonzero(z == depth[pixel])
    sample = np.flatnonzero(keep)[nearest]
    triangle, place = np.divmod(sample, len(weights))
    canvas[pixel[nearest]] = np.einsum("nk,nkc->nc", weights[place], tint[triangle])
