"""A sequence that is hard to find contours in, with the truth beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene.coverage import coverage
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.render import RenderSettings, photographed, silhouette_loops
from occ_recon_ros.scene.shading import shading

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StressSettings:
    """What makes the sequence hard; each fault can be left out by 0.

    Attributes:
        gradient: fall of the backdrop's grey across the image, 0 to 1.
        camouflage: share of the outline before a backdrop of the object's own grey, 0 to 0.5.
        shadow: depth of the cast shadow, 0 to 1.
        highlight: brightness of the highlight, grey levels.
        flicker: largest change of the exposure from 1, 0 to 0.9.
        visible_contrast: least contrast at which an edge counts as visible, grey levels.
        clean_frames: frames before camouflage, shadow and highlight come.
    """

    gradient: float = 0.35
    camouflage: float = 0.1
    shadow: float = 0.45
    highlight: float = 110.0
    flicker: float = 0.3
    visible_contrast: float = 25.0
    clean_frames: int = 0


BAD_LENS = RenderSettings(blur_px=0.8, motion_blur_px=3.0, noise=10.0)
"""How the images of a stress sequence are taken, if not told otherwise."""


@dataclass(frozen=True)
class StressFrame:
    """One image and what it shows.

    Attributes:
        image: (height, width) uint8.
        camera: the view.
        contours: the true contours.
        visible: (n,) bool, whether the edge can be seen at each of their samples.
        contrast: (n,) float64, grey levels from object to backdrop there, before noise.
    """

    image: NDArray[np.uint8]
    camera: Camera
    contours: Contours
    visible: NDArray[np.bool_]
    contrast: Array


def stress_sequence(
    scene_object: SceneObject,
    cameras: Sequence[Camera],
    settings: StressSettings | None = None,
    lens: RenderSettings = BAD_LENS,
    seed: int = 0,
) -> Iterator[StressFrame]:
    """Images of an object under bad conditions.

    The backdrop, with its gradient and its patch of camouflage, stays still while the
    object turns before it; so do shadow and highlight. The exposure changes at random.

    Args:
        scene_object: what to draw.
        cameras: the views.
        settings: the faults; all of them if None.
        lens: blur, motion blur and noise.
        seed: of noise and exposure.

    Yields:
        One frame a camera, in order.
    """
    s = settings or StressSettings()
    rng = np.random.default_rng(seed)
    still: _Stage | None = None
    for number, camera in enumerate(cameras):
        contours = scene_object.exact_contours(camera, stamp_ns=number)
        still = still or _Stage.around(contours, camera)
        local = 0.0 if number < s.clean_frames else 1.0
        front = 25.0 + 50.0 * shading(*scene_object.lit_samples, camera)
        front = front + local * s.highlight * still.highlight
        back = 195.0 * (1 - s.gradient * still.ramp) * (1 - local * s.shadow * still.shadow)
        hidden = 0.5 * local * s.camouflage * len(contours)
        patch = still.patch(hidden) if hidden > 0 else 0.0
        back = back + patch * (front - back)
        gain = 1 + s.flicker * rng.uniform(-1, 1)
        loops = silhouette_loops(scene_object.silhouette(camera, 0.5))
        covered = coverage(loops, camera.width, camera.height)
        image = photographed(gain * (back + covered * (front - back)), lens, rng)
        contrast = gain * map_coordinates(back - front, contours.uv.T[::-1], order=1)
        yield StressFrame(image, camera, contours, np.abs(contrast) >= s.visible_contrast, contrast)


@dataclass(frozen=True)
class _Stage:
    """What stands still in the image, each (height, width) float64, 0 to 1."""

    ramp: Array
    shadow: Array
    highlight: Array
    camouflaged: Array

    @classmethod
    def around(cls, contours: Contours, camera: Camera) -> _Stage:
        """Set the stage around the outline of the first view."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
        low, high = contours.uv.min(0), contours.uv.max(0)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        # Where the outline is farthest right, and where it is low on the left.
        right = contours.uv[np.argmax(contours.uv[:, 0])]
        foot = middle + half * [-0.5, 0.9]
        shine = middle + half * [-0.75, -0.1]
        blob = 0.3 * float(half.min())
        return cls(
            ramp=(u + 0.5 * v) / (camera.width + 0.5 * camera.height),
            shadow=np.exp(-0.5 * (((u - foot[0]) / half[0]) ** 2 + ((v - foot[1]) / 30) ** 2)),
            highlight=np.exp(-0.5 * ((u - shine[0]) ** 2 + (v - shine[1]) ** 2) / blob**2),
            camouflaged=np.hypot(u - right[0], v - right[1]),
        )

    def patch(self, radius: float) -> Array:
        """A disc of camouflage about its place, with a soft edge of a few pixels."""
        inside = np.clip((radius + 3.0 - self.camouflaged) / 6.0, 0, 1)
        return np.asarray(cv2.GaussianBlur(inside, (0, 0), 2.0), np.float64)
