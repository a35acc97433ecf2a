"""Two views in the pencil of planes through their centres: epipolar geometry in polar
coordinates.

Every ray lies in one plane of the pencil. Two numbers give it: the plane's angle phi about
the baseline, and its angle alpha from the baseline within the plane. Correspondents have one
phi, so that matching is a look-up of phi, and crossing two rays is plane trigonometry on
alpha. Both are worked out once for a pair of views and serve matching, depth, frontier
points and the link to the previous rim.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .contours import Contours
from .quadric import Crossing

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_LEAST_COS = 0.1  # of normal and plane, where the outline is taken to cross the planes


@dataclass(frozen=True)
class PencilView:
    """One view's n samples in a pencil; (n,) float64 each.

    In its plane a ray is T = cos alpha e + sin alpha u, with e along the baseline and u
    across it. Its surface normal is split over the basis across T: n = -sin alpha e +
    cos alpha u in the plane, towards growing alpha, and v = e x u across the plane.

    Attributes:
        phi: angle of the plane, rad, zero towards the object.
        alpha: angle of the ray from the baseline, rad, 0 to pi.
        cos, sin: of alpha.
        N_n, N_v: N.n and N.v, the normal in and across the plane.
    """

    phi: Array
    alpha: Array
    cos: Array
    sin: Array
    N_n: Array
    N_v: Array

    @staticmethod
    def of(contours: Contours, frame: Array) -> PencilView:
        """From the rows e, e1, e2 of a frame, e along the baseline and e1 where phi is 0."""
        cos, x, y = frame @ contours.T.T
        sin = np.sqrt(x * x + y * y)
        along, N_x, N_y = frame @ contours.N.T
        with np.errstate(divide="ignore", invalid="ignore"):
            N_n = cos * (N_x * x + N_y * y) / sin - sin * along
            N_v = (N_y * x - N_x * y) / sin
        return PencilView(np.arctan2(y, x), np.arctan2(sin, cos), cos, sin, N_n, N_v)


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
        self.baseline = float(np.linalg.norm(step))
        self.defined = bool(len(contours) and len(other) and self.baseline > 0)
        if self.defined:
            frame = _frame(step / self.baseline, _middle(contours) + _middle(other))
            self.here = PencilView.of(contours, frame)
            self.there = PencilView.of(other, frame)

    def alpha(self, row: Index, fraction: Array) -> Array:
        """Angle alpha of the other contour at places between its samples.

        Exact to second order in the step: the outline bulges towards its normal, and the
        straight chord between two rays is itself bent in (phi, alpha).

        Args:
            row: the sample before.
            fraction: of the step to the next, in phi, 0-1; of one shape with row.
        """
        step, bulge = self._steps
        return self.there.alpha[row] + fraction * (step[row] + (1 - fraction) * bulge[row])

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """(m,) change of alpha to the next row, and four times by how much it is greater in
        the middle of the segment than on the straight line between its ends."""
        there, after = self.there, self.other.next_row
        dphi, dalpha = there.phi[after] - there.phi, there.alpha[after] - there.alpha
        N_n, cos, sin = ((x + x[after]) / 2 for x in (there.N_n, there.cos, there.sin))
        N_n = np.copysign(np.maximum(np.abs(N_n), _LEAST_COS), N_n)
        with np.errstate(divide="ignore", invalid="ignore"):
            chord = cos * (dphi**2 * sin + 2 * dalpha**2 / sin)
        return dalpha, 0.5 * (self.other.bend / N_n - chord)

    def crossing(self, alpha: Array) -> Crossing:
        """Cross each ray of the view with others of its plane.

        Args:
            alpha: (n, K) float64, rad, angles of rays from the other centre.

        Returns:
            Crossing of arrays (n, K); NaN where alpha is, infinite where rays are parallel.

        Source:
            ``quadric.crossing``, by plane trigonometry: in the triangle of the baseline b and
            both rays d_i = b sin alpha_i / sin(alpha_i - alpha), and with cos b_i = |N.n| and
            T_i.N_i = sign(N.n) sin(alpha_i - alpha) the paper's a_i is (N.n) tan(alpha_i -
            alpha).
        """
        here = self.here
        apart = alpha - here.alpha[:, None]
        sin, cos = np.sin(apart), np.cos(apart)
        N_n = here.N_n[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = self.baseline / sin
            return Crossing(
                d=scale * np.sin(alpha),
                a=N_n * sin / np.abs(cos),
                sin=np.where(N_n < 0, -sin, sin),
                cos_b=np.broadcast_to(np.abs(N_n), alpha.shape),
                d_other=scale * here.sin[:, None],
            )

    def turn_of_normal(self, row: Index, fraction: Array, alpha: Array) -> Array:
        """(n, K) angle between the normals of samples and of candidates, rad."""
        here, there, after = self.here, self.there, self.other.next_row
        N_n = there.N_n[row] + fraction * (there.N_n[after] - there.N_n)[row]
        N_v = there.N_v[row] + fraction * (there.N_v[after] - there.N_v)[row]
        cos = here.N_n[:, None] * N_n * np.cos(alpha - here.alpha[:, None])
        return np.arccos(np.clip(cos + here.N_v[:, None] * N_v, -1, 1))


def _middle(contours: Contours) -> Array:
    """(3,) the middle viewing direction, not of length 1."""
    middle: Array = contours.T.mean(axis=0)
    return middle


def _frame(axis: Array, forward: Array) -> Array:
    """Rows: the axis, across it towards the object if that is defined, and across both."""
    e1 = forward - (forward @ axis) * axis
    if np.linalg.norm(e1) < 1e-9:
        e1 = np.eye(3)[np.argmin(np.abs(axis))]
        e1 = e1 - (e1 @ axis) * axis
    e1 = e1 / np.linalg.norm(e1)
    return np.stack([axis, e1, np.cross(axis, e1)])
