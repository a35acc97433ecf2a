"""Cameras with small corrections: common to all views, of the lens, of the steps of a table, of
each view.

Every parameter is in pixels: of how far, about, it moves the image of the object. Then one prior
serves parameters of different units, and their sizes can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array

from .refine_lens import bent

POSE = 6  # rotation, then shift of the centre, both in the camera's frame
_LENS = POSE + 2  # the first after cx, cy
SHARED = _LENS + 3
_ON_AXIS = 0.02  # rms distance of the cameras from where one axis would have them, radii
# What calibrations are usually good for, 1 sigma, where they do not say it themselves: the
# principal point, of the image's longer side; logarithms of the focal length and of fy / fx; k1.
_CENTRE, _LEAST_CENTRE_PX = 0.01, 3.0
_LENS_SIGMA = np.array([0.015, 0.003, 0.03])
_FAR_PX = 1e6
WIDE_PX = 10.0  # 1 sigma of place and turn that all views share
_WIDEST = 3.0  # tangent of the angle from the optical axis where bends are no longer followed
_UNBENDING = 8  # rounds; each gains a digit for the bends of lenses
_LEAST_TURN = np.deg2rad(3)  # between the views farthest from each other


@dataclass(frozen=True)
class Rig:
    """The cameras of n views in arrays.

    Attributes:
        R: (n, 3, 3) float64, rotation object -> camera.
        C: (n, 3) float64, centres, metres, object frame.
        K: (n, 3, 3) float64, px, of images without distortion.
        bend: what distortion is left in these: points at a distance r from the principal point,
            in focal lengths, belong 1 + bend r^2 times as far from it.
    """

    R: Array
    C: Array
    K: Array
    bend: float = 0.0

    @staticmethod
    def of(cameras: Sequence[Camera]) -> Rig:
        """From cameras."""
        return Rig(
            np.array([camera.R_camera_object for camera in cameras]),
            np.array([camera.centre for camera in cameras]),
            np.array([camera.K for camera in cameras]),
        )

    def __len__(self) -> int:
        return len(self.C)

    @cached_property
    def focal(self) -> Array:
        """(n,) px."""
        return np.sqrt(self.K[:, 0, 0] * self.K[:, 1, 1])

    def pixel_at(self, point: Array) -> float:
        """What a pixel covers at a point (3,), metres, in the median."""
        return float(np.median(np.linalg.norm(self.C - point, axis=1) / self.focal))

    def cameras(self, lenses: Sequence[Camera]) -> list[Camera]:
        """The same as cameras that have the sizes and the distortions of others."""
        lenses = bent(lenses, self.K, self.bend) if self.bend else lenses
        return [
            replace(lens, K=K, R_camera_object=R, t_camera_object=-R @ C)
            for lens, K, R, C in zip(lenses, self.K, self.R, self.C, strict=True)
        ]

    def scaled(self, factor: float, about: Array) -> Rig:
        """The same views of a world that is so much larger."""
        return replace(self, C=about + factor * (self.C - about))

    def projected(self, k: int, points: Array) -> Array:
        """(2, m) px of points (m, 3) in a view; far outside of it what lies behind the camera."""
        KR = self.K[k] @ self.R[k]
        seen = KR @ points.T - (KR @ self.C[k])[:, None]
        ahead = seen[2] > 0
        uv = np.where(ahead, seen[:2] / np.where(ahead, seen[2], 1.0), _FAR_PX)
        if not self.bend:
            return uv
        centre, f = self.K[k, :2, 2:], self.K[k, [0, 1], [0, 1]][:, None]
        away = np.clip((uv - centre) / f, -_WIDEST, _WIDEST)
        return centre + f * away / (1 + self.bend * _unbent(self.bend, (away**2).sum(axis=0)))

    def rays(self, uv: Array) -> Array:
        """Unit viewing directions (n, m, 3), object frame, of m image points (n, m, 2) px."""
        K = self.K[:, :, :, None]
        y = (uv[..., 1] - K[:, 1, 2]) / K[:, 1, 1]
        x = (uv[..., 0] - K[:, 0, 2] - K[:, 0, 1] * y) / K[:, 0, 0]
        if self.bend:
            farther = 1 + self.bend * (x * x + y * y)
            x, y = farther * x, farther * y
        length = np.sqrt(x * x + y * y + 1)
        d = np.stack([x, y, np.ones_like(x)], axis=2) / length[:, :, None]
        rays: Array = d @ self.R
        return rays


def _unbent(bend: float, square: Array) -> Array:
    """The squared distances that points at squared distances (m,) have in images with a bend."""
    found = square
    for _ in range(_UNBENDING):
        found = square / (1 + bend * found) ** 2
    return found


@dataclass(frozen=True)
class Axis:
    """An axis that the cameras go around, in the object frame.

    Attributes:
        direction: (3,) float64, unit vector.
        point: (3,) float64, metres, nearest to the cameras' mean.
        error: rms distance of the cameras from where the axis would have them, divided by
            their distance from it.
    """

    direction: Array
    point: Array
    error: float


def common_axis(cameras: Sequence[Camera]) -> Axis | None:
    """The axis that takes every camera to every other, None where there is none.

    On a turntable R_i^T R_j, the turn from view j to view i in the object frame, has one axis
    for all pairs, and a point of it stays where it is.
    """
    rig = Rig.of(cameras)
    R, C = rig.R, rig.C
    i, j = np.triu_indices(len(cameras), 1)
    turn = np.swapaxes(R[i], 1, 2) @ R[j]
    cos = (np.trace(turn, axis1=1, axis2=2) - 1) / 2
    if not len(i) or np.arccos(np.clip(cos, -1, 1)).max() < _LEAST_TURN:
        return None
    still = turn - np.eye(3)
    direction = np.linalg.svd(np.einsum("pki,pkj->ij", still, still))[2][2]
    moved = C[i] - np.einsum("pij,pj->pi", turn, C[j])
    mean = C.mean(axis=0)
    # Along the axis nothing tells: the point nearest to the cameras.
    A = np.concatenate([-still.reshape(-1, 3), direction[None]])
    b = np.concatenate([moved.ravel(), [direction @ mean]])
    point = np.linalg.lstsq(A, b, rcond=None)[0]
    apart = moved + np.einsum("pij,j->pi", still, point)
    away = np.linalg.norm(np.cross(C - point, direction), axis=1)
    if not away.min() > 0:
        return None
    error = float(np.sqrt((apart**2).sum(axis=1).mean()) / np.median(away))
    return Axis(direction, point, error) if error < _ON_AXIS else None


def moved_alike(rig: Rig, common: Array) -> Rig:
    """Cameras that all have the same corrections (11,): rotation (rad) and shift (m) in their own
    frames, cx and cy (px), logarithms of the focal length and of fy / fx, bend."""
    R, C = _moved(rig.R, rig.C, np.tile(common[:POSE], (len(rig), 1)))
    K, (focal, aspect, bend) = rig.K.copy(), common[_LENS:]
    K[:, 0, :2] *= np.exp(focal)
    K[:, 1, 1] *= np.exp(focal + aspect)
    K[:, :2, 2] += common[POSE:_LENS]
    return Rig(R, C, K, float(bend))


def _moved(R: Array, C: Array, by: Array) -> tuple[Array, Array]:
    """Cameras turned (rad) and shifted (m) in their own frames, by (n, 6)."""
    C = C + np.einsum("nij,ni->nj", R, by[:, 3:])
    return Rotation.from_rotvec(by[:, :3]).as_matrix() @ R, C


class Corrections:
    """The cameras as a function of the parameters.

    The parameters, all in pixels, are 6 common ones (rotation 3 and shift 3 of the cameras in
    their own frame, the same for all views), those of the lens (cx, cy; focal length; fy / fx;
    distortion that is left), then the steps (n; none without an axis), then 6 for each view.

    Args:
        cameras: n, as given.
        middle: (3,) float64, of the object, metres.
        radius: of the object, metres.
        axis: of the table, or None.

    Attributes:
        groups: the parameters of each group; "focal" is one of "lens".
        lens_px: (5,) what those of the lens are usually known to, 1 sigma.
    """

    def __init__(
        self, cameras: Sequence[Camera], middle: Array, radius: float, axis: Axis | None
    ) -> None:
        self.given = Rig.of(cameras)
        n, f = len(cameras), self.given.focal
        away = np.linalg.norm(self.given.C - middle, axis=1)
        size = f * radius / away  # px
        self.axis = axis
        steps = n if axis else 0
        self.groups = {
            "common": slice(0, POSE),
            "lens": slice(POSE, SHARED),
            "focal": slice(_LENS, _LENS + 1),
            "steps": slice(SHARED, SHARED + steps),
            "views": slice(SHARED + steps, SHARED + steps + POSE * n),
        }
        # Radians or metres that a pixel is.
        pixel = np.empty((n, POSE))
        pixel[:, :2], pixel[:, 2] = 1 / f[:, None], 1 / size
        pixel[:, 3:5], pixel[:, 5] = (away / f)[:, None], away / size
        self._pixel = pixel
        self._step = float(np.median(1 / size))
        # The outline's far end from the principal point, in focal lengths.
        centre = np.array([camera.project(middle[None])[0] for camera in cameras])
        off = np.linalg.norm(centre - self.given.K[:, :2, 2], axis=1)
        wide = float(np.median(np.minimum((off + size) / f, 1.0)))
        bend = float(1 / (np.median(f) * wide**3))
        self._shared = np.concatenate(
            [np.median(pixel, axis=0), [1.0, 1.0, self._step, self._step, bend]]
        )
        width = float(np.median([max(camera.width, camera.height) for camera in cameras]))
        centre_px = max(_CENTRE * width, _LEAST_CENTRE_PX)
        lens = _LENS_SIGMA / self._shared[_LENS:]
        self.lens_px = np.concatenate([[centre_px, centre_px], lens])

    def __len__(self) -> int:
        return self.groups["views"].stop

    def lens_of(self, group: str) -> Array:
        """What the parameters of a group, all of them of the lens, are usually known to, px."""
        lens, mine = self.groups["lens"].start, self.groups[group]
        usual: Array = self.lens_px[mine.start - lens : mine.stop - lens]
        return usual

    def of(self, x: Array) -> Rig:
        """The cameras with corrections (len(self),) in pixels."""
        n = len(self.given)
        steps = x[self.groups["steps"]]
        R, C = self.given.R, self.given.C
        if self.axis is not None:
            turn = Rotation.from_rotvec(self._step * steps[:, None] * self.axis.direction)
            R = R @ np.swapaxes(turn.as_matrix(), 1, 2)
            C = self.axis.point + turn.apply(C - self.axis.point)
        rig = moved_alike(Rig(R, C, self.given.K), self._shared * x[:SHARED])
        R, C = _moved(rig.R, rig.C, x[self.groups["views"]].reshape(n, POSE) * self._pixel)
        return Rig(R, C, rig.K, rig.bend)

    def chain(self, by_camera: Array, camera: NDArray[np.intp], rig: Rig) -> csr_matrix:
        """Derivatives by the parameters from those by single cameras.

        Args:
            by_camera: (m, s, 11) float64: of m values by rotation (rad), shift (m), cx and cy
                (px), logarithms of the focal length and of fy / fx, and bend of s cameras each.
            camera: (m, s), which.
            rig: where the derivatives were taken.

        Returns:
            (m, len(self)) float64.
        """
        m = len(by_camera)
        values = [by_camera.sum(axis=1) * self._shared]
        columns = [np.broadcast_to(np.arange(SHARED), (m, SHARED))]
        own = by_camera[:, :, :POSE]
        if self.axis is not None:
            values.append(np.einsum("msk,msk->ms", own, self._by_step(rig)[camera]))
            columns.append(self.groups["steps"].start + camera)
        values.append((own * self._pixel[camera]).reshape(m, -1))
        first = self.groups["views"].start + POSE * camera
        columns.append((first[:, :, None] + np.arange(POSE)).reshape(m, -1))
        data, indices = np.concatenate(values, axis=1), np.concatenate(columns, axis=1)
        ends = np.arange(m + 1) * data.shape[1]
        return csr_matrix((data.ravel(), indices.ravel(), ends), shape=(m, len(self)))

    def common(self, x: Array, sigma: Array) -> tuple[Array, Array]:
        """What all views share, (11,) as of ``moved_alike``, and its sigma from that (11,) px."""
        return x[:SHARED] * self._shared, sigma * self._shared

    def steps(self, x: Array) -> Array:
        """(n,) corrections of the angles about the axis, rad; zero without one."""
        n = len(self.given)
        return np.zeros(n) if self.axis is None else self._step * x[self.groups["steps"]]

    def covariance(self, rig: Rig, covariance: Array) -> Array:
        """(n, 6, 6) of each camera's rotation (rad) and centre (m), in its own frame, from the
        covariance of the parameters."""
        n = len(self.given)
        by_camera = np.zeros((n * POSE, 1, SHARED))
        by_camera[:, 0, :POSE] = np.tile(np.eye(POSE), (n, 1))
        J = self.chain(by_camera, np.repeat(np.arange(n), POSE)[:, None], rig)
        rows = [J[POSE * k : POSE * (k + 1)] for k in range(n)]
        return np.array([row @ (row @ covariance).T for row in rows])

    def _by_step(self, rig: Rig) -> Array:
        """(n, 6) how cameras turn and move with their steps."""
        assert self.axis is not None
        along = np.cross(self.axis.direction, rig.C - self.axis.point)
        turn = np.einsum("nij,j->ni", rig.R, self.axis.direction)
        moved = np.einsum("nij,nj->ni", rig.R, along)
        return self._step * np.concatenate([-turn, moved], axis=1)
