"""The recorded sequences: their frames, and how far contours are from their masks."""

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene import coverage

Array = NDArray[np.float64]


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
    pieces = [contours.uv[a:b] for a, b in pairwise(contours.loop_starts)]
    return coverage(pieces, shape[1], shape[0]) > 0.5


def from_mask(uv: Array, mask: NDArray[np.uint8]) -> Array:
    """Distance of points from the squares that the mask's pixels are, to an eighth of a px."""
    fine = 8
    x, y, width, height = cv2.boundingRect(mask)
    part = np.pad(mask[y : y + height, x : x + width], 8)
    part = cv2.resize(part, None, fx=fine, fy=fine, interpolation=cv2.INTER_NEAREST)
    outside = cv2.distanceTransform(255 - part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    inside = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    at = np.floor((uv - [x - 8, y - 8] + 0.5) * fine).astype(int)
    at = np.clip(at, 0, np.array(part.shape[::-1]) - 1)
    return (np.maximum(outside, inside)[at[:, 1], at[:, 0]] - 0.5) / fine
