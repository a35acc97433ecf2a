"""The sphere of Boyer and Berger's experiments, and noise on exact contours."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours, contours_from_loops
from occ_recon_ros.scene.catalogue import sphere
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.turntable import TurntableSettings, turntable_cameras

Array = NDArray[np.float64]

Smoother = Callable[[Array], tuple[Array, Array]]
"""A closed noisy curve (n, 2), pixels, to a smooth one (m, 2) and its sigmas (m,)."""

RADIUS_M = 0.2
DISTANCE_M = 1.3


def paper_sphere(
    step: float,
    frames: int = 3,
    noise_px: float = 1.0,
    seed: int = 0,
    smooth: Smoother | None = None,
) -> tuple[SceneObject, list[Camera], list[Contours]]:
    """The synthetic experiment of Boyer and Berger 1997, section 6.

    A sphere of radius 200 mm, the camera 1300 mm from its centre and turning about it in
    a plane, f = 1600 px, one contour sample a pixel.

    Args:
        step: rotation from view to view, rad.
        frames: number of views; the middle one of three is the one to reconstruct.
        noise_px: standard deviation of the uniform noise on each image coordinate.
        seed: of the noise.
        smooth: applied to each noisy contour; none if None.

    Returns:
        The sphere, its views and their contours.
    """
    ball = sphere(RADIUS_M)
    settings = TurntableSettings(frames=frames, step=step, distance=DISTANCE_M, elevation=0.0)
    cameras = turntable_cameras(settings)
    rng = np.random.default_rng(seed)
    contours = [ball.exact_contours(camera, stamp_ns=k) for k, camera in enumerate(cameras)]
    if noise_px > 0:
        contours = [
            noisy(c, camera, noise_px, rng, smooth)
            for c, camera in zip(contours, cameras, strict=True)
        ]
    return ball, cameras, contours


def noisy(
    contours: Contours,
    camera: Camera,
    noise_px: float,
    rng: np.random.Generator,
    smooth: Smoother | None = None,
) -> Contours:
    """Contours with uniform noise on each image coordinate of each sample.

    Directions and normals are found again from the noisy samples, as from an image.

    Args:
        contours: exact ones.
        camera: the view that they are of.
        noise_px: standard deviation on each coordinate, pixels.
        rng: source of the noise.
        smooth: applied to each noisy loop; without it the samples stay as they are, with
            noise_px declared as their sigma.
    """
    reach = np.sqrt(3) * noise_px
    uv = contours.uv + rng.uniform(-reach, reach, contours.uv.shape)
    loops = np.split(uv, contours.loop_starts[1:-1])
    ids = [int(contours.loop[row]) for row in contours.loop_starts[:-1]]
    sigma = [np.full(len(loop), noise_px) for loop in loops]
    if smooth is not None:
        smoothed = [smooth(loop) for loop in loops]
        loops, sigma = [s[0] for s in smoothed], [s[1] for s in smoothed]
    return contours_from_loops(camera, loops, ids, sigma, contours.stamp_ns, contours.frame_id)
