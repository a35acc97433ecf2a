"""Occluding contours of one view, as viewing directions and tangent planes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, dot, lengths

_GAP_FACTOR = 4.0  # times the median step: the outline does not follow so long a one
_MOST_OF = 0.9  # of the samples, that tell how large the object is


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

    def by_loop(self, values: NDArray) -> list[NDArray]:
        """Values (n, ...) of the samples, an array a loop."""
        return np.split(values, self.loop_starts[1:-1]) if len(self) else []

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
        linked: NDArray[np.bool_] = self._pixels <= _GAP_FACTOR * np.median(self._pixels)
        return linked

    @cached_property
    def turning(self) -> Array:
        """(n,) turn of the normal times the step to the next row: eight times the height
        of the contour over the middle of the segment."""
        return dot(self._to_next(self.N), self._to_next(self.T))

    @cached_property
    def radians_per_pixel(self) -> float:
        """Angle that a pixel subtends, in the median along the contours; NaN where none is."""
        good = self.linked & (self._pixels > 0)
        angle = lengths(self._to_next(self.T))[good]
        usual = float(np.median(angle / self._pixels[good])) if len(angle) else 0.0
        return usual if usual > 0 else float("nan")

    @cached_property
    def middle(self) -> Array:
        """(3,) the mean of the viewing directions, not of length 1."""
        mean: Array = np.full(len(self), 1 / max(len(self), 1)) @ self.T
        return mean

    @cached_property
    def angular_radius(self) -> float:
        """Half the angle that the object fills, radians: that within which nine tenths of the
        samples are of the middle, so that a speck far off says nothing."""
        off = self.T - self.middle
        square = dot(off, off)
        most = int(_MOST_OF * (len(square) - 1))
        return float(np.sqrt(np.partition(square, most)[most]))

    @cached_property
    def usual_sigma(self) -> float:
        """Median of the sigmas that are known, radians; infinite if none is."""
        known = self.sigma[np.isfinite(self.sigma)]
        return float(np.median(known)) if len(known) else float("inf")

    def split(self, position: Array) -> tuple[NDArray[np.intp], Array]:
        """Positions along the loops (k,), fractional rows, as rows before and fractions of the
        step from there to the next; 0 and NaN where a position is NaN."""
        known = np.isfinite(position)
        # Row and fraction may have rounded up to the row past the last: the whole last step.
        row = np.minimum(np.where(known, position, 0.0), max(len(self) - 1, 0)).astype(np.intp)
        return row, position - row

    def nearest_row(self, position: Array) -> NDArray[np.intp]:
        """(k,) the sample nearest to each position (k,), on its own loop."""
        row, fraction = self.split(position)
        return np.where(fraction < 0.5, row, self.next_row[row])

    def at(self, values: Array, row: NDArray[np.intp], fraction: Array) -> Array:
        """(k, ...) values (n, ...) of the samples, a fraction (k,) of the step after rows (k,)."""
        f = fraction.reshape(fraction.shape + (1,) * (values.ndim - 1))
        here = values.take(row, axis=0)
        between: Array = here + f * (values.take(self.next_row[row], axis=0) - here)
        return between

    def directions_at(self, row: NDArray[np.intp], fraction: Array) -> Array:
        """(k, 3) unit viewing directions, a fraction of the step after rows.

        Between two samples the contour bulges from its chord towards its normals; to
        second order by f (1 - f) / 2 times the turn of the normal along the step.
        """
        bulge = 0.5 * fraction * (1 - fraction) * self.turning[row]
        return _unit(self.at(self.T, row, fraction) + bulge[:, None] * self.N[row])

    def normals_at(self, row: NDArray[np.intp], fraction: Array) -> Array:
        """(k, 3) unit normals, a fraction of the step after rows."""
        return _unit(self.at(self.N, row, fraction))

    @cached_property
    def _pixels(self) -> Array:
        """(n,) length of the step to the next row, pixels."""
        return lengths(self._to_next(self.uv))

    def _to_next(self, values: Array) -> Array:
        """(n, k) change of values (n, k) to the next row."""
        change: Array = values.take(self.next_row, axis=0) - values
        return change


def no_contours(stamp_ns: int, frame_id: str) -> Contours:
    """Contours without samples: stamped earlier than the last, they begin a new scan."""
    none = np.zeros((0, 3))
    loop, sigma = np.zeros(0, np.uint16), np.zeros(0)
    return Contours(stamp_ns, frame_id, np.zeros(3), none, none, np.zeros((0, 2)), loop, sigma)


def _unit(vectors: Array) -> Array:
    """(k, 3) made of length 1."""
    return vectors / lengths(vectors)[:, None]
