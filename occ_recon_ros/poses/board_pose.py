"""The pose of a camera from the corners of a board: IPPE, then Levenberg-Marquardt.

Toby Collins and Adrien Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 109(3), 2014,
doi:10.1007/s11263-014-0725-5, gives the two poses that a plane may be seen from; both are
refined on the corners in the image as received.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import ORIGIN, CameraPose

from .projection import moved, pixel_jacobian

_ITERATIONS = 20
_STEP_TOLERANCE = 1e-6
_HUBER = 3.0  # sigmas; 99 % efficient for normal errors
_CUT = 8.0  # sigmas: a corner farther off is wrong; paper that is not quite flat makes some of 5
_TRUSTED = 0.9  # share of the corners that say how large errors are
_LEAST_SIGMA_PX = 0.005  # no corner is known better
_PRIOR_SIGMA_PX, _PRIOR_COUNT = 0.1, 2.0  # what few corners are judged by
_RANSAC_SIGMAS = 3.0
_RANSAC_PX = 3.0
_CLEAR = float(chdtri(1, 1e-4))  # chi-square: by how much the better of two poses must fit better
_SAME_DISTANCE = 1e-3  # of the distance to the board: two poses this close are one
FEWEST = 4


@dataclass(frozen=True)
class BoardPose:
    """Where a camera is in the board's frame.

    Attributes:
        pose: of the camera optical frame, metres.
        covariance: (6, 6) float64 of (x, y, z, turn about x, y, z), in the axes of the board's
            frame, metres and radians, as in geometry_msgs/PoseWithCovariance.
        rms_px: root mean square distance of the used corners from where they should be.
        sigma_px: 1 sigma of one coordinate of a corner, from the residuals.
        used: (n,) bool, the corners that fit.
        cost: sum of the squares of the used residuals over sigma_px^2 and of the rejected ones
            cut off; to compare the poses of one image.
    """

    pose: CameraPose
    covariance: Array
    rms_px: float
    sigma_px: float
    used: NDArray[np.bool_]
    cost: float


def candidate_poses(camera: Camera, points: Array, uv: Array) -> list[BoardPose]:
    """The poses from which the corners may be seen, the one that fits best first.

    Args:
        camera: intrinsics; its pose does not matter.
        points: (n, 3) float64, corners in the board frame, metres, z about 0.
        uv: (n, 2) float64, pixels as received (distorted).

    Returns:
        One pose, or two where the corners cannot tell which (chi-square of the difference); none
        where there are fewer than four corners, all in a row, or only ones that contradict
        each other.
    """
    if len(points) < FEWEST:
        return []
    rays = camera.at(ORIGIN).viewing_directions(uv)
    ahead = rays[:, 2] > 0.02
    xy = rays[:, :2] / np.where(ahead, rays[:, 2], 1.0)[:, None]
    fits = _consistent(points[:, :2], xy, _RANSAC_PX / camera.K[0, 0]) & ahead
    if np.count_nonzero(fits) < FEWEST:
        return []
    found = []
    for start in _ippe(points[fits], xy[fits]):
        refined = refine_pose(camera, points, uv, start, fits)
        if refined is not None:
            found.append(refined)
    if not found:
        return []
    # One measure for both: the sigma of the better one.
    least = min(pose.sigma_px for pose in found)
    costs = [_cost(camera, points, uv, pose.pose, least) for pose in found]
    order = np.argsort(costs, kind="stable")
    best = found[order[0]]
    others = [found[k] for k in order[1:] if costs[k] - costs[order[0]] < _CLEAR]
    same = _SAME_DISTANCE * np.linalg.norm(best.pose.centre)
    others = [p for p in others if np.linalg.norm(p.pose.centre - best.pose.centre) > same]
    return [best, *others]


def refine_pose(
    camera: Camera, points: Array, uv: Array, start: CameraPose, fits: NDArray[np.bool_]
) -> BoardPose | None:
    """Levenberg-Marquardt with Huber's weights from a first pose; None when it runs away.

    Args:
        camera, points, uv: as ``candidate_poses``.
        start: the first pose.
        fits: (n,) bool, the corners to begin with; others come back when they fit.
    """
    pose, used, sigma = start, fits.copy(), _RANSAC_PX
    for _ in range(4):
        pose, ok = _least_squares(camera, points[used], uv[used], pose, sigma)
        if not ok:
            return None
        error = np.linalg.norm(uv - camera.at(pose).project(points), axis=1)
        sigma = _sigma(error[used])
        again = np.nan_to_num(error, nan=np.inf) < _CUT * sigma
        if np.count_nonzero(again) < FEWEST:
            return None
        if (again == used).all():
            break
        used = again
    _, J = pixel_jacobian(camera.at(pose), points[used])
    J = J.reshape(-1, 6)
    information = J.T @ J
    scale = np.sqrt(np.diag(information))
    if not (np.isfinite(scale).all() and scale.min() > 0):
        return None
    normal = information / np.outer(scale, scale)
    if np.linalg.cond(normal) > 1e14:
        return None  # corners in a row
    rest = error[used]
    freedom = 2 * len(rest) - 6
    sigma = max(float(np.sqrt(rest @ rest / freedom)), _LEAST_SIGMA_PX)
    # The mean of logarithms: many corners that fit a tenth as far off are that precise.
    sigma *= max(1.0, _PRIOR_SIGMA_PX / sigma) ** (_PRIOR_COUNT / (freedom + _PRIOR_COUNT))
    return BoardPose(
        pose=pose,
        covariance=sigma**2 * np.linalg.inv(normal) / np.outer(scale, scale),
        rms_px=float(np.sqrt(np.mean(rest**2))),
        sigma_px=sigma,
        used=used,
        cost=_cost(camera, points, uv, pose, sigma),
    )


def _least_squares(
    camera: Camera, points: Array, uv: Array, pose: CameraPose, sigma: float
) -> tuple[CameraPose, bool]:
    damping, scale = 1e-3, _HUBER * sigma

    def loss(at: CameraPose) -> float:
        error = np.linalg.norm(uv - camera.at(at).project(points), axis=1)
        if not np.isfinite(error).all():
            return np.inf
        return float(np.where(error < scale, error**2, 2 * scale * error - scale**2).sum())

    now = loss(pose)
    if not np.isfinite(now):
        return pose, False
    for _ in range(_ITERATIONS):
        seen, J = pixel_jacobian(camera.at(pose), points)
        residual = uv - seen
        weight = np.minimum(1.0, scale / np.maximum(np.linalg.norm(residual, axis=1), 1e-12))
        A = np.einsum("n,nij,nik->jk", weight, J, J)
        g = np.einsum("n,nij,ni->j", weight, J, residual)
        while damping < 1e8:
            step = np.linalg.solve(A + damping * np.diag(np.diag(A)) + 1e-30 * np.eye(6), g)
            trial = moved(pose, step)
            then = loss(trial)
            if then <= now:
                break
            damping *= 10
        else:
            return pose, True
        gain, pose, now = now - then, trial, then
        damping = max(damping * 0.1, 1e-9)
        if gain <= _STEP_TOLERANCE * (now + 1e-12):
            break
    return pose, True


def _sigma(error: Array) -> float:
    """1 sigma of a coordinate from distances, unmoved by a tenth of wrong ones."""
    robust = float(np.quantile(error, _TRUSTED)) / np.sqrt(-2 * np.log(1 - _TRUSTED))
    few = _PRIOR_COUNT / max(len(error), 1)
    return max(float(np.hypot(robust, few * _PRIOR_SIGMA_PX)), _LEAST_SIGMA_PX)


def _cost(camera: Camera, points: Array, uv: Array, pose: CameraPose, sigma: float) -> float:
    error = np.linalg.norm(uv - camera.at(pose).project(points), axis=1)
    within = np.minimum(np.nan_to_num(error, nan=np.inf) / sigma, _CUT)
    return float(within @ within)


def _consistent(plane: Array, xy: Array, tolerance: float) -> NDArray[np.bool_]:
    """Which corners one homography explains."""
    if len(plane) == FEWEST:
        return np.ones(FEWEST, bool)
    cv2.setRNGSeed(0)  # the same corners give the same pose
    with np.errstate(all="ignore"):
        _, mask = cv2.findHomography(
            plane, xy, cv2.RANSAC, tolerance * _RANSAC_SIGMAS, maxIters=500, confidence=0.999
        )
    return np.zeros(len(plane), bool) if mask is None else np.asarray(mask, bool).ravel()


def _ippe(points: Array, xy: Array) -> list[CameraPose]:
    """The two poses of a plane; xy are coordinates on the plane at distance 1."""
    points = points * [1, 1, 0]  # a sheet that curls a little is a plane to begin with
    try:
        count, turns, shifts, _ = cv2.solvePnPGeneric(
            points, xy, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:  # all in a row
        return []
    poses = []
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        R = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
        C = -R.T @ np.asarray(shift, np.float64).ravel()
        # Seen from behind, a printed board is not seen at all.
        if np.isfinite(R).all() and np.isfinite(C).all() and C[2] > 0:
            poses.append(CameraPose(R.T, C))
    return poses
