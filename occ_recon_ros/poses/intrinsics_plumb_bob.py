"""Intrinsics of a usual lens (plumb_bob) from views of a board: one minimum, and its covariance.

The minimum is found by OpenCV, the covariance is ours: OpenCV counts a corner as one measurement
where it is two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from occ_recon_ros.geometry.arrays import Array

_CENTRED, _SQUARE = 0.01, 0.002  # 1 sigma: the principal point of a lens, in image widths; fx / fy
_LENS = (0.3, 0.5, 1e-3, 1e-3)  # 1 sigma of k1, k2, p1, p2 of a lens
_STEPS, _SETTLED_PX = 10, 0.01


def straight_ahead(focal_px: float, size: tuple[int, int]) -> Array:
    """(3, 3) K of a lens that looks at the middle of its image."""
    u, v = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array([[focal_px, 0, u], [0, focal_px, v], [0, 0, 1.0]])


def _distances(
    points: list[Array],
    uv: list[Array],
    turns: list[Array],
    shifts: list[Array],
    K: Array,
    D: Array,
) -> list[Array]:
    """(n,) px of each view, how far corners are from where they should be."""
    distances = []
    for p, w, r, t in zip(points, uv, turns, shifts, strict=True):
        shown = np.asarray(cv2.projectPoints(p, r, t, K, D)[0], np.float64)
        distances.append(np.linalg.norm(shown.reshape(-1, 2) - w, axis=1))
    return distances


def beside_pose(own: Array, pose: Array) -> Array:
    """(2n, k) derivatives by the camera's parameters, (2n, k), a view's pose, of which those are
    (2n, 6), having moved along."""
    q, _ = np.linalg.qr(pose / np.linalg.norm(pose, axis=0))
    left: Array = own - q @ (q.T @ own)
    return left


def parameter_sigmas(information: Array, variance: float) -> Array:
    """(9,) 1 sigma of the first k parameters, by their information (k, k) and the variance of a
    coordinate of a corner; 0 of the others."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    result = np.zeros(9)
    with np.errstate(invalid="ignore"):
        result[: len(scale)] = np.sqrt(np.diag(inverse)) / scale * np.sqrt(variance)
    return result


@dataclass(frozen=True)
class _Seen:
    """Where the corners of a view should be, (n, 2) px, and the derivatives of that, row by row,
    by the view's pose (2n, 6) and by the camera's parameters (2n, k)."""

    uv: Array
    pose: Array
    own: Array


@dataclass(frozen=True)
class PlumbBobFit:
    """One minimum: with 4 coefficients of distortion, or 5; with 1 it is begun with one, with the
    principal point in the middle, and ended with all that is believed of lenses."""

    K: Array
    D: Array
    distortion: int
    turns: list[Array]
    shifts: list[Array]
    points: list[Array]
    uv: list[Array]
    distances: list[Array]

    @classmethod
    def of(
        cls,
        points: list[Array],
        uv: list[Array],
        size: tuple[int, int],
        focal_px: float | None,
        distortion: int,
    ) -> PlumbBobFit:
        flags = 0 if distortion == 5 else cv2.CALIB_FIX_K3
        if distortion < 4:
            flags |= cv2.CALIB_FIX_K2 | cv2.CALIB_ZERO_TANGENT_DIST
            flags |= cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
            focal_px = focal_px or float(max(size))
        guess = None
        if focal_px is None and any(np.ptp(p[:, 2]) > 0 for p in points):
            focal_px = 1.2 * max(size)  # OpenCV finds one of its own for flat boards alone
        if focal_px is not None:
            flags |= cv2.CALIB_USE_INTRINSIC_GUESS
            guess = straight_ahead(focal_px, size)
        try:
            _, K, D, turns, shifts = cv2.calibrateCamera(
                [p.astype(np.float32) for p in points],
                [w.astype(np.float32) for w in uv],
                size,
                guess,
                np.zeros(5),
                flags=flags,
                criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12),
            )
        except cv2.error as error:
            raise ValueError(f"the views do not determine the camera ({error.err})") from None
        K, D = np.asarray(K, np.float64), np.asarray(D, np.float64).ravel()[:5]
        if not (np.isfinite(K).all() and np.isfinite(D).all() and K[0, 0] > 0 and K[1, 1] > 0):
            raise ValueError("these views do not determine the camera: tilt the board")
        bends = [np.asarray(turn, np.float64).ravel() for turn in turns]
        moves = [np.asarray(shift, np.float64).ravel() for shift in shifts]
        distances = _distances(points, uv, bends, moves, np.array(K), D)
        fit = cls(np.array(K), D, distortion, bends, moves, points, uv, distances)
        return fit if distortion >= 4 else fit._with_what_is_believed(size)

    def _with_what_is_believed(self, size: tuple[int, int]) -> PlumbBobFit:
        """Principal point and distortion as far as the corners ask for them against what is
        believed of lenses, by steps of Gauss and Newton."""
        count, fit = 4 + len(_LENS), self
        middle = (np.array(size) - 1) / 2
        for _ in range(_STEPS):
            seen = fit._seen(count)
            rests = [(uv - view.uv).ravel() for uv, view in zip(fit.uv, seen, strict=True)]
            # What is wrong with the sheet is wrong in all views alike: they count as one.
            variance = max(fit.variance, 1e-6) * len(fit.uv)
            prior = _belief(fit.K[0, 0], size[0])
            now = np.array(
                [fit.K[0, 0], fit.K[1, 1], *(fit.K[:2, 2] - middle), *fit.D[: len(_LENS)]]
            )
            A, b = prior.T @ prior, -prior.T @ (prior @ now)
            for view, rest in zip(seen, rests, strict=True):
                left = beside_pose(view.own, view.pose)
                A, b = A + left.T @ left / variance, b + left.T @ rest / variance
            move = np.linalg.solve(A, b)
            poses = [
                np.linalg.lstsq(view.pose, rest - view.own @ move, rcond=None)[0]
                for view, rest in zip(seen, rests, strict=True)
            ]
            K, D = fit.K.copy(), fit.D.copy()
            K[[0, 1, 0, 1], [0, 1, 2, 2]] += move[:4]
            D[: len(_LENS)] += move[4:]
            turns = [t + p[:3] for t, p in zip(fit.turns, poses, strict=True)]
            shifts = [t + p[3:] for t, p in zip(fit.shifts, poses, strict=True)]
            distances = _distances(fit.points, fit.uv, turns, shifts, K, D)
            fit = replace(fit, K=K, D=D, turns=turns, shifts=shifts, distances=distances)
            if np.abs(move[:4]).max() < _SETTLED_PX:
                break
        return fit

    def _seen(self, count: int) -> list[_Seen]:
        """Each view, with the derivatives by the first of fx fy cx cy k1 k2 p1 p2 k3."""
        seen = []
        for points, turn, shift in zip(self.points, self.turns, self.shifts, strict=True):
            found = cv2.projectPoints(points, turn, shift, self.K, self.D)
            uv, J = (np.asarray(array, np.float64) for array in found)
            seen.append(_Seen(uv.reshape(-1, 2), J[:, :6], J[:, 6 : 6 + count]))
        return seen

    @property
    def squares(self) -> float:
        return float(sum(rest @ rest for rest in self.distances))

    @property
    def variance(self) -> float:
        """Of one coordinate of a corner."""
        count = 2 * sum(map(len, self.uv)) - 4 - self.distortion - 6 * len(self.uv)
        return self.squares / max(count, 1)

    def sigma(self) -> Array:
        """(9,) 1 sigma of the parameters; each view's pose is eliminated first."""
        held = self.distortion < 4
        count = 4 + (len(_LENS) if held else self.distortion)
        information = np.zeros((count, count))
        for view in self._seen(count):
            left = beside_pose(view.own, view.pose)
            information += left.T @ left
        if held:
            prior = _belief(self.K[0, 0], 2 * self.K[0, 2])
            information = information / len(self.uv) + prior.T @ prior * self.variance
        return parameter_sigmas(information, self.variance)


def _belief(focal: float, width: float) -> Array:
    """(7, 8): rows that are 1 sigma of what is believed of fx, fy, cx, cy (from the middle) and
    the distortion of a lens."""
    prior = np.zeros((3 + len(_LENS), 4 + len(_LENS)))
    prior[0, :2] = [1 / (_SQUARE * focal), -1 / (_SQUARE * focal)]
    prior[[1, 2], [2, 3]] = 1 / (_CENTRED * width)
    prior[3:, 4:] = np.diag(1 / np.array(_LENS))
    return prior
