"""Images of discs and ellipses whose every pixel is the exact share of its area covered."""

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera

_EDGES = 64


def camera_for(image: NDArray) -> Camera:
    """A camera of 1600 px focal length looking at the origin from 1 m."""
    height, width = image.shape[:2]
    K = np.array([[1600, 0, width / 2], [0, 1600, height / 2], [0, 0, 1.0]])
    return Camera(K, width, height, np.eye(3), np.array([0, 0, 1.0]))


def coverage(shape: tuple[int, int], centre: NDArray, radii: NDArray, angle: float) -> NDArray:
    """Share of each pixel inside an ellipse, by exact chords of 64 lines a pixel row.

    Args:
        shape: (height, width).
        centre: (2,) x, y, px; pixel (0, 0) has its centre at (0, 0).
        radii: (2,) half-axes, px.
        angle: of the first half-axis from x towards y, rad.
    """
    height, width = shape
    y = (np.arange(height * _EDGES) + 0.5) / _EDGES - 0.5 - centre[1]
    c, s = np.cos(angle), np.sin(angle)
    a, b = radii
    # ((c x + s y)/a)^2 + ((c y - s x)/b)^2 = 1, a quadratic in x on each line.
    A = (c / a) ** 2 + (s / b) ** 2
    B = y * c * s * (1 / a**2 - 1 / b**2)
    C = y**2 * ((s / a) ** 2 + (c / b) ** 2) - 1
    root = np.sqrt(np.maximum(B * B - A * C, 0.0))
    # What lies right of the one end of a chord and not right of the other.
    gains = np.zeros((height, width + 2))
    rows = np.repeat(np.arange(height), _EDGES)
    for way, end in ((1, -root), (-1, root)):
        place = np.clip((-B + end) / A + centre[0] + 0.5, 0, width)
        column = place.astype(np.intp)
        np.add.at(gains, (rows, column), way * (1 - place + column))
        np.add.at(gains, (rows, column + 1), way * (place - column))
    return np.cumsum(gains[:, :width], axis=1) / _EDGES


def photograph(
    share: NDArray,
    inside: float = 60.0,
    outside: float = 160.0,
    blur: float = 1.0,
    noise: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Grey image of a coverage map with Gaussian blur (px) and noise (grey levels)."""
    image = outside + (inside - outside) * share
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    image = image + np.random.default_rng(seed).normal(0.0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def ellipse_error(uv: NDArray, centre: NDArray, radii: NDArray, angle: float) -> NDArray:
    """(n,) px along the outward normal from the ellipse to points near it, to second order."""
    c, s = np.cos(angle), np.sin(angle)
    p = (uv - centre) @ np.array([[c, -s], [s, c]])
    a, b = radii
    x, y = p[:, 0], p[:, 1]
    t = np.arctan2(y / b, x / a)
    for _ in range(8):  # Newton for the foot: (p - e(t)).e'(t) = 0
        ex, ey, dx, dy = a * np.cos(t), b * np.sin(t), -a * np.sin(t), b * np.cos(t)
        f = (x - ex) * dx + (y - ey) * dy
        t -= f / (-(dx * dx + dy * dy) - (x - ex) * ex - (y - ey) * ey)
    ex, ey = a * np.cos(t), b * np.sin(t)
    return np.sign((x / a) ** 2 + (y / b) ** 2 - 1) * np.hypot(x - ex, y - ey)
