"""Two views in the pencil of planes through their centres: epipolar geometry in polar
coordinates.

Every ray lies in one plane of the pencil. Two numbers give it: the plane's angle phi about
the baseline, and its angle alpha from the baseline within the plane. Correspondents have one
phi, so that matching is a look-up of phi, and crossing two rays is plane trigonometry on
alpha. Both are worked out once for a pair of views and serve matching, depth, frontier
points and the link to the previous rim.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, fields
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

    def some(self, rows: Index) -> PencilView:
        """Those of some samples."""
        return PencilView(*(getattr(self, f.name)[rows] for f in fields(self)))


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
        self._rows = np.arange(len(contours))
        step = other.centre - contours.centre
        self.baseline = float(np.linalg.norm(step))
        self.defined = bool(len(contours) and len(other) and self.baseline > 0)
        if self.defined:
            frame = _frame(step / self.baseline, contours.middle + other.middle)
            self.here = PencilView.of(contours, frame)
            self.there = PencilView.of(other, frame)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.here.phi) if self.defined else len(self._rows)

    def some(self, rows: Index) -> Pencil:
        """The pencil for some samples of the view."""
        part = copy.copy(self)
        part._rows = self._rows[rows]
        if self.defined:
            part.here = self.here.some(rows)
            part.way = self.way[rows]
        return part

    @cached_property
    def way(self) -> Array:
        """(n,) -1, 0 or 1: which way phi runs along the contour at each sample."""
        phi, contours = self.here.phi, self.contours
        here = np.arange(len(contours))
        after = np.where(contours.linked, contours.next_row, here)
        before = np.where(contours.linked[contours.previous_row], contours.previous_row, here)
        turn = phi[after] - phi[before]
        return np.sign(np.where(np.abs(turn) > np.pi, -turn, turn))

    def rays(self, row: Index, fraction: Array) -> tuple[Array, Array]:
        """cos and sin of alpha on the other contour, at places between its samples.

        Exact to second order in the step: the outline bulges towards its normal, and the
        straight chord between two rays is itself bent in (phi, alpha).

        Args:
            row: the sample before.
            fraction: of the step to the next, in phi, 0-1; of one shape with row.
        """
        there, rest = self.there, 1 - fraction
        cos_step, sin_step, cos_bulge, sin_bulge = self._steps
        cos = there.cos[row] + fraction * (cos_step[row] + rest * cos_bulge[row])
        sin = there.sin[row] + fraction * (sin_step[row] + rest * sin_bulge[row])
        return cos, sin

    @cached_property
    def _steps(self) -> tuple[Array, Array, Array, Array]:
        """Change of cos and sin of alpha to the next row, (m,) each, and four times by how
        much they are greater in the middle of the segment than on the straight line."""
        there, after = self.there, self.other.next_row
        phi, alpha, next_cos, next_sin = (
            x[after] for x in (there.phi, there.alpha, there.cos, there.sin)
        )
        dphi, dalpha = phi - there.phi, alpha - there.alpha
        N_n = (there.N_n + there.N_n[after]) / 2
        N_n = np.copysign(np.maximum(np.abs(N_n), _LEAST_COS), N_n)
        cos, sin = (there.cos + next_cos) / 2, (there.sin + next_sin) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            chord = cos * (dphi**2 * sin + 2 * dalpha**2 / sin)
            bulge = 0.5 * (self.other.bend / N_n - chord)
        bent = 0.5 * dalpha**2
        return (
            next_cos - there.cos,
            next_sin - there.sin,
            cos * bent - sin * bulge,
            sin * bent + cos * bulge,
        )

    def crossing(self, cos_i: Array, sin_i: Array) -> tuple[Crossing, Array]:
        """Cross each ray of the view with others of its plane.

        Args:
            cos_i, sin_i: (n, K) float64 of the angles alpha_i of rays from the other centre.

        Returns:
            Crossing of arrays (n, K), NaN where an angle is, infinite where rays are
            parallel; and (n, K) float64, the cosine of the angle between the rays.

        Source:
            ``quadric.crossing``, by plane trigonometry: in the triangle of the baseline b and
            both rays d_i = b sin alpha_i / sin(alpha_i - alpha), and with cos b_i = |N.n| and
            T_i.N_i = sign(N.n) sin(alpha_i - alpha) the paper's a_i is (N.n) tan(alpha_i -
            alpha).
        """
        cos, sin, N_n = self.here.cos[:, None], self.here.sin[:, None], self.here.N_n[:, None]
        sin_apart, cos_apart = sin_i * cos - cos_i * sin, cos_i * cos + sin_i * sin
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = self.baseline / sin_apart
            crossing = Crossing(
                d=scale * sin_i,
                a=N_n * sin_apart / np.abs(cos_apart),
                sin=np.copysign(sin_apart, N_n * sin_apart),
                cos_b=np.abs(N_n) + np.zeros_like(sin_i),
                d_other=scale * sin,
            )
        return crossing, cos_apart

    def turn_of_normal(self, row: Index, fraction: Array, cos_apart: Array) -> Array:
        """(n, K) angle between the normals of samples and of candidates, rad.

        Args:
            row, fraction: where the candidates lie.
            cos_apart: of the angle between the rays.
        """
        here, there, after = self.here, self.there, self.other.next_row[row]
        rest = 1 - fraction
        N_n = rest * there.N_n[row] + fraction * there.N_n[after]
        N_v = rest * there.N_v[row] + fraction * there.N_v[after]
        cos = here.N_n[:, None] * N_n * cos_apart + here.N_v[:, None] * N_v
        return np.arccos(np.clip(cos, -1, 1))


def _frame(axis: Array, forward: Array) -> Array:
    """Rows: the axis, across it towards the object if that is defined, and across both."""
    e1 = forward - (forward @ axis) * axis
    if np.linalg.norm(e1) < 1e-9:
        e1 = np.eye(3)[np.argmin(np.abs(axis))]
        e1 = e1 - (e1 @ axis) * axis
    e1 = e1 / np.linalg.norm(e1)
    return np.stack([axis, e1, np.cross(axis, e1)])
