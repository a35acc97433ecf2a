"""Images with known outlines for the benchmark of the contours."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scenes import BAD_LENS, StressFrame, StressSettings, stress_sequence
from truth import outline_errors

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.scene import (
    RenderSettings,
    TurntableSettings,
    coverage,
    make_object,
    turntable_cameras,
)

Array = NDArray[np.float64]

_CORNERS_A_PX = 8
_FAR = 20.0

_CLEAN_FRAMES, _STEP_RAD = 3, np.deg2rad(5.0)
_LENS = RenderSettings(blur_px=0.8, noise=2.0)
_CALM = StressSettings(0.0, 0.0, 0.0, 0.0, 0.0, clean_frames=_CLEAN_FRAMES)

STRESS = {
    "plain": (_CALM, _LENS),
    "gradient backdrop": (replace(_CALM, gradient=0.35), _LENS),
    "matching backdrop": (replace(_CALM, camouflage=0.1), _LENS),
    "cast shadow": (replace(_CALM, shadow=0.45), _LENS),
    "highlight": (replace(_CALM, highlight=110.0), _LENS),
    "noise 10": (_CALM, replace(_LENS, noise=10.0)),
    "motion blur 3 px": (_CALM, replace(_LENS, motion_blur_px=3.0)),
    "flicker 30 %": (replace(_CALM, flicker=0.3), _LENS),
    "all at once": (StressSettings(clean_frames=_CLEAN_FRAMES), BAD_LENS),
}
"""What makes each of the stress sequences hard; what is local comes after a few frames."""


@dataclass(frozen=True)
class EllipseCase:
    """A dark ellipse before a light ground.

    Attributes:
        image: (h, w) uint8.
        camera: of that size.
        outline: (n, 2) float64, px, dense, object on the left as displayed.
    """

    image: NDArray[np.uint8]
    camera: Camera
    outline: Array

    def errors(self, uv: Array) -> Array:
        """(n,) px, how far points lie outside of the ellipse."""
        following = np.roll(np.arange(len(self.outline)), -1)
        return outline_errors(uv, self.outline, following)[0]


def ellipse_case(
    radius: float, blur: float, contrast: float, noise: float, seed: int
) -> EllipseCase:
    """An ellipse of mean radius ``radius`` px, anywhere, any way up, up to 1:1.5; every other
    one a disc. Its tightest bend has at least the radius of 0.6 ``radius``."""
    rng = np.random.default_rng([seed, int(radius), int(10 * blur), int(contrast), int(noise)])
    stretch = 1.0 if seed % 2 == 0 else np.sqrt(rng.uniform(1.0, 1.4))
    size = int(2 * stretch * radius) + 40
    centre = size / 2 + rng.uniform(-0.5, 0.5, 2)
    t = -np.linspace(0, 2 * np.pi, int(2 * np.pi * radius * _CORNERS_A_PX), endpoint=False)
    c, s = np.cos(a := rng.uniform(0, np.pi)), np.sin(a)
    x, y = stretch * radius * np.cos(t), radius / stretch * np.sin(t)
    outline = np.column_stack([c * x - s * y, s * x + c * y]) + centre
    image = 128 + contrast / 2 - contrast * coverage([outline], size, size)
    image = cv2.GaussianBlur(image, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    image = image + rng.normal(0, noise, image.shape) if noise else image
    K = np.array([[1600, 0, size / 2], [0, 1600, size / 2], [0, 0, 1.0]])
    camera = Camera(K, size, size, np.eye(3), np.array([0, 0, 1.0]))
    return EllipseCase(np.clip(np.round(image), 0, 255).astype(np.uint8), camera, outline)


def stress_frames(case: str, count: int) -> list[tuple[StressFrame, bool]]:
    """Frames of a vase that turns by 5 degrees a frame, and whether each is to be judged."""
    settings, lens = STRESS[case]
    cameras = turntable_cameras(TurntableSettings(frames=count, step=float(_STEP_RAD)))
    frames = stress_sequence(make_object("vase"), cameras, settings, lens)
    return [(frame, i >= _CLEAN_FRAMES) for i, frame in enumerate(frames)]


def stress_distances(
    frames: Iterable[tuple[StressFrame, bool]], tracking: str
) -> tuple[Array, Array, int]:
    """What a tracker makes of a stress sequence.

    Returns:
        How far from the contour found each true sample is where the edge can be seen, and
        where it cannot, px, of all frames that are judged; and how many frames were dropped.
    """
    tracker = ContourTracker(ContourSettings(segmentation="threshold", tracking=tracking))
    seen, unseen, drops = [], [], 0
    for i, (frame, judged) in enumerate(frames):
        distance = np.full(len(frame.contours), _FAR)
        try:
            found = tracker.process(frame.image, frame.camera, i, "turntable")
            distance = distances(frame.contours, found)
        except ContourError:
            drops += 1
        if judged:
            seen.append(distance[frame.visible])
            unseen.append(distance[~frame.visible])
    return np.concatenate(seen), np.concatenate(unseen), drops


def distances(truth: Contours, found: Contours) -> Array:
    """(n,) from each true sample to the contour found, px, at most 20."""
    return np.minimum(np.abs(outline_errors(truth.uv, found.uv, found.next_row)[0]), _FAR)
