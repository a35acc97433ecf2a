"""Epipolar correspondence by the angle in the pencil of planes through the baseline.

p on contour O and p_i on O_i correspond when (T x T_i).(C - C_i) = 0: both rays lie in one
plane through the two camera centres (Boyer and Berger 1997, section 3). All such planes
form a pencil, so that a contour point is known to it by one angle and the match is a
look-up of that angle along the monotone runs of the other contour. A run ends where the
plane is tangent to the surface, at a frontier point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .pencil import Pencil

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_ALONG_RAY = 1e-4  # rad between a ray and the baseline, below which no plane is defined


@dataclass(frozen=True)
class Candidates:
    """The points of another contour in the epipolar plane of each sample.

    K is the largest number of candidates that a sample has; rows are padded.

    Attributes:
        valid: (n, K) bool.
        row: (n, K) intp, row of the other contour before the crossing.
        fraction: (n, K) float64, 0-1, how far to the next row the crossing lies.
        along_ray: (n,) bool, the camera moved along the sample's ray: no plane.
    """

    valid: NDArray[np.bool_]
    row: Index
    fraction: Array
    along_ray: NDArray[np.bool_]

    def directions(self, contours: Contours) -> Array:
        """(n, K, 3) unit viewing directions of the candidates.

        Between two samples the contour bulges from its chord towards its normals; to
        second order by f (1 - f) / 2 times the turn of the normal along the step.
        """
        bulge = 0.5 * self.fraction * (1 - self.fraction) * contours.bend[self.row]
        T = (
            self.interpolate(contours.T, contours.next_row)
            + bulge[..., None] * contours.N[self.row]
        )
        return T / np.linalg.norm(T, axis=-1, keepdims=True)

    def interpolate(self, values: Array, after: Index) -> Array:
        """(n, K, ...) values (m, ...) of the other contour's samples at the candidates.

        Args:
            values: one entry a row of the other contour.
            after: its ``next_row``.
        """
        f = self.fraction.reshape(self.fraction.shape + (1,) * (values.ndim - 1))
        return (1 - f) * values[self.row] + f * values[after[self.row]]

    def column(self, k: Index) -> Candidates:
        """One candidate of each sample: K = 1, not valid where k is negative."""
        here, none = np.arange(len(k)), np.zeros((len(k), 1))
        if not self.valid.shape[1]:
            row = none.astype(np.intp)
            return Candidates(none.astype(bool), row, none, self.along_ray)
        valid = (self.valid[here, k] & (k >= 0))[:, None]
        row, fraction = self.row[here, k][:, None], self.fraction[here, k][:, None]
        return Candidates(valid, row, fraction, self.along_ray)

    def rows(self, rows: Index) -> Candidates:
        """Those of some samples."""
        fraction = self.fraction[rows]
        return Candidates(self.valid[rows], self.row[rows], fraction, self.along_ray[rows])


def epipolar_candidates(pencil: Pencil) -> Candidates:
    """All points of another contour that may correspond to each sample of a contour.

    The order rule is built in: along both contours the object is on the same side, so
    that at a correspondence the angle in the pencil runs the same way on both. On either
    side of a frontier point it runs opposite ways, which tells its two close candidates
    apart.

    Args:
        pencil: of the contour, n samples, and the other.

    Returns:
        Candidates of the n samples on the other contour.
    """
    n = len(pencil)
    if not pencil.defined:
        empty = np.zeros((n, 0))
        none = empty.astype(np.intp)
        return Candidates(empty.astype(bool), none, empty, np.full(n, pencil.baseline == 0))
    phi, phi_other = pencil.here.phi, pencil.there.phi
    along_ray = pencil.here.sin < _ALONG_RAY

    other = pencil.other
    phi_after = phi_other[other.next_row]
    step = phi_after - phi_other
    # A step over half a turn is the cut of the angle behind the epipole, not a segment.
    segment = other.linked & (step != 0) & (np.abs(step) < np.pi)

    sample, row = _crossings(phi, phi_other, phi_after, segment)
    keep = (np.sign(step[row]) == pencil.way[sample]) & ~along_ray[sample]
    sample, row = sample[keep], row[keep]

    count = np.bincount(sample, minlength=n)
    shape = (n, int(count.max(initial=0)))
    rank = np.zeros(len(sample), np.intp)
    if shape[1] > 1:
        order = np.argsort(sample, kind="stable")
        sample, row = sample[order], row[order]
        rank = np.arange(len(sample)) - np.repeat(np.cumsum(count) - count, count)
    valid = np.zeros(shape, bool)
    rows = np.zeros(shape, np.intp)
    fraction = np.zeros(shape)
    valid[sample, rank] = True
    rows[sample, rank] = row
    fraction[sample, rank] = (phi[sample] - phi_other[row]) / step[row]
    return Candidates(valid, rows, fraction, along_ray)


def _crossings(
    phi: Array, start: Array, end: Array, segment: NDArray[np.bool_]
) -> tuple[Index, Index]:
    """All pairs (sample, segment) where the segment passes the sample's angle.

    A segment owns its lower end and not its upper one, so that an angle on a vertex is
    found once by each run.
    """
    order = np.argsort(phi)
    ends = np.stack([np.minimum(start, end), np.maximum(start, end)])
    low, high = np.searchsorted(phi[order], ends)
    count = np.where(segment, high - low, 0)
    row = np.repeat(np.arange(len(start)), count)
    offset = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return order[low[row] + offset], row
