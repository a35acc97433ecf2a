"""Depth and curvature from corresponding rays: the paper's estimator and those beside it.

All take the same rays and give the same arrays, so that they can be exchanged and
compared. Seen in the plane of T and N, with x the distance along the ray, partner i's
ray is a line of slope a_i through (d_i, 0), and the surface's normal section is tangent
to all of them (``quadric.Crossing``).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, dot
from .belief import propagated
from .quadric import TRIPLE, Crossing, crossing, solve, solve_at_partner
from .rim import Status

_DRIFT = 0.1  # how much of itself a radius of curvature changes by in a radian, 1 sigma
_SINGULAR = 1e-12  # of a 3 x 3 system with a unit diagonal: its determinant


@dataclass(frozen=True)
class Rays:
    """One view's rays of n samples; of a partner, the correspondents of those samples.

    Attributes:
        centre: (3,) float64, camera centre, metres, object frame.
        T: (n, 3) float64, unit viewing directions; NaN where there is no correspondent.
        N: (n, 3) float64, outward unit surface normals.
        sigma: (n,) float64, 1 sigma of the contour across itself, radians.
        cross: of a partner, the crossings with the view's rays, where they are known already.
    """

    centre: Array
    T: Array
    N: Array
    sigma: Array
    cross: Crossing | None = None


@dataclass(frozen=True)
class Estimate:
    """What an estimator finds, one row a sample.

    Attributes:
        depth: (n,) float64, metres along the ray; NaN where it is not to be had.
        curvature: (n,) float64, k_t, 1/metre, positive where convex; NaN where unknown.
        depth_sigma: (n,) float64, 1 sigma of the depth, metres; infinite or NaN where
            there is no depth.
        status: (n,) uint8, a Status: GOOD, DOUBLE, ILL_CONDITIONED or MOTION_ALONG_RAY.
    """

    depth: Array
    curvature: Array
    depth_sigma: Array
    status: NDArray[np.uint8]


Estimator = Callable[[Rays, Sequence[Rays]], Estimate]
"""Takes a view and its partners: the one before, the one after, then any others."""


def osculating_quadric(view: Rays, partners: Sequence[Rays]) -> Estimate:
    """The paper's: in each epipolar plane a parabola, all with the same k_t.

    Exact to second order for any motion; sides of tangents need not be chosen. Fails
    where a_-1 is near a_1, and at frontier points has only the depth. From afar and in a
    plane it is the central differences of the support function (P. Giblin and R. Weiss,
    "Reconstruction of surfaces from profiles", ICCV 1987). Uses the first two partners.

    Source: E. Boyer and M.-O. Berger, IJCV 22(3), 1997, doi:10.1023/A:1007997617239.
    """
    before, after = partners[:2]
    cross = _cross(view, before), _cross(view, after)
    solution = solve(*cross)
    rows = solution.ill_conditioned
    solution = solve_at_partner(
        solution,
        rows,
        cross[1],
        (after.centre, after.T[rows], after.N[rows]),
        (view.centre, view.T[rows]),
        (before.centre, before.T[rows]),
    )
    q = finite_q(solution.curvature)
    belief, _, _ = propagated(*cross, q, (view.sigma, before.sigma, after.sigma), 0.0)
    return Estimate(solution.depth, solution.curvature, belief.depth_sigma, solution.status)


def circle_epipolar(view: Rays, partners: Sequence[Rays]) -> Estimate:
    """A circle tangent to three rays that are projected into one epipolar plane, that of
    the ray and the line between the two partners.

    Right for a linear motion. In any other the three epipolar planes differ and the
    projected rays are not tangent to the section: wrong where the planes enclose a large
    angle, worst where both partners' rays lean to the same side. Uses the first two
    partners.

    Source: R. Cipolla and A. Blake, "Surface shape from the deformation of apparent
    contours", IJCV 9(2), 1992, doi:10.1007/BF00129682.
    """
    before, after = partners[:2]
    baseline = after.centre - before.centre
    y = baseline - (view.T @ baseline)[:, None] * view.T
    with np.errstate(divide="ignore", invalid="ignore"):
        y = y / np.linalg.norm(y, axis=1, keepdims=True)
    y = np.where(dot(y, view.N)[:, None] < 0, -y, y)
    return _tangent_circle(view, (before, after), y)


def circle_radial(view: Rays, partners: Sequence[Rays]) -> Estimate:
    """A circle tangent to three rays that are projected into the radial plane, that of
    the ray and the normal.

    Right where the surface is a cylinder or sphere across that plane. Else the partners'
    rays touch the surface beside the plane, where it has turned: wrong by the twist of
    the surface and by how far the epipolar planes lean from the normal. Uses the first
    two partners.

    Source: R. Vaillant and O. Faugeras, "Using extremal boundaries for 3-D object
    modeling", PAMI 14(2), 1992, doi:10.1109/34.121787.
    """
    return _tangent_circle(view, partners[:2], view.N)


def multi_frame(view: Rays, partners: Sequence[Rays]) -> Estimate:
    """The paper's linear system over any number of partners, weighted by variances.

    Multiplied by -a_i, depth = d_i + a_i / (2 k_t) is a parabola in a_i,

        -a_i d_i = y - a_i depth + a_i^2 / (2 k_t),

    with errors that are independent and do not grow as a_i goes to 0. y is the error of
    the sample's own contour, which all partners see alike and its own ray measures as 0.
    With two partners this is ``osculating_quadric``; with more the variance is the least
    that contours of that noise allow. Fails as that does; and as it holds k_t constant
    over all partners, its bias grows with the square of the angle they span.
    """
    cross = [_cross(view, p) for p in partners]
    a = np.stack([np.zeros(len(view.T)), *(c.a for c in cross)])
    z = np.stack([np.zeros(len(view.T)), *(-c.a * c.d for c in cross)])
    near = np.where(np.isfinite(cross[0].d), cross[0].d, cross[1].d)
    spread = np.stack([near * view.sigma, *_off(cross, partners)])
    rows = np.stack([np.ones_like(a), -a, a**2], axis=-1)
    x, covariance = _least_squares(rows, z, spread)
    return _estimate(x[:, 1], 2 * x[:, 2], np.sqrt(covariance[:, 1, 1]), cross)


def linear_smoother(view: Rays, partners: Sequence[Rays]) -> Estimate:
    """Information-weighted linear smoothing of the circle of curvature over all partners.

    The state (x, y, r), centre and radius of the circle in the plane of T and N, meets
    each ray in a linear equation, n_i.(x, y) + r = h_i. From ray to ray, outermost
    inwards on either side, the radius may drift; both sides meet at the sample's own ray
    (a two-filter Rauch-Tung-Striebel smoother, in information form). A better model than
    one k_t over a wide window; less precise than ``multi_frame`` where that holds, by
    what the drift leaves open. A partner that is matched wrongly spoils its side.

    Source: R. Szeliski and R. Weiss, "Robust shape recovery from occluding contours using
    a linear smoother", IJCV 28(1), 1998, doi:10.1023/A:1008050630628; here the noise of
    the process moves the centre back along the normal as the radius grows, so that it
    bends the curve and does not break it.
    """
    cross = [_cross(view, p) for p in partners]
    slope = np.stack([c.a for c in cross])
    secant = np.sqrt(1 + slope**2)
    normal = np.stack([-slope / secant, 1 / secant, np.ones_like(slope)], axis=-1)
    offset = np.stack([-c.a * c.d for c in cross]) / secant
    sigma = np.stack(_off(cross, partners))
    precision = _precision(sigma / secant, offset)
    depth0, radius0 = _start(cross)
    # Solved about the first solution, in units of its radius.
    start = np.stack([depth0, -radius0, radius0], axis=-1)
    with np.errstate(invalid="ignore"):
        residual = np.where(precision > 0, offset - dot(normal, start), 0.0)
    drift = (_DRIFT * radius0) ** 2

    n = len(view.T)
    angle = np.arctan(slope)
    order = np.argsort(-np.abs(np.nan_to_num(angle)), axis=0)
    here = np.arange(n)
    information, vector = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for side in (-1, 1):
        Y, b = np.zeros((n, 3, 3)), np.zeros((n, 3))
        last = np.full(n, np.nan)
        for k in order:
            mine = (np.sign(angle[k, here]) == side) & (precision[k, here] > 0)
            Y, b = _drifted(Y, b, mine, last, angle[k, here], drift)
            H = normal[k, here]
            w = np.where(mine, precision[k, here], 0)
            H = np.where(mine[:, None], H, 0)
            Y = Y + (w[:, None] * H)[:, :, None] * H[:, None, :]
            b = b + (w * residual[k, here])[:, None] * H
            last = np.where(mine, angle[k, here], last)
        Y, b = _drifted(Y, b, np.isfinite(last), last, np.zeros(n), drift)
        information, vector = information + Y, vector + b
    own = np.array([0.0, 1.0, 1.0])
    information = information + _precision(depth0 * view.sigma, depth0)[:, None, None] * (
        own[:, None] * own
    )
    covariance = _inverse(information)
    x = start + np.einsum("nij,nj->ni", covariance, vector)
    return _estimate(x[:, 0], x[:, 2], np.sqrt(covariance[:, 0, 0]), cross)


ESTIMATORS: dict[str, Estimator] = {
    f.__name__: f
    for f in (osculating_quadric, circle_epipolar, circle_radial, linear_smoother, multi_frame)
}
"""Estimators by name."""

MANY_FRAMES = ("linear_smoother", "multi_frame")
"""Names of the estimators that use more than two partners."""


def _cross(view: Rays, partner: Rays) -> Crossing:
    if partner.cross is not None:
        return partner.cross
    return crossing(view.centre, view.T, view.N, partner.centre, partner.T)


def _off(cross: Sequence[Crossing], partners: Sequence[Rays]) -> list[Array]:
    """(n,) 1 sigma of each partner's ray across itself at the crossings, metres."""
    both = zip(cross, partners, strict=True)
    return [np.abs(c.d_other) * p.sigma / np.sqrt(1 - c.sin**2) for c, p in both]


def finite_q(curvature: Array) -> Array:
    """(n,) 1 / (2 k_t), 0 where k_t is unknown."""
    with np.errstate(divide="ignore"):
        q = 0.5 / curvature
    return np.where(np.isfinite(q), q, 0.0)


def _tangent_circle(view: Rays, partners: Sequence[Rays], y: Array) -> Estimate:
    """The circle tangent to the three rays' projections into the plane of T and y.

    Args:
        y: (n, 3) unit vectors across T, on the outer side.
    """
    cross = [_cross(view, p) for p in partners]
    n = len(view.T)
    rows, offsets = [np.tile([0.0, 1.0, 1.0], (n, 1))], [np.zeros(n)]
    spread = [np.abs(cross[0].d) * view.sigma]
    for c, p in zip(cross, partners, strict=True):
        along = np.stack([dot(p.T, view.T), dot(p.T, y)], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = along / np.linalg.norm(along, axis=1, keepdims=True)
        side = np.where(along[:, 0] < 0, -1.0, 1.0)
        normal = np.stack([-side * along[:, 1], side * along[:, 0]], axis=-1)
        step = p.centre - view.centre
        rows.append(np.column_stack([normal, np.ones(n)]))
        offsets.append(normal[:, 0] * (view.T @ step) + normal[:, 1] * (y @ step))
        spread.append(np.abs(c.d_other) * p.sigma)
    # Across the contour e, in a plane inclined to its normal by b: e / cos b.
    inclined = np.maximum(dot(y, view.N), 1e-9)
    x, covariance = _least_squares(np.stack(rows), np.stack(offsets), np.stack(spread) / inclined)
    # Meusnier: the section by an inclined plane curves more.
    return _estimate(x[:, 0], x[:, 2] / inclined, np.sqrt(covariance[:, 0, 0]), cross)


def _start(cross: Sequence[Crossing]) -> tuple[Array, Array]:
    """(n,) a depth and a positive radius of curvature to begin from, metres."""
    first = solve(cross[0], cross[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.abs(1 / first.curvature)
    usual = np.median(radius[np.isfinite(radius)]) if np.isfinite(radius).any() else 1.0
    depth = np.ones_like(first.depth)
    for known in (cross[1].d, cross[0].d, first.depth):
        depth = np.where(np.isfinite(known), known, depth)
    return depth, np.where(np.isfinite(radius), np.clip(radius, usual / 30, usual * 30), usual)


def _precision(sigma: Array, value: Array) -> Array:
    """1 / sigma^2, 0 where the value or the sigma is not known."""
    with np.errstate(divide="ignore", invalid="ignore"):
        precision = 1 / np.maximum(sigma, 1e-12) ** 2
    return np.where(np.isfinite(value) & np.isfinite(precision), precision, 0.0)


def _drifted(
    Y: Array, b: Array, which: NDArray[np.bool_], last: Array, angle: Array, drift: Array
) -> tuple[Array, Array]:
    """Information after the radius has drifted from one angle to the next.

    (Y^-1 + q g g^T)^-1 by Sherman and Morrison, with g the state's move that leaves the
    tangent line at ``last`` where it is.
    """
    q = np.where(which & np.isfinite(last), drift * np.abs(angle - last), 0.0)
    g = np.stack([np.sin(last), -np.cos(last), np.ones_like(last)], axis=-1)
    g, q = np.nan_to_num(g), np.nan_to_num(q)
    Yg = np.einsum("nij,nj->ni", Y, g)
    share = q / (1 + q * dot(g, Yg))
    return (
        Y - share[:, None, None] * Yg[:, :, None] * Yg[:, None, :],
        b - (share * dot(g, b))[:, None] * Yg,
    )


def _least_squares(rows: Array, values: Array, sigma: Array) -> tuple[Array, Array]:
    """Weighted least squares in three unknowns, one system a sample.

    Args:
        rows: (p, n, 3) coefficients; values, sigma: (p, n). Not finite: left out.

    Returns:
        (n, 3) unknowns and (n, 3, 3) their covariance, NaN where not determined.
    """
    weight = _precision(sigma, values)
    rows, values = np.nan_to_num(rows), np.nan_to_num(values)
    weighted = weight[..., None] * rows
    normal = np.einsum("pni,pnj->nij", weighted, rows)
    covariance = _inverse(normal)
    x = np.einsum("nij,nj->ni", covariance, np.einsum("pni,pn->ni", weighted, values))
    return x, covariance


def _inverse(matrices: Array) -> Array:
    """Inverses of symmetric positive (n, 3, 3) matrices, NaN where singular."""
    diagonal = np.sqrt(np.einsum("nii->ni", matrices))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / diagonal
        scaled = matrices * scale[:, :, None] * scale[:, None, :]
        scaled = np.where(np.isfinite(scaled), scaled, 0.0)
        r0, r1, r2 = scaled[:, 0], scaled[:, 1], scaled[:, 2]
        adjugate = np.stack([np.cross(r1, r2), np.cross(r2, r0), np.cross(r0, r1)], axis=-1)
        determinant = dot(r0, np.cross(r1, r2))[:, None, None]
        determinant = np.where(determinant > _SINGULAR, determinant, np.nan)
        return adjugate / determinant * scale[:, :, None] * scale[:, None, :]


def _estimate(depth: Array, radius: Array, sigma: Array, cross: Sequence[Crossing]) -> Estimate:
    """Depths and radii with the statuses that the first two partners give them."""
    two = solve(cross[0], cross[1])
    lost = (two.status == Status.MOTION_ALONG_RAY) | ~np.isfinite(depth)
    no_bend = np.abs(cross[0].a) + np.abs(cross[1].a) < 2 * TRIPLE
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = np.where(lost | no_bend, np.nan, 1 / radius)
    status = two.status.copy()
    status[lost & (status == Status.GOOD)] = Status.ILL_CONDITIONED
    return Estimate(np.where(lost, np.nan, depth), curvature, np.where(lost, np.inf, sigma), status)
