"""The rim: the curve on the surface along which viewing rays touch it."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, lengths
from .contours import Contours


class Status(IntEnum):
    """What is known of a rim point."""

    GOOD = 0
    DOUBLE = 1
    """Double or frontier point: one of the partners sees the very same surface point."""
    ILL_CONDITIONED = 2
    """a_-1 is near a_1: the two partners say the same."""
    NO_CORRESPONDENT = 3
    OUTSIDE = 4
    """The point projects outside another silhouette."""
    MOTION_ALONG_RAY = 5


@dataclass(frozen=True)
class Rim:
    """Rim points of one view, one row for each row of its Contours, in the same order.

    Attributes:
        stamp_ns: time of the image, nanoseconds.
        frame_id: name of the object frame.
        centre: (3,) float64, camera centre, metres, object frame.
        points: (n, 3) float64, metres, object frame; NaN where none could be computed.
        normals: (n, 3) float64, outward unit normals.
        curvature: (n,) float64, normal curvature k_t along the viewing direction, 1/m,
            positive on a convex object; NaN where unknown.
        depth_sigma: (n,) float64, 1 sigma of the depth along the ray, metres.
        loop: (n,) uint16, as in Contours.
        prev: (n,) float64, row position (fractional) of the epipolar correspondent in the
            rim of the previous frame, NaN if none.
        status: (n,) uint8, a Status.
        prev_stamp_ns: the stamp of that previous frame, nanoseconds; None if there is none.
    """

    stamp_ns: int
    frame_id: str
    centre: Array
    points: Array
    normals: Array
    curvature: Array
    depth_sigma: Array
    loop: NDArray[np.uint16]
    prev: Array
    status: NDArray[np.uint8]
    prev_stamp_ns: int | None = None

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def depth(self) -> Array:
        """(n,) metres along the rays, NaN where there is no point."""
        return lengths(self.points - self.centre)


def empty_rim(contours: Contours) -> Rim:
    """A rim of which nothing could be computed."""
    n = len(contours)
    nan = np.full(n, np.nan)
    return Rim(
        stamp_ns=contours.stamp_ns,
        frame_id=contours.frame_id,
        centre=contours.centre,
        points=np.full((n, 3), np.nan),
        normals=contours.N,
        curvature=nan,
        depth_sigma=nan,
        loop=contours.loop,
        prev=nan,
        status=np.full(n, Status.NO_CORRESPONDENT, np.uint8),
    )
