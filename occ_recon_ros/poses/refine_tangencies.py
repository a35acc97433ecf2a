"""Outer epipolar tangencies: planes through two centres that touch the object.

The two planes of the pencil that touch the outline of one view touch that of the other, at the
frontier points, whatever the shape of the body (Mendonca, Wong and Cipolla, IEEE PAMI 23(6), 2001,
doi:10.1109/34.927465). They touch convex hulls, so that nothing has to be matched. By how much
the planes differ says how far the cameras are off.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, Index

from .refine_lens import undistorted
from .refine_rig import SHARED, Rig

_BORDER_PX = 2.0
_UNSURE = 3.0  # sigmas of the view: corners, contacts with the table
_STEEPEST = 1.4  # rad between tangent plane and the object's middle: the epipole is beside it
_LEAST_LEVER = 0.15  # of the object's radius, from the epipole to where the plane touches
_SHORTEST = 0.02  # of the usual baseline
_AT_ONCE = 2**14  # angles of rays, about, that are computed together


@dataclass(frozen=True)
class HullView:
    """The convex hull of one view's outline.

    Attributes:
        uv: (m, 2) float64, its samples, px without distortion.
        sigma: (m,) float64, 1 sigma across the outline, px; infinite where the outline is cut.
    """

    uv: Array
    sigma: Array

    @staticmethod
    def of(contours: Contours, camera: Camera) -> HullView | None:
        """From a view's outline; None if it has none, or one without an area."""
        if len(contours) < 8:
            return None
        inside = (contours.T @ contours.middle) > 0
        frame = np.linalg.svd(contours.middle[None])[2]
        ray = contours.T @ frame.T
        if not inside.all():
            return None
        try:
            rows = ConvexHull(ray[:, 1:] / ray[:, :1]).vertices
        except QhullError:
            return None
        uv = contours.uv[rows]
        sigma = contours.sigma[rows] / contours.radians_per_pixel
        usual = contours.usual_sigma / contours.radians_per_pixel
        usual = usual if np.isfinite(usual) else 0.5
        sigma = np.where(np.isfinite(sigma), sigma, _UNSURE * usual)
        size = np.array([camera.width, camera.height]) - 1.0
        cut = ((uv < _BORDER_PX) | (uv > size - _BORDER_PX)).any(axis=1)
        cut |= ~(contours.linked & contours.linked[contours.previous_row])[rows]
        return HullView(undistorted(uv, camera), np.where(cut, np.inf, sigma))


def hulls_of(
    contours: Sequence[Contours | None], cameras: Sequence[Camera]
) -> list[HullView | None]:
    """Those of views, None where one has no outline or one without an area."""
    pairs = zip(contours, cameras, strict=True)
    return [None if c is None else HullView.of(c, camera) for c, camera in pairs]


@dataclass(frozen=True)
class Residuals:
    """m differences between what views see of one thing.

    Attributes:
        value: (m,) float64, px.
        sigma: (m,) float64, as the outlines' own sigmas predict, px.
        camera: (m, s) intp, the cameras that each depends on.
        by_camera: (m, s, 11) float64, derivatives by rotation (rad), shift of the centre (m),
            both in the camera's frame, cx and cy (px), logarithms of the focal length and of
            fy / fx, and ``Rig.bend``.
    """

    value: Array
    sigma: Array
    camera: Index
    by_camera: Array

    def __len__(self) -> int:
        return len(self.value)


class Tangencies:
    """The outer tangencies of all pairs of views.

    Args:
        hulls: one a view, None where it has no outline.

    Attributes:
        pairs: (2, p) intp, views that are compared.
        usual_sigma: of a residual, px, in the median.
    """

    def __init__(self, hulls: Sequence[HullView | None]) -> None:
        seen = [(k, h) for k, h in enumerate(hulls) if h is not None]
        most = max(len(h.uv) for _, h in seen)
        # Short ones are filled up with their last sample.
        self._uv = np.zeros((len(hulls), most, 2))
        self._sigma = np.full((len(hulls), most), np.inf)
        for k, h in seen:
            rows = np.minimum(np.arange(most), len(h.uv) - 1)
            self._uv[k], self._sigma[k] = h.uv[rows], h.sigma[rows]
        first, second = np.triu_indices(len(seen), 1)
        which = np.array([k for k, _ in seen])
        self.pairs = np.stack([which[first], which[second]])
        known = self._sigma[np.isfinite(self._sigma)]
        self.usual_sigma = float(np.sqrt(2) * np.median(known)) if len(known) else float("nan")

    def between(self, one: NDArray[np.bool_]) -> Tangencies:
        """Those of pairs of a view of one part (n,) with a view of the other."""
        return self._of(one[self.pairs[0]] != one[self.pairs[1]])

    def within(self, one: NDArray[np.bool_]) -> Tangencies:
        """Those of pairs of views of the same part (n,)."""
        return self._of(one[self.pairs[0]] == one[self.pairs[1]])

    def _of(self, which: NDArray[np.bool_]) -> Tangencies:
        found = copy(self)
        found.pairs = self.pairs[:, which]
        return found

    def rays(self, rig: Rig) -> Array:
        """(n, most, 3) viewing directions of the hulls' samples; of no meaning where a view
        has none."""
        return rig.rays(self._uv)

    def residuals(self, rig: Rig) -> tuple[Residuals, Index]:
        """Compare the tangent planes of all pairs.

        Returns:
            The residuals, those that the views do not bear out left out, and (m,) the
            place of each in the list of all (2 for each pair).
        """
        T, C, R, f = self.rays(rig), rig.C, rig.R, rig.focal
        middle = T.mean(axis=1)
        i, j = self.pairs
        b = C[j] - C[i]
        length = np.linalg.norm(b, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            b = b / length[:, None]
        towards = middle[i] + middle[j]
        u = towards - np.einsum("pk,pk->p", towards, b)[:, None] * b
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        ends = _extremes(T, self.pairs, u, np.cross(b, u))
        radius = half_angles(T)
        parts, places = [], []
        for end in (0, 1):
            phi, row = zip(*((p[:, end], r[:, end]) for p, r in ends), strict=True)
            touch = [T[k, r] for k, r in zip((i, j), row, strict=True)]
            along = [np.einsum("pk,pk->p", t, b) for t in touch]
            lever = [np.sqrt(np.maximum(1 - a * a, 0)) for a in along]
            sigma = [self._sigma[k, r] for k, r in zip((i, j), row, strict=True)]
            with np.errstate(divide="ignore", invalid="ignore"):
                spread = np.hypot(sigma[0] / f[i] / lever[0], sigma[1] / f[j] / lever[1])
                # The angle in pixels, on the image where it says less.
                px = np.minimum(lever[0] * f[i], lever[1] * f[j])
            good = np.isfinite(spread) & (length > _SHORTEST * np.median(length))
            for angle, side, k in zip(phi, lever, (i, j), strict=True):
                good &= (np.abs(angle) < _STEEPEST) & (side > _LEAST_LEVER * radius[k])
            good &= np.abs(phi[0] - phi[1]) < np.minimum(radius[i] / lever[0], radius[j] / lever[1])
            k = np.flatnonzero(good)
            normal = np.cross(b, touch[0])[k] / lever[0][k, None]
            by = [
                derivatives(rig, pair[k], ray[k], normal, 1 / side[k])
                for pair, ray, side in zip((i, j), touch, lever, strict=True)
            ]
            cot = (along[0] / lever[0] - along[1] / lever[1])[k]
            turned = (cot / length[k])[:, None] * normal
            by[1] = -by[1]
            by[0][:, 3:6] += np.einsum("pij,pj->pi", R[i[k]], turned)
            by[1][:, 3:6] -= np.einsum("pij,pj->pi", R[j[k]], turned)
            parts.append(
                Residuals(
                    px[k] * (phi[0] - phi[1])[k],
                    px[k] * spread[k],
                    np.stack([i[k], j[k]], axis=1),
                    px[k, None, None] * np.stack(by, axis=1),
                )
            )
            places.append(2 * k + end)
        return joined(parts), np.concatenate(places)


def joined(parts: Sequence[Residuals]) -> Residuals:
    """Residuals of the same number of cameras, one after the other."""
    return Residuals(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("value", "sigma", "camera", "by_camera")
        )
    )


def _extremes(T: Array, pairs: Index, u: Array, v: Array) -> list[tuple[Array, Index]]:
    """Where the outlines of both views of p pairs end in their pencil of planes.

    Args:
        T: (n, m, 3) rays of each view.
        pairs: (2, p).
        u, v: (p, 3) across the baseline, towards the object and across that.

    Returns:
        For either view of the pairs least and largest angle (p, 2), NaN where the outline is
        not all on the object's side, and the rows (p, 2) of the rays.
    """
    found = []
    for side in pairs:
        angle, row = np.full((len(side), 2), np.nan), np.zeros((len(side), 2), np.intp)
        size = np.cumsum(np.bincount(side, minlength=len(T))) * T.shape[1]
        for views in np.split(np.arange(len(T)), 1 + np.flatnonzero(np.diff(size // _AT_ONCE))):
            rows = [np.flatnonzero(side == k) for k in views]
            mine = np.concatenate(rows)
            x, y = np.empty((2, len(mine), T.shape[1]))
            last = 0
            for k, r in zip(views, rows, strict=True):
                first, last = last, last + len(r)
                x[first:last], y[first:last] = (T[k] @ u[r].T).T, (T[k] @ v[r].T).T
            whole = x.min(axis=1) > 0
            tan = y / np.where(whole[:, None], x, 1.0)
            ends = np.stack([tan.argmin(axis=1), tan.argmax(axis=1)], axis=1)
            value = np.arctan(np.take_along_axis(tan, ends, axis=1))
            row[mine], angle[mine] = ends, np.where(whole[:, None], value, np.nan)
        found.append((angle, row))
    return found


def half_angles(T: Array) -> Array:
    """(n,) largest angle of rays (n, m, 3) from their mean, rad."""
    middle = T.mean(axis=1)
    cos = np.einsum("nmk,nk->nm", T, middle).min(axis=1)
    length = np.maximum(np.linalg.norm(middle, axis=1), 1e-12)
    return np.arccos(np.clip(cos / length, -1, 1))


def derivatives(rig: Rig, k: Index, T: Array, normal: Array, scale: Array) -> Array:
    """How far rays move along normals across them, by their cameras.

    Args:
        k: (p,) the camera of each ray.
        T: (p, 3) unit rays, object frame.
        normal: (p, 3) unit vectors across them.
        scale: (p,) factor.

    Returns:
        (p, 11) as ``Residuals.by_camera``, the centre left out.
    """
    R, fx, fy = rig.R[k], rig.K[k, 0, 0], rig.K[k, 1, 1]
    d, n = np.einsum("pij,pj->pi", R, T), np.einsum("pij,pj->pi", R, normal)
    result = np.zeros((len(k), SHARED))
    result[:, :3] = np.cross(n, d)
    depth = d[:, 2]
    result[:, 6], result[:, 7] = -n[:, 0] * depth / fx, -n[:, 1] * depth / fy
    result[:, 8] = -(n[:, 0] * d[:, 0] + n[:, 1] * d[:, 1])
    result[:, 9] = -n[:, 1] * d[:, 1]
    result[:, 10] = -result[:, 8] * (d[:, 0] ** 2 + d[:, 1] ** 2) / depth**2
    return result * scale[:, None]
