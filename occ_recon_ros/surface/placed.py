"""What a surface keeps of its rims, and of the strips between them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..geometry import Rim, Status


@dataclass(eq=False)
class PlacedRim:
    """A rim in the surface.

    Attributes:
        stamp_ns, prev_stamp_ns, frame_id: of the rim, and of the one before it.
        centre: (3,) float64, camera centre, metres.
        distance: from the camera to the object, metres; NaN where no point is good.
        vertex: (n,) int64, the vertex of each row, -1 where it is not good.
        loop: (n,) uint16, as in the rim.
        prev: (n,) float32, place in the rim before, NaN if none.
        strips: numbers of the strips that end at it.
    """

    stamp_ns: int
    prev_stamp_ns: int | None
    frame_id: str
    centre: NDArray[np.float64]
    distance: float
    vertex: NDArray[np.int64]
    loop: NDArray[np.uint16]
    prev: NDArray[np.float32]
    strips: list[int] = field(default_factory=list)

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays."""
        return self.vertex.nbytes + self.loop.nbytes + self.prev.nbytes

    def recalled(self, vertices: NDArray[np.float64], vertex_normals: NDArray[np.float64]) -> Rim:
        """The rim as far as the surface has it: its good points, and how they link.

        Args:
            vertices, vertex_normals: (v, 3) float64, all of the surface.
        """
        good = self.vertex >= 0
        points, normals = np.full((2, len(good), 3), np.nan)
        points[good] = vertices[self.vertex[good]]
        normals[good] = vertex_normals[self.vertex[good]]
        unknown = np.full(len(good), np.nan)
        return Rim(
            stamp_ns=self.stamp_ns,
            frame_id=self.frame_id,
            centre=self.centre,
            points=points,
            normals=normals,
            curvature=unknown,
            depth_sigma=unknown,
            loop=self.loop,
            prev=self.prev.astype(np.float64),
            status=np.where(good, Status.GOOD, Status.NO_CORRESPONDENT).astype(np.uint8),
            prev_stamp_ns=self.prev_stamp_ns,
        )


@dataclass(eq=False)
class Joined:
    """A strip: its rows among the triangles, and the rims that it joins, the later first."""

    start: int
    end: int
    ends: tuple[PlacedRim, PlacedRim]


def mean_known(one: float, other: float) -> float:
    """The mean of those of two numbers that are known, NaN if none is."""
    known = [number for number in (one, other) if number == number]
    return sum(known) / len(known) if known else float("nan")
