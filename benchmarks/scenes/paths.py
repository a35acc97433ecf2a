"""Cameras that look at something, and a camera carried around an object by hand."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from occ_recon_ros.geometry import Camera

Array = NDArray[np.float64]


def looking_at(
    centre: ArrayLike,
    target: ArrayLike,
    roll: float = 0.0,
    focal_px: float = 1600.0,
    size: tuple[int, int] = (1280, 960),
) -> Camera:
    """A camera with its principal point, the image's middle, on a target.

    Args:
        centre, target: (3,) metres, object frame; not above one another.
        roll: rotation about the optical axis, rad; 0 shows z upright.
        focal_px: focal length, pixels.
        size: width and height of the image, pixels.
    """
    C = np.asarray(centre, np.float64)
    z = np.asarray(target, np.float64) - C
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    c, s = np.cos(roll), np.sin(roll)
    R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.stack([x, np.cross(z, x), z])
    width, height = size
    K = np.array([[focal_px, 0, 0.5 * (width - 1)], [0, focal_px, 0.5 * (height - 1)], [0, 0, 1]])
    return Camera(K=K, width=width, height=height, R_camera_object=R, t_camera_object=-R @ C)


def hand_held_cameras(
    frames: int = 36, step: float = float(np.deg2rad(10)), distance: float = 1.0, seed: int = 0
) -> list[Camera]:
    """Views of a camera carried around the origin: no plane, no axis, no even pace.

    Azimuth advances by ``step`` a frame in the mean; azimuth, elevation, distance, roll and
    the point looked at all sway smoothly. The path depends on the angle travelled, so a
    smaller step samples the same path more densely.

    Args:
        frames: number of views.
        step: mean turn about z from view to view, rad.
        distance: mean distance from the origin, metres.
        seed: of the sway.
    """
    rng = np.random.default_rng(seed)
    travelled = np.arange(frames) * step

    def sway(amplitude: float) -> Array:
        phases = rng.uniform(0, 2 * np.pi, 3)
        waves = np.sin(np.outer(travelled, [1, 2, 3]) + phases) / [1, 2, 3]
        return amplitude * waves.sum(1)

    azimuth = travelled + sway(0.08)
    elevation = 0.35 + sway(0.2)
    reach = distance * (1 + sway(0.1))
    centres = reach[:, None] * np.column_stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    targets = np.column_stack([sway(0.01), sway(0.01), sway(0.01)])
    return [
        looking_at(centre, target, roll)
        for centre, target, roll in zip(centres, targets, sway(0.1), strict=True)
    ]
