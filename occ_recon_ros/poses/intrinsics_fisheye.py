"""Intrinsics of a lens that images by angle (fisheye) from views of a board.

J. Kannala and S. S. Brandt, "A generic camera model and calibration method for conventional,
wide-angle, and fish-eye lenses", PAMI 28(8), 2006, doi:10.1109/TPAMI.2006.153; the model is
OpenCV's fisheye, ROS's equidistant. All views together, each view's pose eliminated, by the steps
of Levenberg and Marquardt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from occ_recon_ros.geometry.arrays import Array

from .intrinsics_plumb_bob import beside_pose, parameter_sigmas, straight_ahead

_FOCALS = (0.25, 0.35, 0.5, 0.75)  # of the image's longer side, to begin with
_BEGUN = 2  # of these that are followed to the end
_STEPS, _LITTLE = 40, 1e-7  # at most; gain of a step, of what is left, at which it ends
_DAMPING, _MOST_DAMPING = 1e-3, 1e8
_POSE = slice(8, 14)  # columns of OpenCV's derivatives; before them fx fy cx cy k1 k2 k3 k4


@dataclass(frozen=True)
class FisheyeFit:
    """One minimum, with 2 coefficients of the lens or 4.

    Attributes:
        K: (3, 3) float64.
        D: (4,) float64, k1 to k4.
        count: coefficients that are free, the first ones.
        poses: n of (6,) float64, turn as a rotation vector and shift of each view.
        points, uv: n of (k, 3) metres and (k, 2) px, the corners.
        distances: n of (k,) px, how far corners are from where they should be.
    """

    K: Array
    D: Array
    count: int
    poses: list[Array]
    points: list[Array]
    uv: list[Array]
    distances: list[Array]

    @classmethod
    def of(
        cls,
        points: list[Array],
        uv: list[Array],
        size: tuple[int, int],
        focal_px: float,
        count: int,
    ) -> FisheyeFit:
        """The best of the minima from several focal lengths.

        Args:
            points, uv: as the attributes.
            size: width and height of the images, px.
            focal_px: one of the focal lengths to begin with.
            count: coefficients of the lens that are free.

        Raises:
            ValueError: the views fit no such lens.
        """
        focals = [focal_px, *(share * max(size) for share in _FOCALS)]
        begun = [cls._begun(points, uv, size, focal, count) for focal in focals]
        there = sorted((fit for fit in begun if fit is not None), key=lambda fit: fit.squares)
        ends = [fit.settled() for fit in there[:_BEGUN]]
        if not ends:
            raise ValueError("the views fit no fisheye lens")
        return min(ends, key=lambda fit: fit.squares)

    @classmethod
    def _begun(
        cls, points: list[Array], uv: list[Array], size: tuple[int, int], focal: float, count: int
    ) -> FisheyeFit | None:
        K = straight_ahead(focal, size)
        poses = []
        for p, w in zip(points, uv, strict=True):
            xy = cv2.fisheye.undistortPoints(w[None], K, np.zeros(4))
            try:
                found, turn, shift = cv2.solvePnP(p, np.asarray(xy), np.eye(3), None)
            except cv2.error:
                return None
            if not found or not shift[2, 0] > 0:
                return None
            poses.append(np.concatenate([turn.ravel(), shift.ravel()]))
        return cls(K, np.zeros(4), count, poses, points, uv, [])._moved(np.zeros(8), None)

    def _moved(self, own: Array, by_pose: list[Array] | None) -> FisheyeFit:
        """With changes of fx fy cx cy k1 k2 k3 k4 (8,), and of each pose (6,)."""
        K, D = self.K.copy(), self.D + own[4:]
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += own[:4]
        moves = by_pose or [np.zeros(6)] * len(self.poses)
        poses = [pose + move for pose, move in zip(self.poses, moves, strict=True)]
        fit = replace(self, K=K, D=D, poses=poses)
        shown = [fit._seen(k)[0] for k in range(len(poses))]
        distances = [np.hypot(*(there - w).T) for there, w in zip(shown, self.uv, strict=True)]
        return replace(fit, distances=distances)

    def _seen(self, k: int) -> tuple[Array, Array]:
        """Where the corners of a view should be, (n, 2) px, and the derivatives, (2n, 15)."""
        turn, shift = np.split(self.poses[k], 2)
        found = cv2.fisheye.projectPoints(self.points[k][None], turn, shift, self.K, self.D)
        uv, J = (np.asarray(array, np.float64) for array in found)
        return uv.reshape(-1, 2), J

    def settled(self) -> FisheyeFit:
        """The minimum that it leads to."""
        fit, damping, free = self, _DAMPING, 4 + self.count
        for _ in range(_STEPS):
            A, b = np.zeros((free, free)), np.zeros(free)
            views = []
            for k, uv in enumerate(fit.uv):
                shown, J = fit._seen(k)
                rest, pose, own = (uv - shown).ravel(), J[:, _POSE], J[:, :free]
                H = pose.T @ pose
                W, g = pose.T @ own, pose.T @ rest
                views.append((H, W, g))
                A, b = A + own.T @ own, b + own.T @ rest
            while damping < _MOST_DAMPING:
                new = fit._stepped(A, b, views, damping)
                if new.squares < fit.squares:
                    break
                damping *= 10
            else:
                break
            gain, fit, damping = fit.squares - new.squares, new, max(damping / 10, 1e-9)
            if gain < _LITTLE * fit.squares:
                break
        return fit

    def _stepped(
        self, A: Array, b: Array, views: list[tuple[Array, Array, Array]], damping: float
    ) -> FisheyeFit:
        A, b = A + damping * np.diag(np.diag(A)), b.copy()
        solved: list[tuple[Array, Array]] = []
        for H, W, g in views:
            damped = H + damping * np.diag(np.diag(H)) + 1e-12 * np.eye(6)
            both = np.asarray(np.linalg.solve(damped, np.column_stack([W, g])), np.float64)
            by_own, alone = both[:, :-1], both[:, -1]
            A, b = A - W.T @ by_own, b - W.T @ alone
            solved.append((by_own, alone))
        move = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], np.float64)
        own = np.concatenate([move, np.zeros(8 - len(move))])
        return self._moved(own, [alone - by_own @ move for by_own, alone in solved])

    @property
    def squares(self) -> float:
        """Of all distances, px^2; infinite where a corner is behind the camera."""
        total = float(sum(rest @ rest for rest in self.distances))
        return total if np.isfinite(total) and self.K[0, 0] > 0 and self.K[1, 1] > 0 else np.inf

    @property
    def variance(self) -> float:
        """Of one coordinate of a corner, px^2."""
        freedom = 2 * sum(map(len, self.uv)) - 4 - self.count - 6 * len(self.uv)
        return self.squares / max(freedom, 1)

    def sigma(self) -> Array:
        """(9,) 1 sigma of fx, fy, cx, cy, k1, k2, k3, k4, and 0; each pose is eliminated first."""
        free = 4 + self.count
        information = np.zeros((free, free))
        for k in range(len(self.uv)):
            J = self._seen(k)[1]
            left = beside_pose(J[:, :free], J[:, _POSE])
            information += left.T @ left
        return parameter_sigmas(information, self.variance)
