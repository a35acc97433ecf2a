"""Frames of a live scan, packed, for the time when all of them are looked at together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera, Contours, contours_from_loops
from .alone import Mask, filled

_QUALITY = 95  # of the JPEG
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]


@dataclass(frozen=True)
class PackedFrame:
    """An image, as JPEG (PNG where it has 16 bits), its camera in the object frame, and the outline
    that was found in it.

    Attributes:
        code: (n,) uint8, the file of the image; empty where it is left out.
        loops: (n, 2) float32 each, px, closed, the object on the left; none where none was found.
    """

    stamp_ns: int
    code: NDArray[np.uint8]
    camera: Camera
    loops: tuple[NDArray[np.float32], ...] = ()

    @staticmethod
    def of(
        image: NDArray[Any], camera: Camera, stamp_ns: int, found: Contours | None = None
    ) -> PackedFrame:
        """Pack an image, (h, w) or (h, w, 3) BGR, uint8 or uint16."""
        kind, how = (".png", []) if image.dtype == np.uint16 else (".jpg", _JPEG)
        code = np.asarray(cv2.imencode(kind, image, how)[1])
        loops = () if found is None else tuple(found.by_loop(found.uv.astype(np.float32)))
        return PackedFrame(stamp_ns, code, camera, loops)

    @property
    def nbytes(self) -> int:
        """Of image and outline."""
        return int(self.code.nbytes + sum(loop.nbytes for loop in self.loops))

    @property
    def image(self) -> NDArray[Any]:
        """(h, w) or (h, w, 3) BGR."""
        return np.asarray(cv2.imdecode(self.code, cv2.IMREAD_UNCHANGED))

    @property
    def bare(self) -> PackedFrame:
        """The same without its image."""
        return replace(self, code=self.code[:0].copy())

    def outline(self) -> Contours | None:
        """As it was found, but for its sigma; None where none was."""
        if not self.loops:
            return None
        loops = [loop.astype(np.float64) for loop in self.loops]
        sigma = [np.ones(len(loop)) for loop in loops]
        names = list(range(len(loops)))
        return contours_from_loops(self.camera, loops, names, sigma, self.stamp_ns, "object")

    def mask(self) -> Mask:
        """(h, w) coverage by the outline, 255 = object."""
        loops = [loop.astype(np.float64) for loop in self.loops]
        return filled(loops, (self.camera.height, self.camera.width))


class KeptFrames:
    """Frames of a scan in bounded memory: where there are too many, the older one of the two
    whose cameras are nearest to each other goes, so that the rest stay spread evenly.

    Args:
        most: frames.
        most_bytes: of them, packed.
    """

    def __init__(self, most: int, most_bytes: int) -> None:
        self._most, self._most_bytes = most, most_bytes
        self.frames: list[PackedFrame] = []
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self.frames)

    def clear(self) -> None:
        """Keep none."""
        self.frames, self.nbytes = [], 0

    @property
    def centres(self) -> NDArray[np.float64]:
        """(n, 3) of the cameras, metres, object frame, in the order of time."""
        return np.array([frame.camera.centre for frame in self.frames]).reshape(-1, 3)

    def add(self, frame: PackedFrame) -> None:
        """Keep a frame later than all before."""
        self.frames.append(frame)
        self.nbytes += frame.nbytes
        while len(self.frames) > self._most or self.nbytes > self._most_bytes:
            self.nbytes -= self.frames.pop(self._least_needed()).nbytes

    def _least_needed(self) -> int:
        if len(self.frames) < 3:
            return 0
        C = self.centres
        apart = np.linalg.norm(C[:, None] - C, axis=2)
        apart[np.tril_indices(len(C))] = np.inf
        return int(np.unravel_index(apart.argmin(), apart.shape)[0])
