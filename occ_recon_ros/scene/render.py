"""Images of a scene object, anti-aliased by exact area coverage."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.settings import setting

from .coverage import coverage
from .objects import SceneObject
from .shading import shading
from .silhouette import Silhouette

Image = NDArray[np.uint8]

_SIDE_PX = 0.5
_COLOUR_BGR = np.array([150.0, 95.0, 55.0])
_BACKDROP_BGR = np.array([228.0, 232.0, 234.0])


@dataclass(frozen=True)
class RenderSettings:
    """How a scene object is imaged: a dark object before a plain light backdrop."""

    encoding: str = setting("mono8", "pixel format", choices=("mono8", "bgr8"))
    blur_px: float = setting(0.7, "standard deviation of the optical blur, px", within=(0.0, 20.0))
    noise: float = setting(0.0, "standard deviation of the noise, grey levels", within=(0.0, 100.0))
    noise_px: float = setting(
        0.0,
        "standard deviation of random displacements of the outline, one a pixel along it, px",
        within=(0.0, 20.0),
    )
    motion_blur_px: float = setting(
        0.0, "length of the motion blur along u, px", within=(0.0, 100.0)
    )


def render(
    scene_object: SceneObject,
    camera: Camera,
    settings: RenderSettings | None = None,
    seed: int = 0,
) -> Image:
    """The image of an object.

    Edges are anti-aliased by the exact area that the silhouette covers of each pixel.
    Blur and motion blur are symmetric, so the truth stays where it is.

    Args:
        scene_object: what to draw.
        camera: the view, distortion included.
        settings: the defaults if None.
        seed: of the random numbers; the same seed gives the same image.

    Returns:
        (height, width) uint8 for mono8, (height, width, 3) uint8 for bgr8.

    Raises:
        ValueError: an unknown encoding; the object is not wholly before the camera.
    """
    s = settings or RenderSettings()
    if s.encoding not in ("mono8", "bgr8"):
        raise ValueError(f"unknown encoding '{s.encoding}': use mono8 or bgr8")
    rng = np.random.default_rng(seed)
    outline = scene_object.silhouette(camera, _SIDE_PX if s.noise_px == 0 else 1.0)
    loops = silhouette_loops(outline)
    if s.noise_px > 0:
        loops = [_displaced(uv, rng.normal(0, s.noise_px, len(uv))) for uv in loops]
    covered = coverage(loops, camera.width, camera.height)
    light = shading(*scene_object.lit_samples, camera)
    return composed(covered, light, s, rng)


def silhouette_loops(outline: Silhouette) -> list[Array]:
    """The loops of a silhouette, each (n, 2) float64, pixels."""
    starts = np.flatnonzero(np.diff(outline.loop)) + 1
    return [uv for uv in np.split(outline.uv, starts) if len(uv)]


def composed(covered: Array, light: Array, s: RenderSettings, rng: np.random.Generator) -> Image:
    """Mix object and backdrop by coverage, then image them through the camera's faults.

    Args:
        covered: (height, width) float64, share of each pixel that the object covers.
        light: (height, width) float64, light on the object, 0 to 1.
        s: blur, noise and pixel format.
        rng: source of the noise.
    """
    if s.encoding == "mono8":
        grey = np.array([0.114, 0.587, 0.299])
        front, back = _COLOUR_BGR @ grey * _shade(light), float(_BACKDROP_BGR @ grey)
        image = back + covered * (front - back)
    else:
        front = _shade(light)[:, :, None] * _COLOUR_BGR
        image = _BACKDROP_BGR + covered[:, :, None] * (front - _BACKDROP_BGR)
    return photographed(image, s, rng)


def photographed(scene: Array, s: RenderSettings, rng: np.random.Generator) -> Image:
    """Blur, noise and rounding to grey levels of a (height, width[, 3]) float image."""
    image = np.asarray(scene, np.float32)
    if s.blur_px > 0:
        image = np.asarray(
            cv2.GaussianBlur(image, (0, 0), s.blur_px, borderType=cv2.BORDER_REPLICATE)
        )
    if s.motion_blur_px > 0:
        kernel = _box(s.motion_blur_px)
        image = np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE))
    if s.noise > 0:
        image = image + np.float32(s.noise) * rng.standard_normal(image.shape, np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _shade(light: Array) -> Array:
    return 0.45 + 0.75 * light


def _box(length: float) -> Array:
    """A centred box of any length (1, n), sampled by area; sums to 1."""
    half = int(np.ceil(0.5 * length - 0.5)) if length > 1 else 0
    x = np.arange(-half, half + 1)
    share = np.clip(np.minimum(x + 0.5, 0.5 * length) - np.maximum(x - 0.5, -0.5 * length), 0, 1)
    return (share / share.sum())[None]


def _displaced(uv: Array, by: Array) -> Array:
    """Move the samples of a loop across it."""
    along = np.roll(uv, -1, axis=0) - np.roll(uv, 1, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    moved: Array = uv + by[:, None] * across / np.linalg.norm(across, axis=1, keepdims=True)
    return moved
