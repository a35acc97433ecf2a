"""Second-order shape on the rim: Gaussian and mean curvature from outline and k_t.

The rim is conjugate to the viewing direction, so that the outline's bend in the image,
k_t along the ray and the angle theta between ray and rim fix the surface to second
order. J. J. Koenderink, "What does the occluding contour tell us about solid shape?",
Perception 13, 1984, doi:10.1068/p130321; for perspective R. Cipolla and A. Blake, IJCV
9(2), 1992, doi:10.1007/BF00129682.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .contours import Contours
from .rim import Rim, Status


@dataclass(frozen=True)
class Shape:
    """The surface to second order at each rim point; NaN where not to be had.

    Attributes:
        k_t: (n,) float64, normal curvature along the viewing direction, 1/metre.
        k_s: (n,) float64, normal curvature along the rim, 1/metre.
        theta: (n,) float64, angle from the viewing direction to the rim's tangent, the
            way the contour is walked, 0 to pi rad.
        gauss: (n,) float64, Gaussian curvature, 1/metre^2.
        mean: (n,) float64, mean curvature, 1/metre, positive where convex.
    """

    k_t: Array
    k_s: Array
    theta: Array
    gauss: Array
    mean: Array

    @property
    def principal(self) -> tuple[Array, Array]:
        """k_min and k_max, (n,) each, 1/metre."""
        spread = np.sqrt(np.maximum(self.mean**2 - self.gauss, 0))
        return self.mean - spread, self.mean + spread


def second_order_shape(contours: Contours, rim: Rim, reach: int = 8) -> Shape:
    """Shape from a rim and the contours that it was computed of.

    With c the curvature of the outline on the sphere of directions, depth d and T' the
    unit step along the outline, the rim runs along d' T + d T', and

        tan theta = d / d',   k_s = c sin^2 theta / d,
        K = k_t k_s / sin^2 theta = k_t c / d,   2 H = (k_t + k_s) / sin^2 theta.

    d' is the slope of a depth: noise that leaves the depth alone may spoil theta, k_s
    and the mean curvature; the Gaussian curvature needs no slope and is as good as k_t.

    Args:
        contours: n samples.
        rim: their rim.
        reach: samples to either side over which slopes are taken, by least squares.

    Raises:
        ValueError: reach below 1, or rim and contours of different lengths.
    """
    if reach < 1:
        raise ValueError("reach must be at least 1")
    if len(rim) != len(contours):
        raise ValueError("rim and contours must be of one frame")
    rows, usable = _neighbours(contours, reach)
    step = np.linalg.norm(contours.T[contours.next_row] - contours.T, axis=1)
    after = np.cumsum(step[rows[:, reach:-1]], axis=1)
    before = np.cumsum(step[rows[:, :reach][:, ::-1]], axis=1)[:, ::-1]
    s = np.hstack([-before, np.zeros((len(contours), 1)), after])

    # The outline's tangent, the way it is walked, is N x T.
    tangent = np.cross(contours.N, contours.T)
    turn = np.einsum("nwk,nk->nw", contours.N[rows], tangent)
    bend = _slope(s, turn, usable)
    depth = np.einsum("nk,nk->n", rim.points - contours.centre, contours.T)
    good = rim.status == Status.GOOD
    growth = _slope(s, depth[rows], usable & good[rows] & good[:, None])
    k_t = np.where(good, rim.curvature, np.nan)
    sin2 = depth**2 / (depth**2 + growth**2)
    k_s = bend * sin2 / depth
    return Shape(
        k_t=k_t,
        k_s=k_s,
        theta=np.arctan2(depth, growth),
        gauss=k_t * bend / depth,
        mean=(k_t + k_s) / (2 * sin2),
    )


def _neighbours(contours: Contours, reach: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Rows (n, 2 reach + 1) about each row along its loop, and which of them the outline
    reaches without a gap."""
    n = len(contours)
    rows = np.empty((n, 2 * reach + 1), np.intp)
    usable = np.ones(rows.shape, bool)
    rows[:, reach] = np.arange(n)
    for k in range(1, reach + 1):
        rows[:, reach + k] = contours.next_row[rows[:, reach + k - 1]]
        rows[:, reach - k] = contours.previous_row[rows[:, reach - k + 1]]
        ahead, behind = contours.linked[rows[:, reach + k - 1]], contours.linked[rows[:, reach - k]]
        usable[:, reach + k] = usable[:, reach + k - 1] & ahead
        usable[:, reach - k] = usable[:, reach - k + 1] & behind
    return rows, usable


def _slope(s: Array, values: Array, usable: NDArray[np.bool_]) -> Array:
    """(n,) slope at s = 0 of the parabola fitted to values (n, w) over s; NaN where the
    neighbours on one side do not suffice."""
    usable = usable & np.isfinite(values)
    width = np.abs(s).max(axis=1, keepdims=True)
    x = s / width
    w = usable.astype(np.float64)
    rows = np.stack([np.ones_like(x), x, x**2], axis=-1)
    normal = np.einsum("nw,nwi,nwj->nij", w, rows, rows)
    vector = np.einsum("nw,nwi,nw->ni", w, rows, np.where(usable, values, 0))
    enough = (usable & (s < 0)).any(axis=1) & (usable & (s > 0)).any(axis=1)
    enough &= usable.sum(axis=1) >= 3
    normal[~enough] = np.eye(3)
    slope = np.linalg.solve(normal, vector[..., None])[:, 1, 0] / width[:, 0]
    return np.where(enough, slope, np.nan)
