"""The flat form of a surface: triangles by their corners, as the topics carry it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Strip:
    """Triangles, each by its three corners, outward by the right-hand rule.

    Attributes:
        stamp_ns: time of the rim that added them, nanoseconds.
        frame_id: name of the object frame.
        corners: (m, 3, 3) float32, metres: triangle, corner, xyz.
        normals: (m, 3, 3) float32, outward unit normals at the corners.
        depth_sigma: (m, 3) float32, 1 sigma of the depth at the corners, metres.
        rgb: (m, 3, 3) uint8, red green blue at the corners, or None without colour.
    """

    stamp_ns: int
    frame_id: str
    corners: NDArray[np.float32]
    normals: NDArray[np.float32]
    depth_sigma: NDArray[np.float32]
    rgb: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        return len(self.corners)
