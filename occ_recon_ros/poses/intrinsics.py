"""Intrinsics of a camera from views of a board, with what is known of them.

Z. Zhang, "A flexible new technique for camera calibration", PAMI 22(11), 2000,
doi:10.1109/34.888718; the minimum is found by OpenCV, the covariance is ours: OpenCV counts a
corner as one measurement where it is two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array

from .board_pose import candidate_poses

FEWEST_VIEWS = 3
_FEWEST_CORNERS = 8
_CUT = 6.0  # sigmas
_WORST = 0.5  # of the farthest corner's distance: what is left out at once
_ROUNDS = 6
_SIGNIFICANT = float(chdtri(1, 1e-3))  # chi-square: what a further coefficient must gain
_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_TILTED = np.deg2rad(8)  # how far the board's tilts must differ to tell more than f
_CENTRED, _SQUARE = 0.01, 0.002  # 1 sigma: the principal point of a lens, in image widths; fx / fy
_LENS = (0.3, 0.5, 1e-3, 1e-3)  # 1 sigma of k1, k2, p1, p2 of a lens
_STEPS, _SETTLED_PX = 10, 0.01
_GRID = 8  # cells along each side of the image, to see where corners were
_GOOD_F, _FAIR_F = 0.002, 0.01  # relative sigma of the focal length
_GOOD_COVERAGE = 0.5
_GOOD_RMS_PX = 1.0


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in one image.

    Attributes:
        name: of the image.
        points: (n, 3) float64, board frame, metres.
        uv: (n, 2) float64, pixels.
    """

    name: str
    points: Array
    uv: Array


@dataclass(frozen=True)
class Intrinsics:
    """A calibration.

    Attributes:
        camera: K, D (plumb_bob), width and height; its pose means nothing.
        sigma: (9,) float64, 1 sigma of fx, fy, cx, cy, k1, k2, p1, p2, k3; 0 for what was held.
        rms_px: of one corner's distance.
        view_rms_px: the same for each view.
        views: their names, those used.
        rejected: corners left out as wrong.
        coverage: share of the image, in cells, in which corners were.
        centred: all views had one tilt: that the principal point is near the middle, and the
            lens a usual one, is a part of the fit.
    """

    camera: Camera
    sigma: Array
    rms_px: float
    view_rms_px: Array
    views: tuple[str, ...]
    rejected: int
    coverage: float
    centred: bool = False

    @property
    def verdict(self) -> tuple[str, str]:
        """good, fair or poor, and why."""
        K, relative = self.camera.K, self.sigma[0] / self.camera.K[0, 0]
        size = max(self.camera.width, self.camera.height)
        numbers = (
            f"f {K[0, 0]:.1f} +- {self.sigma[0]:.1f} px ({100 * relative:.2f} %), principal point "
            f"({K[0, 2]:.1f} +- {self.sigma[2]:.1f}, {K[1, 2]:.1f} +- {self.sigma[3]:.1f}) px, "
            f"{self.rms_px:.2f} px off in the mean"
        )
        advice = []
        if self.centred:
            advice.append(
                "all views show the board under one tilt, which says little of the principal "
                "point: it is taken to be near the middle; 'occ-recon calibrate intrinsics' with "
                "a tilted board does better"
            )
        if relative > _GOOD_F and not self.centred:
            advice.append("tilt the board more (30 to 45 degrees) and vary its distance")
        if self.coverage < _GOOD_COVERAGE and not self.centred:
            advice.append(
                f"bring it to the borders too (corners were in {100 * self.coverage:.0f} % of "
                "the image)"
            )
        if self.rms_px > _GOOD_RMS_PX * size / 1000:
            advice.append("glue the sheet flat, measure its squares, keep the camera still")
        word = "good" if not advice else "fair"
        if relative > _FAIR_F or self.rms_px > 3 * _GOOD_RMS_PX * size / 1000:
            word = "poor"
        return word, numbers + (": " + "; ".join(advice) if advice else "")


def calibrate_intrinsics(
    views: Sequence[BoardView],
    size: tuple[int, int],
    focal_px: float | None = None,
) -> Intrinsics:
    """Focal length, principal point and distortion.

    The third radial coefficient is held at 0 unless it fits significantly better. The tangential
    ones are not: held, they would move the principal point by more than its sigma. Where all views
    show the board under one tilt (it lies on a turntable before a fixed camera), they say little
    of where the principal point is along that tilt: what is believed of lenses is then a part of
    the fit and of the sigmas, which ``centred`` says.

    Args:
        views: at least three with eight corners or more, not all from one direction.
        size: width and height of the images, pixels.
        focal_px: a first guess (EXIF), or None.

    Raises:
        ValueError: too few views, or views that do not determine it.
    """
    usable = [view for view in views if len(view.points) >= _FEWEST_CORNERS]
    if len(usable) < FEWEST_VIEWS:
        raise ValueError(
            f"{len(usable)} view{' shows' if len(usable) == 1 else 's show'} {_FEWEST_CORNERS} "
            f"corners of the board or more: {FEWEST_VIEWS} are needed, 15 are good"
        )
    points = [view.points for view in usable]
    uv = [view.uv for view in usable]
    total = sum(map(len, uv))
    tilts = _tilts(points, uv, size, focal_px)
    full = 4 if tilts > _TILTED else 1
    fit = _Fit.of(points, uv, size, focal_px, full)
    kept = list(range(len(usable)))
    for _ in range(_ROUNDS):  # the worst corners first: they bend the rest
        sigma_px = _sigma(np.concatenate(fit.distances))
        bound = max(_CUT * sigma_px, _WORST * max(float(rest.max()) for rest in fit.distances))
        good = [rest <= bound for rest in fit.distances]
        if all(g.all() for g in good):
            break
        enough = [k for k, g in enumerate(good) if g.sum() >= _FEWEST_CORNERS]
        if len(enough) < FEWEST_VIEWS:
            raise ValueError("the corners contradict each other: is it the board of board.yaml?")
        points = [points[k][good[k]] for k in enough]
        uv = [uv[k][good[k]] for k in enough]
        kept = [kept[k] for k in enough]
        fit = _Fit.of(points, uv, size, fit.K[0, 0], full)
    if full == 4:
        other = _Fit.of(points, uv, size, fit.K[0, 0], 5)
        fit = other if (fit.squares - other.squares) / other.variance > _SIGNIFICANT else fit
    sigma = fit.sigma()
    if not np.isfinite(sigma).all() or sigma[0] > 0.5 * fit.K[0, 0]:
        raise ValueError(
            "these views do not determine the camera: tilt the board, in several directions"
        )
    inside = np.concatenate(uv) / np.array(size) * _GRID
    cells = np.unique(np.clip(inside.astype(int), 0, _GRID - 1), axis=0)
    model = "plumb_bob" if fit.D.any() else "none"
    camera = Camera(fit.K, *size, np.eye(3), np.zeros(3), fit.D, model)
    return Intrinsics(
        camera=camera,
        sigma=sigma,
        rms_px=float(np.sqrt(fit.squares / sum(map(len, uv)))),
        view_rms_px=np.array([np.sqrt(np.mean(rest**2)) for rest in fit.distances]),
        views=tuple(usable[k].name for k in kept),
        rejected=total - sum(map(len, uv)),
        coverage=len(cells) / _GRID**2,
        centred=full == 1,
    )


def _tilts(
    points: list[Array], uv: list[Array], size: tuple[int, int], focal_px: float | None
) -> float:
    """How far the board's normals differ in the camera's frame, radians: the second largest
    spread of directions would need a camera; a guessed one tells parallel from not."""
    K = _guess(focal_px or 1.2 * max(size), size)
    guess = Camera(K, *size, np.eye(3), np.zeros(3))
    normals = [
        found[0].pose.R_object_camera[2]
        for p, w in zip(points, uv, strict=True)
        if (found := candidate_poses(guess, p, w))
    ]
    if len(normals) < FEWEST_VIEWS:
        return np.inf
    n = np.array(normals)
    middle = np.median(n, axis=0)
    apart = np.arccos(np.clip(n @ middle / np.linalg.norm(middle), -1, 1))
    return float(np.percentile(apart, 90))


def _guess(focal_px: float, size: tuple[int, int]) -> Array:
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


def _sigma(distances: Array) -> float:
    """1 sigma of a coordinate, unmoved by wrong corners."""
    return max(float(np.median(distances)) / np.sqrt(2 * np.log(2)), 0.02)


@dataclass(frozen=True)
class _Seen:
    """Where the corners of a view should be, (n, 2) px, and the derivatives of that, row by row,
    by the view's pose (2n, 6) and by the camera's parameters (2n, k)."""

    uv: Array
    pose: Array
    own: Array

    @property
    def left(self) -> Array:
        """(2n, k) by the camera's, the pose having moved along."""
        q, _ = np.linalg.qr(self.pose / np.linalg.norm(self.pose, axis=0))
        left: Array = self.own - q @ (q.T @ self.own)
        return left


@dataclass(frozen=True)
class _Fit:
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
    ) -> _Fit:
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
            guess = _guess(focal_px, size)
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

    def _with_what_is_believed(self, size: tuple[int, int]) -> _Fit:
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
                left = view.left
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
            left = view.left
            information += left.T @ left
        if held:
            prior = _belief(self.K[0, 0], 2 * self.K[0, 2])
            information = information / len(self.uv) + prior.T @ prior * self.variance
        scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
        normal = information / np.outer(scale, scale)
        with np.errstate(invalid="ignore"):
            spread = np.sqrt(np.diag(np.linalg.pinv(normal, hermitian=True))) / scale
        result = np.zeros(9)
        result[:count] = spread * np.sqrt(self.variance)
        return result


def _belief(focal: float, width: float) -> Array:
    """(7, 8): rows that are 1 sigma of what is believed of fx, fy, cx, cy (from the middle) and
    the distortion of a lens."""
    prior = np.zeros((3 + len(_LENS), 4 + len(_LENS)))
    prior[0, :2] = [1 / (_SQUARE * focal), -1 / (_SQUARE * focal)]
    prior[[1, 2], [2, 3]] = 1 / (_CENTRED * width)
    prior[3:, 4:] = np.diag(1 / np.array(_LENS))
    return prior


def coverage_picture(intrinsics: Intrinsics, views: Sequence[BoardView]) -> NDArray[np.uint8]:
    """Where the corners of all views were: (h, w, 3) uint8, dots on white."""
    width, height = intrinsics.camera.width, intrinsics.camera.height
    scale = min(1.0, 1200 / max(width, height))
    picture = np.full((round(scale * height), round(scale * width), 3), 255, np.uint8)
    known = dict(zip(intrinsics.views, intrinsics.view_rms_px, strict=True))
    worst = max(float(np.max(intrinsics.view_rms_px)), 1e-9)
    for view in views:
        share = known.get(view.name, worst) / worst
        colour = (60, int(200 * (1 - share)), int(255 * share))
        for u, v in np.rint(view.uv * scale).astype(int):
            cv2.circle(picture, (int(u), int(v)), 3, colour, -1, cv2.LINE_AA)
    return picture
