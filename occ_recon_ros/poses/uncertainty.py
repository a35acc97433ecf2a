"""What an uncertain pose does to the contours that are seen from it."""

from dataclasses import replace

import numpy as np

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array


def with_pose_sigma(contours: Contours, covariance: Array) -> Contours:
    """Contours whose sigma holds the uncertainty of the camera's pose too.

    A pose that is off by dC and a small turn dw moves a sample across its contour, as seen from
    the camera, by N.dC / depth + N.(dw x T) radians; with g = (N / depth, T x N) the variance is
    g' S g for the covariance S, and is added to that of the edge. The depth, which no single
    view tells, is taken where the ray passes nearest to the object frame's origin. The error is
    common to all samples of a view: each sigma is right, but they do not average out along a
    contour.

    Args:
        contours: n samples of one view.
        covariance: (6, 6) float64 of (x, y, z, turns about x, y, z), in the axes of the object
            frame, metres and radians, as in geometry_msgs/PoseWithCovariance.
    """
    C, T, N = contours.centre, contours.T, contours.N
    distance = float(np.linalg.norm(C))
    depth = np.maximum(-T @ C, 0.1 * distance)
    lever = N / np.maximum(depth, 1e-9)[:, None]
    g = np.concatenate([lever, np.cross(T, N)], axis=1)
    variance = np.einsum("ni,ij,nj->n", g, covariance, g)
    return replace(contours, sigma=np.sqrt(contours.sigma**2 + np.maximum(variance, 0.0)))
