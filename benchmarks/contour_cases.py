"""Images with known outlines for the benchmark of the contours."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from truth import outline_errors

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene import coverage

Array = NDArray[np.float64]

_CORNERS_A_PX = 8


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


def real_frames(folder: Path) -> Iterator[tuple[NDArray, NDArray[np.uint8], Camera]]:
    """Image, mask and camera of each frame of a folder with cameras.json."""
    described = json.loads((folder / "cameras.json").read_text())
    for frame in described["frames"]:
        D = frame.get("D") or []
        yield (
            np.asarray(cv2.imread(str(folder / frame["file"]))),
            np.asarray(cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE), np.uint8),
            Camera(
                np.array(frame["K"]),
                frame["width"],
                frame["height"],
                np.array(frame["R"]),
                np.array(frame["t"]) * described["unit_in_metres"],
                np.array(D),
                "plumb_bob" if len(D) else "none",
            ),
        )


def region(contours: Contours, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """(h, w) the pixels of which more than half lies inside of the contours."""
    starts = contours.loop_starts
    pieces = [contours.uv[a:b] for a, b in pairwise(starts)]
    return coverage(pieces, shape[1], shape[0]) > 0.5
