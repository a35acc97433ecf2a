"""Depth and normal curvature from three contours: the osculating quadric (sections 3.1, 3.2).

Up to second order the surface in each epipolar plane is a parabola, and all these
parabolas share k_t, the normal curvature along the viewing direction T. With d_i the
distance to the crossing of the view lines and a_i the slope of the other ray,

    depth = d_i + a_i / (2 k_t),    i in {-1, 1},

which is linear in depth and 1/k_t (Boyer and Berger 1997, sections 3.1 and 3.2; the form of
d_i is that of their appendix).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, dot
from .compiled import compiled
from .correspondence import Candidates, Pencil
from .rim import Status

TRIPLE = 1e-9  # |a_i| that is zero: an exact frontier point
SAME = 0.05  # |a_1 - a_-1| / (|a_1| + |a_-1|) under which the system is ill-conditioned


@dataclass(frozen=True)
class Crossing:
    """What one partner i says of each sample's ray; arrays of one shape.

    Attributes:
        d: metres along the ray to the crossing with the partner's ray.
        a: cos b_i tan(angle between the rays), signed; depth = d + a / (2 k_t).
        sin: sine of the angle between the rays, signed along N_i.
        cos_b: cosine of the angle between N and the epipolar plane, 0 at a frontier point.
        d_other: metres along the partner's ray to the crossing.
    """

    d: Array
    a: Array
    sin: Array
    cos_b: Array
    d_other: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All five."""
        return self.d, self.a, self.sin, self.cos_b, self.d_other

    def take(self, entries: NDArray[np.intp]) -> Crossing:
        """Some of them, (k,) by index."""
        return Crossing(*(part[entries] for part in self.arrays))


def crossing(C: Array, T: Array, N: Array, C_i: Array, T_i: Array) -> Crossing:
    """Cross each ray with its correspondent's.

    Args:
        C: (3,) camera centre, metres.
        T: (..., 3) unit viewing directions.
        N: (..., 3) outward unit normals.
        C_i: (3,) the partner's centre.
        T_i: (..., 3) unit viewing directions of the correspondents.

    Returns:
        Crossing of arrays of shape (...); NaN or infinite where T = T_i.

    Source:
        Boyer and Berger 1997: d_i = -(C - C_i).w_i / ((T - T_i).w_i) with
        w_i = (T x T_i) x T_i, which stays defined at a multiple point, and
        a_i = cos b_i (T_i.N_i) / sqrt(1 - (T_i.N_i)^2).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        cos = dot(T, T_i)[..., None]
        # w_i = (T x T_i) x T_i = (T.T_i) T_i - T, and the like for the partner's ray.
        w_i = cos * T_i - T
        d = -((C - C_i) * w_i).sum(-1) / dot(T - T_i, w_i)
        w = cos * T - T_i
        d_other = -((C_i - C) * w).sum(-1) / dot(T_i - T, w)
        across = T_i - cos * T
        N_i = across / np.linalg.norm(across, axis=-1, keepdims=True)
        cos_b = dot(N, N_i)
        N_i = np.where(cos_b[..., None] < 0, -N_i, N_i)
        cos_b = np.abs(cos_b)
        sin = dot(T_i, N_i)
        return Crossing(d, cos_b * sin / np.sqrt(1 - sin**2), sin, cos_b, d_other)


@dataclass(frozen=True)
class Crossed:
    """The epipolar candidates of samples, and what they say.

    Attributes:
        candidates: m of them.
        cross: the crossings (m,) of each sample's ray with its candidates'.
        turned: (m,) float64, rad by which their normals have turned beyond their rays.
        cos, sin: (m,) float64, of the angles of their rays from the baseline.
    """

    candidates: Candidates
    cross: Crossing
    turned: Array
    cos: Array
    sin: Array


def crossed_candidates(pencil: Pencil, rows: NDArray[np.bool_] | None = None) -> Crossed:
    """All points of another contour that may correspond to each sample of a contour (2.1), and
    where their rays cross: as ``crossing`` says, by plane trigonometry.

    The order rule is built in: along both contours the object is on the same side, so
    that at a correspondence the angle in the pencil runs the same way on both. On either
    side of a frontier point it runs opposite ways, which tells its two close candidates
    apart.

    Args:
        pencil: of a view, n samples, and another.
        rows: (n,) which samples are asked for; None: all.
    """
    if not pencil.defined:
        none, nothing = np.zeros(0, np.intp), np.zeros(0)
        cross = Crossing(*[nothing] * 5)
        return Crossed(Candidates(none, none, nothing), cross, nothing, nothing, nothing)
    view, other, phi = pencil.contours, pencil.other, pencil.here.phi
    asked = ~pencil.along_ray if rows is None else rows & ~pencil.along_ray
    samples = np.flatnonzero(asked)
    samples = samples[np.argsort(phi[samples])]
    sample, row, values = compiled().crossed_candidates(
        samples,
        pencil.here.arrays,
        pencil.there.arrays,
        (view.previous_row, view.next_row, view.linked),
        (other.next_row, other.linked, other.turning),
        pencil.baseline,
    )
    fraction, cos, sin, *parts, turned = values
    return Crossed(Candidates(sample, row, fraction), Crossing(*parts), turned, cos, sin)


@dataclass(frozen=True)
class QuadricFit:
    """Depth (metres), normal curvature k_t (1/metre) and Status of each sample."""

    depth: Array
    curvature: Array
    status: NDArray[np.uint8]

    @property
    def ill_conditioned(self) -> Index:
        """The samples for ``solve_at_partner``."""
        return np.flatnonzero(self.status == Status.ILL_CONDITIONED.value)


def solve(before: Crossing, after: Crossing) -> QuadricFit:
    """Solve the two linear equations of each sample for depth and curvature.

    Where they are singular (a_-1 = a_1), depth and curvature are NaN and the status is
    ILL_CONDITIONED: see ``solve_at_partner``. At a triple point (both a zero) depth is
    the mean of both d and k_t NaN; at a double point (one a zero) depth is that d; both
    have status DOUBLE. Where a ray equals its correspondent's: MOTION_ALONG_RAY, NaN.

    Args:
        before, after: what the partners -1 and 1 say, arrays of one shape.
    """
    depth, curvature = np.empty((2, *before.d.shape))
    status = np.empty(before.d.shape, np.uint8)
    parts = before.d, before.a, after.d, after.a, depth, curvature, status
    compiled().solved(*(part.reshape(-1) for part in parts))
    return QuadricFit(depth, curvature, status)


def solve_at_partner(
    solution: QuadricFit,
    rows: Index,
    after: Crossing,
    partner: tuple[Array, Array, Array],
    view: tuple[Array, Array],
    before: tuple[Array, Array],
) -> QuadricFit:
    """Fill in ill-conditioned samples (a_-1 = a_1) by way of the neighbour.

    There p_-1 and p_1 correspond to each other. So the system is solved at P_1 from the
    two other rays, and P lies on the same parabola: depth = d_1 + a_1 / (2 k_t).

    Args:
        solution: of ``solve``.
        rows: (k,) which samples.
        after: what partner 1 says of each of the n.
        partner: C_1 (3,), T_1 (k, 3), N_1 (k, 3) at the correspondents of the k.
        view: C (3,), T (k, 3).
        before: C_-1 (3,), T_-1 (k, 3).

    Returns:
        The solution with depth and curvature of those samples; they keep their status.
    """
    C_1, T_1, N_1 = partner
    at_partner = solve(crossing(C_1, T_1, N_1, *before), crossing(C_1, T_1, N_1, *view))
    depth, curvature = solution.depth.copy(), solution.curvature.copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        depth[rows] = after.d[rows] + after.a[rows] / (2 * at_partner.curvature)
    curvature[rows] = at_partner.curvature
    return QuadricFit(depth, curvature, solution.status)
