"""Occluding contours of one view, as viewing directions and tangent planes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GAP_FACTOR = 4.0


@dataclass(frozen=True)
class Contours:
    """The occluding contours seen from one camera centre, one row a sample.

    Loops are stored one after the other, each closed. As the image is displayed, walking
    a loop in stored order has the object on the left: outer loops run counter-clockwise
    on the screen, holes clockwise.

    Attributes:
        stamp_ns: time of the image, nanoseconds.
        frame_id: name of the object frame; all vectors are in it.
        centre: (3,) float64, camera centre C, metres.
        T: (n, 3) float64, unit viewing directions; the surface point is C + depth T.
        N: (n, 3) float64, outward unit surface normals on those rays, perpendicular to T
            and to the contour.
        uv: (n, 2) float64, pixels in the image as received (distorted).
        loop: (n,) uint16, identity of the loop, kept from frame to frame while tracked.
        sigma: (n,) float64, 1 sigma of the contour position across itself, radians of
            viewing direction; infinite where no surface may be made from the sample
            (a corner, a T-junction, a contact with the table).
    """

    stamp_ns: int
    frame_id: str
    centre: Array
    T: Array
    N: Array
    uv: Array
    loop: NDArray[np.uint16]
    sigma: Array

    def __len__(self) -> int:
        return len(self.T)

    @cached_property
    def loop_starts(self) -> NDArray[np.intp]:
        """(loops + 1,) first row of each loop, and n at the end."""
        n = len(self.loop)
        changes = np.flatnonzero(np.diff(self.loop)) + 1 if n else np.zeros(0, np.intp)
        return np.concatenate([[0], changes, [n]]) if n else np.zeros(1, np.intp)

    @cached_property
    def next_row(self) -> NDArray[np.intp]:
        """(n,) the row after each row along its closed loop."""
        rows = np.arange(1, len(self) + 1)
        rows[self.loop_starts[1:] - 1] = self.loop_starts[:-1]
        return rows

    @cached_property
    def previous_row(self) -> NDArray[np.intp]:
        """(n,) the row before each row along its closed loop."""
        rows = np.empty(len(self), np.intp)
        rows[self.next_row] = np.arange(len(self))
        return rows

    @cached_property
    def linked(self) -> NDArray[np.bool_]:
        """(n,) False where the step to the next row jumps over a gap (a loop cut by the
        image border, say), so that the outline does not follow the segment."""
        if not len(self):
            return np.zeros(0, bool)
        step = np.hypot(*(self.uv.take(self.next_row, axis=0) - self.uv).T)
        return step <= _GAP_FACTOR * np.median(step)

    @cached_property
    def bend(self) -> Array:
        """(n,) turn of the normal times the step to the next row: eight times the height
        of the contour over the middle of the segment."""
        after = self.next_row
        turn: Array = ((self.N[after] - self.N) * (self.T[after] - self.T)).sum(axis=1)
        return turn

    @cached_property
    def radians_per_pixel(self) -> float:
        """Angle that a pixel subtends, in the median along the contours."""
        pixels = np.linalg.norm(self.uv[self.next_row] - self.uv, axis=1)
        angle = np.linalg.norm(self.T[self.next_row] - self.T, axis=1)
        good = self.linked & (pixels > 0)
        return float(np.median(angle[good] / pixels[good])) if good.any() else float("nan")
