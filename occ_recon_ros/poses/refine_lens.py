"""Distortion that a calibration left in the images, taken into its coefficients."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array

_GRID = 24  # points a side, spread over the image, that the coefficients are fitted to
RADIAL_MODELS = ("none", "plumb_bob", "rational_polynomial")


def undistorted(uv: Array, camera: Camera) -> Array:
    """Where image points (n, 2) were without distortion, px (n, 2)."""
    straight = replace(camera, D=np.zeros(0), distortion="none")
    return straight.project(camera.centre + camera.viewing_directions(uv))


def bent(lenses: Sequence[Camera], K: Array, bend: float) -> list[Camera]:
    """Cameras with other K whose distortion takes in what was left in images without it.

    Args:
        lenses: n, as given; their ``distortion`` is one of RADIAL_MODELS.
        K: (n, 3, 3) of the images without distortion.
        bend: points at a distance r from the principal point, in focal lengths, belong
            1 + bend r^2 times as far from it.
    """
    known: dict[bytes, Camera] = {}
    found = []
    for lens, own in zip(lenses, K, strict=True):
        size = np.array([lens.width, lens.height], float)
        same = np.concatenate([size, own.ravel(), lens.K.ravel(), lens.D]).tobytes()
        if same not in known:
            known[same] = _bent(lens, own, bend)
        one = known[same]
        found.append(replace(lens, K=own, D=one.D, distortion=one.distortion))
    return found


def _bent(lens: Camera, K: Array, bend: float) -> Camera:
    """k1, k2 and k3 that do, with the other coefficients as they are, what is asked of them."""
    grid = np.meshgrid(*(np.linspace(0, size - 1, _GRID) for size in (lens.width, lens.height)))
    seen = np.column_stack([part.ravel() for part in grid])
    xy = _normalised(undistorted(seen, lens), K)
    xy = xy * (1 + bend * (xy**2).sum(axis=1, keepdims=True))
    (x, y), square = xy.T, (xy**2).sum(axis=1)
    D = np.zeros(max(5, len(lens.D)))
    D[: len(lens.D)] = lens.D
    radial = np.stack([square, square**2, square**3], axis=1)
    below = 1 + radial @ D[5:8] if len(D) >= 8 else np.ones_like(square)
    dx = 2 * D[2] * x * y + D[3] * (square + 2 * x * x)
    dy = D[2] * (square + 2 * y * y) + 2 * D[3] * x * y
    b = _normalised(seen, K) - np.column_stack([dx, dy]) - xy / below[:, None]
    A = xy[:, :, None] * (radial / below[:, None])[:, None]
    D[[0, 1, 4]] = np.linalg.lstsq(A.reshape(-1, 3), b.ravel(), rcond=None)[0]
    model = "plumb_bob" if lens.distortion == "none" else lens.distortion
    return replace(lens, K=K, D=D, distortion=model)


def _normalised(uv: Array, K: Array) -> Array:
    """(n, 2) in focal lengths from the principal point."""
    y = (uv[:, 1] - K[1, 2]) / K[1, 1]
    return np.column_stack([(uv[:, 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y])
