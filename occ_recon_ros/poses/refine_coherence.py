"""Silhouette coherence: a ray of one outline must touch what all other views leave of the body.

Every ray of a true outline touches the body, so that somewhere along it there is a point inside all
other silhouettes. Where there is none, cameras (or outlines) contradict each other, by as many
pixels as the best point of the ray lies outside the worst silhouette. Unlike tangencies this asks
the whole outline; unlike them it says nothing where there is room. After Hernandez, Schmitt and
Cipolla, IEEE PAMI 29(2), 2007, doi:10.1109/TPAMI.2007.42.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, Index

from .refine_lens import undistorted
from .refine_rig import SHARED, Rig
from .refine_tangencies import Residuals, derivatives

_RAYS = 600  # of all views together
_DEPTHS = 20
_REACH = 1.3  # radii of the object to either side of its middle
_CLOSER = 4  # steps to either side when it is looked closer, twice, with steps so many times finer
_AGAIN = 4  # such looks, where the best is the last of them
_FAR_INSIDE_PX = 12  # than the worst silhouette: one that will not soon be the worst
_MARGIN_PX = 24
_EXACT_PX = 2.5  # to either side of an outline
_LARGE = 2**20  # pixels of a silhouette and what is around it
_DRAWN = 16  # times as many when it is drawn, and
_LONGEST = 2**14  # on a side: what a lens bends out of all measure is drawn the smaller
_FAR = 8  # sizes of the image beyond it, from where on nobody asks how far an outline is
_SHIFT = 8  # bits of OpenCV's fractions of a pixel
_SLACK = 1.0  # sigmas that a ray may miss for noise alone
_ROW = 16384  # OpenCV takes no map longer than 32767 on a side


class Coherence:
    """The rays of all outlines against all other silhouettes.

    Args:
        contours: one a view, None where it has none.
        cameras: of the views, for the size of their images.
    """

    def __init__(self, contours: Sequence[Contours | None], cameras: Sequence[Camera]) -> None:
        self._fields: dict[int, DistanceImage] = {}
        uv, view, sigma = [], [], []
        seen = [(k, c) for k, c in enumerate(contours) if c is not None and len(c) > 8]
        for k, c in seen:
            self._fields[k] = DistanceImage(c, cameras[k])
            good = np.flatnonzero(np.isfinite(c.sigma) & c.linked)
            rows = good[:: max(1, len(good) * len(seen) // _RAYS)]
            uv.append(undistorted(c.uv[rows], cameras[k]))
            view.append(np.full(len(rows), k))
            sigma.append(c.sigma[rows] / c.radians_per_pixel)
        self._uv, self.view, self._sigma = map(np.concatenate, (uv, view, sigma))
        self._best = np.zeros(0)

    def __len__(self) -> int:
        """Number of rays."""
        return len(self.view)

    def search(self, rig: Rig, middle: Array, radius: float) -> None:
        """Look along whole rays where they pass best; ``residuals`` then looks near there."""
        away, reach = self._reach(rig, middle, radius)
        T, C = self._rays(rig), rig.C[self.view]
        step = 2 * reach / (_DEPTHS - 1)
        offsets = step[:, None] * (np.arange(_DEPTHS) - 0.5 * (_DEPTHS - 1))
        self._asked = np.ones((len(self._fields), len(T)), bool)
        outside = self._outside(rig, C, T, away[:, None] + offsets)
        best = outside.max(axis=0).argmin(axis=1)
        self._best = offsets[np.arange(len(T)), best]
        self._best = self._nearby(rig, C, T, away, step / _CLOSER)
        near = self._best[:, None] + step[:, None] * np.array([-0.5, 0.0, 0.5])
        outside = self._outside(rig, C, T, away[:, None] + near)
        self._asked = (outside > outside.max(axis=0) - _FAR_INSIDE_PX).any(axis=2)

    def _reach(self, rig: Rig, middle: Array, radius: float) -> tuple[Array, Array]:
        """(m,) each: how far the object's middle is, and how far from there to look, metres."""
        away = np.linalg.norm(rig.C[self.view] - middle, axis=1)
        return away, np.minimum(_REACH * radius, 0.9 * away)

    def _nearby(self, rig: Rig, C: Array, T: Array, away: Array, step: Array) -> Array:
        """(m,) the best place of each ray, from the middle, in steps from what it was; again where
        that is the last of them."""
        offsets, todo = self._best.copy(), np.arange(len(T))
        steps = np.arange(-_CLOSER, _CLOSER + 1)
        for _ in range(_AGAIN):
            near = offsets[todo, None] + step[todo, None] * steps
            worst = self._outside(rig, C[todo], T[todo], away[todo, None] + near, todo)
            best = worst.max(axis=0).argmin(axis=1)
            offsets[todo] = near[np.arange(len(todo)), best]
            todo = todo[(best == 0) | (best == len(steps) - 1)]
            if not len(todo):
                break
        return offsets

    def residuals(self, rig: Rig, middle: Array, radius: float) -> Residuals:
        """By how much rays miss the body that the other views leave.

        Args:
            rig: the cameras.
            middle, radius: of the object, metres.

        Returns:
            One residual a ray, zero where it misses it by no more than noise would.
        """
        if len(self._best) < len(self):
            self.search(rig, middle, radius)
        T, C = self._rays(rig), rig.C[self.view]
        away, reach = self._reach(rig, middle, radius)
        step = 2 * reach / (_DEPTHS - 1) / _CLOSER**2
        depth = away + self._nearby(rig, C, T, away, step)
        # The two silhouettes between which the ray passes, and where they let it pass best.
        outside = self._outside(rig, C, T, depth[:, None] + step[:, None] * np.array([-1.0, 1.0]))
        before, after = outside.argmax(axis=0).T
        rows = np.arange(len(T))
        first, second = outside[before, rows].T, outside[after, rows].T
        change = (second[1] - second[0]) - (first[1] - first[0])
        at = np.clip((first[0] - second[0]) / np.where(change > 0, change, np.inf), 0, 1)
        value = (first[0] + at * (first[1] - first[0])).astype(np.float64)
        depth = depth + (2 * at - 1) * step
        sigma = np.sqrt(2) * self._sigma
        excess = value - _SLACK * sigma
        missed = np.flatnonzero((excess > 0) & np.isfinite(excess))
        views = np.array([*self._fields])
        i, a, b = self.view[missed], views[before[missed]], views[after[missed]]
        ray, X = T[missed], C[missed] + depth[missed, None] * T[missed]
        found = [self._derivatives(rig, k, X) for k in (a, b)]
        down, up = (np.einsum("mk,mk->m", pull, ray) for pull, _ in found)
        # Along the ray the two must hold each other, or it is no best point.
        held = (down < 0) & (up > 0)
        share = np.where(held, up / np.where(held, up - down, 1), np.nan)
        by = np.zeros((len(missed), 3, SHARED))
        for k, (part, (pull, own)) in enumerate(zip((share, 1 - share), found, strict=True), 1):
            by[:, k] = part[:, None] * own
            by[:, 0] += part[:, None] * derivatives(rig, i, ray, pull, depth[missed])
            by[:, 0, 3:6] += part[:, None] * np.einsum("mij,mj->mi", rig.R[i], pull)
        camera = np.stack([i, a, b], axis=1)
        kept = missed[held]
        value, by_camera = np.zeros(len(self)), np.zeros((len(self), 3, SHARED))
        cameras = np.tile(self.view[:, None], 3)
        value[kept], by_camera[kept], cameras[kept] = excess[kept], by[held], camera[held]
        return Residuals(value, sigma, cameras, by_camera)

    def _rays(self, rig: Rig) -> Array:
        """(m, 3) unit viewing directions."""
        T = np.empty((len(self), 3))
        for k in self._fields:
            mine = self.view == k
            one = Rig(rig.R[[k]], rig.C[[k]], rig.K[[k]], rig.bend)
            T[mine] = one.rays(self._uv[None, mine])[0]
        return T

    def _outside(
        self, rig: Rig, C: Array, T: Array, depths: Array, rows: Index | slice = slice(None)
    ) -> NDArray[np.float32]:
        """(views, m, depths) px that points of rays lie outside silhouettes, -inf for their own
        and for those that they are far inside of."""
        found = np.full((len(self._fields), *depths.shape), -np.inf, np.float32)
        asked = self._asked[:, rows] & (self.view[rows] != np.array([*self._fields])[:, None])
        for (k, field), mine, into in zip(self._fields.items(), asked, found, strict=True):
            if mine.any():
                away: Array = depths[mine, :, None] * T[mine, None]
                uv = rig.projected(k, (C[mine, None] + away).reshape(-1, 3))
                into[mine] = field.outside(uv).reshape(-1, depths.shape[1])
        return found

    def _derivatives(self, rig: Rig, k: Index, X: Array) -> tuple[Array, Array]:
        """Of how far points (m, 3) lie outside silhouettes k (m,): by the point (m, 3), px/m, in
        the object frame, and (m, 11) by the camera."""
        normal = np.empty((len(X), 2))
        for view, field in self._fields.items():
            mine = k == view
            if mine.any():
                normal[mine] = field.normal(rig.projected(view, X[mine]))
        R, K = rig.R[k], rig.K[k]
        local = np.einsum("mij,mj->mi", R, X - rig.C[k])
        x, y = local[:, 0] / local[:, 2], local[:, 1] / local[:, 2]
        across = normal * K[:, [0, 1], [0, 1]]
        p = np.column_stack([across, -(across[:, 0] * x + across[:, 1] * y)]) / local[:, 2:]
        own = np.zeros((len(X), SHARED))
        own[:, :3], own[:, 3:6] = np.cross(local, p), -p
        own[:, 6:8] = normal
        own[:, 8] = across[:, 0] * x + across[:, 1] * y
        own[:, 9] = across[:, 1] * y
        own[:, 10] = -own[:, 8] * (x * x + y * y)
        return np.einsum("mij,mi->mj", R, p), own


class DistanceImage:
    """One silhouette as an image of signed distances to its outline, px, outside positive; of large
    ones every so many pixels alone."""

    def __init__(self, contours: Contours, camera: Camera) -> None:
        uv, size = undistorted(contours.uv, camera), np.array([camera.width, camera.height])
        uv = np.clip(np.where(np.isfinite(uv), uv, contours.uv), -_FAR * size, (_FAR + 1) * size)
        self.low = np.floor(uv.min(axis=0)) - _MARGIN_PX
        shape = (np.ceil(uv.max(axis=0)) - self.low + _MARGIN_PX + 1)[::-1]
        larger = max(shape.prod() / (_DRAWN * _LARGE), (shape.max() / _LONGEST) ** 2)
        by = int(np.ceil(np.sqrt(larger)))  # pixels of the image to one drawn
        drawn = np.ceil(shape / by).astype(int)
        every = int(np.ceil(np.sqrt(drawn.prod() / _LARGE)))
        self._step = step = by * every
        scaled = np.round((uv - self.low) / by * 2**_SHIFT).astype(np.int32)
        filled = np.zeros(tuple(drawn), np.uint8)
        cv2.fillPoly(filled, contours.by_loop(scaled), 1, shift=_SHIFT)
        into, out = (
            by * cv2.distanceTransform(one, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[::every, ::every]
            for one in (filled, 1 - filled)
        )
        image = np.where(into > 0, 0.5 * by - into, out - 0.5 * by).astype(np.float32)
        v, u = np.nonzero(np.abs(image) < _EXACT_PX * step)
        points = step * np.column_stack([u, v]) + self.low
        image[v, u] = _from_outline(points, uv, contours)
        self._image = image
        # Where the border of the image cuts the outline, nothing is known beyond it.
        u, v = (
            step * np.arange(n) + low for n, low in zip(image.shape[::-1], self.low, strict=True)
        )
        sides, ends = (u < 0) | (u > camera.width - 1), (v < 0) | (v > camera.height - 1)
        unknown = sides | ends[:, None]
        self._image[unknown] = np.minimum(self._image[unknown], 0)
        self._most = np.array(image.shape[::-1], np.float32)[:, None] - np.float32(1)

    def outside(self, uv: Array) -> NDArray[np.float32]:
        """(n,) px of points (2, n); beyond the image of distances that of its border and on."""
        at = (uv - self.low[:, None]).astype(np.float32) / np.float32(self._step)
        clipped = self._within(at)
        off = self._step * np.abs(at - clipped)
        return _looked_up(self._image, clipped) + np.maximum(off[0], off[1])

    def normal(self, uv: Array) -> Array:
        """(n, 2) the way in which the distance grows at points (2, n), of length 1."""
        at = self._within((uv - self.low[:, None]).astype(np.float32) / np.float32(self._step))
        slope = np.empty((at.shape[1], 2))
        for k, way in enumerate(np.eye(2, dtype=np.float32)[:, :, None]):
            ahead, behind = self._within(at + way), self._within(at - way)
            slope[:, k] = _looked_up(self._image, ahead) - _looked_up(self._image, behind)
        length = np.linalg.norm(slope, axis=1, keepdims=True)
        return slope / np.maximum(length, 1e-6)

    def _within(self, at: NDArray[np.float32]) -> NDArray[np.float32]:
        """The nearest places (2, n) in the image of distances."""
        return np.minimum(np.maximum(at, np.float32(0)), self._most)


def _looked_up(image: NDArray[np.float32], at: NDArray[np.float32]) -> NDArray[np.float32]:
    """Bilinear values of an image at places (2, n) inside it."""
    found = np.empty(at.shape[1], np.float32)
    for k in range(0, len(found), _ROW):
        u, v = at[:, None, k : k + _ROW]
        part = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        found[k : k + _ROW] = part[0]
    return found


def _from_outline(points: Array, uv: Array, contours: Contours) -> Array:
    """(n,) signed distances of points (n, 2) near an outline to it with samples uv, px."""
    along = np.where(contours.linked[:, None], uv[contours.next_row] - uv, 0.0)
    along = along + along[contours.previous_row]
    # The object is on the left as displayed, with v down.
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    distance, row = cKDTree(uv).query(points)
    across = np.einsum("nk,nk->n", points - uv[row], normal[row])
    # Beside a corner its distance counts.
    return np.where(distance > np.abs(across) + 1, np.copysign(distance, across), across)
