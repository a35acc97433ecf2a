"""Image sequences of a turning vase under conditions that defeat a threshold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene import TurntableSettings, coverage, make_object, turntable_cameras

Array = NDArray[np.float64]

CASES = (
    "plain",
    "gradient backdrop",
    "matching backdrop",
    "cast shadow",
    "highlight",
    "noise 10",
    "motion blur 3 px",
    "flicker 30 %",
    "all at once",
)
CLEAN_FRAMES = 3  # at the start, before what is local in the image comes
LOCAL = ("matching backdrop", "cast shadow", "highlight")
_BACK, _FRONT = 180.0, 80.0
_VISIBLE = 25.0
_FRAMES, _STEP_DEG = 24, 5.0


@dataclass(frozen=True)
class Frame:
    """One image and what is true of it.

    Attributes:
        image: (h, w) uint8.
        camera: the view.
        truth: exact contours, samples half a pixel apart.
        visible: (n,) bool, whether the edge at each true sample stands out by 25 levels.
    """

    image: NDArray[np.uint8]
    camera: Camera
    truth: Contours
    visible: NDArray[np.bool_]


def stress_sequence(case: str) -> Iterator[Frame]:
    """The frames of one of CASES."""
    vase = make_object("vase")
    settings = TurntableSettings(frames=_FRAMES, step=float(np.deg2rad(_STEP_DEG)))
    rng = np.random.default_rng(CASES.index(case))
    faults = CASES[1:-1] if case == "all at once" else (case,)
    for i, camera in enumerate(turntable_cameras(settings)):
        truth = vase.exact_contours(camera, 0.5)
        back, front = _scene(
            [f for f in faults if i >= CLEAN_FRAMES or f not in LOCAL], camera, truth
        )
        share = coverage([truth.uv], camera.width, camera.height)
        sharp = back + share * (front - back)
        image = cv2.GaussianBlur(sharp, (0, 0), 0.8, borderType=cv2.BORDER_REPLICATE)
        if "motion blur 3 px" in faults:
            image = cv2.blur(image, (3, 1), borderType=cv2.BORDER_REPLICATE)
        if "flicker 30 %" in faults:
            image = image * (1 + 0.3 * np.sin(2.1 * i))
        image = image + rng.normal(0, 10.0 if "noise 10" in faults else 2.0, image.shape)
        at = np.round(truth.uv).astype(int)
        # What the edge is worth is the step across it, read off a few pixels to either side.
        contrast = (back - front)[at[:, 1], at[:, 0]]
        yield Frame(
            np.clip(np.round(image), 0, 255).astype(np.uint8),
            camera,
            truth,
            np.abs(contrast) > _VISIBLE,
        )


def _scene(faults: list[str], camera: Camera, truth: Contours) -> tuple[Array, Array]:
    """Grey values of backdrop and object over the whole image."""
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    low, high = truth.uv.min(axis=0), truth.uv.max(axis=0)
    back = np.full(x.shape, _BACK)
    # Shaded from the left, as a round object is.
    front = _FRONT + 25 * (low[0] - x) / (high[0] - low[0])
    if "gradient backdrop" in faults:
        back = 115 + 125 * x / camera.width
    if "matching backdrop" in faults:
        blob = _blob(x, y, (high[0] - 10, 0.5 * (low[1] + high[1])), (70, 45))
        back = back + blob * (front - back)
    if "cast shadow" in faults:
        foot = (high[0] - 20, high[1] - 15)
        back = back * (1 - 0.5 * _blob(x, y, foot, (150, 35)))
    if "highlight" in faults:
        blob = _blob(x, y, (low[0] + 25, 0.45 * low[1] + 0.55 * high[1]), (35, 40))
        front = front + blob * (_BACK + 10 - front)
    return back, front


def _blob(x: Array, y: Array, centre: tuple[float, float], radii: tuple[float, float]) -> Array:
    """1 inside an ellipse, 0 outside, with a soft edge."""
    r = np.hypot((x - centre[0]) / radii[0], (y - centre[1]) / radii[1])
    return 1 / (1 + np.exp(np.clip((r - 1) * 12, -60, 60)))
