"""Epipolar correspondence (Boyer and Berger 1997, section 2.1).

p on contour O and p_i on contour O_i correspond when (T x T_i).(C - C_i) = 0: both rays lie
in one plane through the two camera centres. All such planes form a pencil. Two numbers give
a ray in it: the angle phi of its plane about the baseline, and its angle alpha from the
baseline within the plane. Correspondents have one phi, so that matching is a look-up of phi
along the monotone runs of the other contour. A run ends where the plane is tangent to the
surface, at a frontier point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, cross
from .compiled import compiled
from .contours import Contours

_ALONG_RAY = 1e-4  # rad between a ray and the baseline, below which no plane is defined


@dataclass(frozen=True)
class PencilView:
    """One view's n samples in a pencil; (n,) float64 each.

    In its plane a ray is T = cos alpha e + sin alpha u, with e along the baseline and u
    across it. Its surface normal is split over the basis across T: n = -sin alpha e +
    cos alpha u in the plane, towards growing alpha, and v = e x u across the plane.

    Attributes:
        phi: angle of the plane, rad, zero towards the object.
        cos, sin: of alpha, the angle of the ray from the baseline, 0 to pi.
        N_n, N_v: N.n and N.v, the normal in and across the plane.
    """

    phi: Array
    cos: Array
    sin: Array
    N_n: Array
    N_v: Array

    @staticmethod
    def of(contours: Contours, frame: Array) -> PencilView:
        """From the rows e, e1, e2 of a frame, e along the baseline and e1 where phi is 0."""
        return PencilView(*compiled().pencil_view(frame, contours.T, contours.N))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All five."""
        return self.phi, self.cos, self.sin, self.N_n, self.N_v


class Pencil:
    """A view's contours and another's, seen from two different centres.

    Attributes:
        contours, other: the two, of n and m samples.
        baseline: metres from the first centre to the other's.
        here, there: their PencilView. Not there unless ``defined``.
        defined: whether there is a baseline, and samples in both.
    """

    def __init__(self, contours: Contours, other: Contours) -> None:
        self.contours, self.other = contours, other
        step = other.centre - contours.centre
        self.baseline = float(np.sqrt(step @ step))
        self.defined = bool(len(contours) and len(other) and self.baseline > 0)
        if self.defined:
            frame = _frame(step / self.baseline, contours.middle + other.middle)
            self.here = PencilView.of(contours, frame)
            self.there = PencilView.of(other, frame)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.contours)

    @cached_property
    def along_ray(self) -> NDArray[np.bool_]:
        """(n,) where the camera moved along the sample's ray: no plane is defined."""
        if not self.defined:
            return np.full(len(self), self.baseline == 0)
        return self.here.sin < _ALONG_RAY


@dataclass(frozen=True)
class Candidates:
    """The points of another contour in the epipolar planes of samples, one entry each.

    A sample may have none, one or many; entries are stored sample by sample.

    Attributes:
        sample: (m,) intp, ascending, row of the view's contours.
        row: (m,) intp, row of the other contour before the crossing.
        fraction: (m,) float64, 0-1, how far to the next row the crossing lies.
    """

    sample: Index
    row: Index
    fraction: Array

    def __len__(self) -> int:
        return len(self.sample)

    def take(self, entries: Index | NDArray[np.bool_]) -> Candidates:
        """Some of them."""
        return Candidates(self.sample[entries], self.row[entries], self.fraction[entries])


def _frame(axis: Array, forward: Array) -> Array:
    """Rows: the axis, across it towards the object if that is defined, and across both."""
    e1 = forward - (forward @ axis) * axis
    if e1 @ e1 < 1e-18:
        e1 = np.eye(3)[np.argmin(np.abs(axis))]
        e1 = e1 - (e1 @ axis) * axis
    e1 = e1 / np.sqrt(e1 @ e1)
    return np.array([axis, e1, cross(axis, e1)])
