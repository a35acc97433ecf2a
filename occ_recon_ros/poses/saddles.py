"""Inner corners of a chessboard: made precise, and told from what only looks like one.

Around the corner c of four squares a blurred image is, by its two edges,

    I(x) = m + a erf(q1 . (x - c)) erf(q2 . (x - c)).

All of its eight numbers are fitted to the pixels around the corner by Gauss-Newton: where the
noise of the pixels is even and independent, no estimate of the corner is better. Where the edges
are not at right angles the product is not quite the image, but has its symmetry: that moves no
corner.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from occ_recon_ros.geometry.arrays import Array

_LEAST_PX, _MOST_PX = 2.0, 8.0  # reach of what is fitted; farther off a lens bends the edges
_BORDER_PX = 1.0  # by which the blur of what is beyond the reach comes nearer
_BLUR_PX = 1.0  # 1 sigma, to begin with
_ITERATIONS, _STILL_PX = 8, 0.005  # Gauss-Newton, until most corners move by less
_DAMPING = 1e-3  # of the diagonal
_STEP_PX, _STEP_SHARPER = 1.0, 0.3  # longest step of a corner; of q, 1/px
_EVEN = 0.02  # of the contrast: no print is closer to what is fitted
_FLAT = 1e-6  # of a square's area over its sides: it is a line
_SELF = 1e-12  # squares, squared: no division by a corner's distance from itself
_EXPLAINED = 0.9  # share of the pixels' variance
_AS_OTHERS = 2.0  # times what the other corners' pixels are off, of their contrast


def refine_saddles(
    grey: NDArray, uv: Array, board_xy: Array, reach: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Sub-pixel places of inner corners.

    Args:
        grey: (h, w) uint8.
        uv: (n, 2) float64, pixels, good to a pixel or two.
        board_xy: (n, 2) float64, where the corners are on the board; neighbours are a square apart.
        reach: how far around a corner nothing is but its four squares, in squares.

    Returns:
        (n, 2) pixels, and (n,) bool: which look like the corner of four squares, which those that
        an object covers in part do not.
    """
    axes, usable = _axes(uv, board_xy)
    better, good = uv.copy(), np.zeros(len(uv), bool)
    if not usable.any():
        return better, good
    start = _nearest(grey, uv[usable], reach * np.linalg.norm(axes[usable], axis=1))
    patch = _Patch(grey, start, axes[usable], reach)
    moved, explained, off = patch.fit()
    near = patch.inside & (np.linalg.norm(moved, axis=1) <= _STEP_PX)
    better[usable] = start + np.where(near[:, None], moved, 0)
    alike = near & (explained > _EXPLAINED)
    if alike.any():
        alike &= off <= _AS_OTHERS * max(float(np.median(off[alike])), _EVEN)
    good[usable] = alike
    return better, good


def _nearest(grey: NDArray, uv: Array, reach_px: Array) -> Array:
    """(n, 2) the corners next to uv, good to half a pixel, by where the gradients around them are
    normal to. Beyond ``reach_px``, (n, 2), there may be others."""
    window = int(np.clip(np.floor(np.quantile(reach_px, 0.1)), _LEAST_PX, _MOST_PX))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-2)
    size = np.array(grey.shape[::-1])
    inside = ((uv > window + 1) & (uv < size - window - 2)).all(axis=1)
    found = uv.astype(np.float32)
    if inside.any():
        some = np.ascontiguousarray(found[inside])
        found[inside] = cv2.cornerSubPix(grey, some, (window, window), (-1, -1), stop)
    near = np.linalg.norm(found - uv, axis=1) <= window
    return np.where(near[:, None], found, uv).astype(np.float64)


def _axes(uv: Array, board_xy: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(n, 2, 2) pixels a square along the board's x and y in its columns, by the other corners, the
    nearer the more; (n,) whether they tell, as corners in a row do not."""
    apart = board_xy[:, None] - board_xy[None]
    apart = apart / np.abs(apart)[np.abs(apart) > 1e-9].min(initial=np.inf)
    weight = 1 / (_SELF + (apart**2).sum(axis=2)) ** 3
    np.fill_diagonal(weight, 0)
    spread = np.einsum("ij,ijk,ijl->ikl", weight, apart, apart)
    both = np.einsum("ij,ijk,ijl->ikl", weight, uv[:, None] - uv[None], apart)
    size = np.einsum("ikk->i", spread)
    told = np.linalg.det(spread) > _FLAT * size**2
    spread[~told] = np.eye(2)
    axes = both @ np.linalg.inv(spread)
    return axes, told & (np.abs(np.linalg.det(axes)) > _FLAT * (axes**2).sum(axis=(1, 2)))


class _Patch:
    """The pixels around corners, from where they are thought to be.

    Attributes:
        window: reach of the pixels, px.
        inside: (n,) bool, the image holds all of them.
    """

    def __init__(self, grey: NDArray, uv: Array, axes: Array, reach: float) -> None:
        normals = np.linalg.inv(axes)  # squares a pixel
        a_pixel = np.linalg.norm(normals, axis=2, keepdims=True)
        widest = reach * np.abs(axes).sum(axis=2).max()
        self.window = r = int(np.clip(np.ceil(widest), _LEAST_PX, _MOST_PX))
        base, (height, width) = np.rint(uv).astype(np.intp), grey.shape
        self.inside = ((base >= r) & (base < np.array([width, height]) - r)).all(axis=1)
        v, u = np.mgrid[-r : r + 1, -r : r + 1].reshape(2, 1, -1)
        u, v = base[:, :1] + u, base[:, 1:] + v
        self._x = np.stack([u, v], axis=1) - uv[:, :, None]
        self._seen = grey[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
        # Where nothing but the four squares is; at least what the blur of an edge needs.
        far = np.maximum(reach - _BORDER_PX * a_pixel, _LEAST_PX * a_pixel)
        weight = (np.abs(normals @ self._x) <= far).all(axis=1)
        # Those pixels first, and as many as any corner has of them.
        order = np.argsort(~weight, axis=1, kind="stable")[:, : weight.sum(axis=1).max()]
        self._weight, self._seen = (
            np.take_along_axis(of, order, axis=1).astype(np.float32) for of in (weight, self._seen)
        )
        self._x = np.take_along_axis(self._x, order[:, None], axis=2).astype(np.float32)
        self._q = (normals / a_pixel / (np.sqrt(2) * _BLUR_PX)).astype(np.float32)

    def fit(self) -> tuple[Array, Array, Array]:
        """(n, 2) by how much the corners are elsewhere, pixels; (n,) share of the variance that is
        explained; (n,) how far pixels are off, 1 sigma, of the contrast."""
        weight, seen, q = self._weight, self._seen, self._q.copy()
        count = weight.sum(axis=1)
        m = (weight * seen).sum(axis=1) / count
        off = seen - m[:, None]
        power = (weight * off**2).sum(axis=1)
        product = np.prod(erf(q @ self._x), axis=1)
        a = (weight * product * off).sum(axis=1) / (weight * product**2).sum(axis=1)
        c, J = np.zeros((len(q), 2, 1), np.float32), np.ones((len(q), 8, seen.shape[1]), np.float32)
        for _ in range(_ITERATIONS):
            x = self._x - c
            t = q @ x
            edges = erf(t)
            J[:, 7] = edges[:, 0] * edges[:, 1]
            off = seen - m[:, None] - a[:, None] * J[:, 7]
            slope = np.exp(-t * t) * edges[:, ::-1] * (2 / np.sqrt(np.pi) * a)[:, None, None]
            J[:, :2] = -q.transpose(0, 2, 1) @ slope
            J[:, 2:4], J[:, 4:6] = slope[:, :1] * x, slope[:, 1:] * x
            weighted = J * weight[:, None]
            A, b = weighted @ J.transpose(0, 2, 1), weighted @ off[..., None]
            diagonal = np.einsum("nkk->nk", A)
            diagonal += _DAMPING * diagonal + 1e-6
            step = np.linalg.solve(A, b)
            c += np.clip(step[:, :2], -_STEP_PX, _STEP_PX)
            q += np.clip(step[:, 2:6].reshape(-1, 2, 2), -_STEP_SHARPER, _STEP_SHARPER)
            m, a = m + step[:, 6, 0], a + step[:, 7, 0]
            if np.median(np.abs(step[:, :2]).max(axis=1)) < _STILL_PX:
                break
        off -= np.einsum("nkp,nk->np", J, step[..., 0])  # as after the last step
        squares = (weight * off**2).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = np.sqrt(squares / np.maximum(count - 8, 1)) / np.abs(a)
            return c[..., 0].astype(np.float64), 1 - squares / power, sigma
