"""How far the result is from the true surface of the virtual turntable."""

from collections.abc import Mapping

import numpy as np

from occ_recon_ros.geometry import Contours, Rim, Status
from occ_recon_ros.scene import SceneObject

from .figures import Report, statistics


def compare_with_truth(
    rims: Mapping[int, Rim], contours_by_stamp: Mapping[int, Contours], scene_object: SceneObject
) -> Report:
    """Distances of the status-0 rim points to the true surface, and their depth errors.

    The measuring tool is tried first: points of the true surface must be at distance zero.

    Args:
        rims: by stamp.
        contours_by_stamp: those that the rims were made of.
        scene_object: knows its true surface.
    """
    distances, depth_errors, curvature_errors, sigmas = [], [], [], []
    for stamp, rim in rims.items():
        contours = contours_by_stamp.get(stamp)
        good = rim.status == Status.GOOD
        distances.append(np.abs(scene_object.distance(rim.points[good])))
        if contours is None:
            continue
        depth, k_t = scene_object.exact_depth(contours)
        found = ((rim.points - contours.centre) * contours.T).sum(axis=1)
        depth_errors.append((found - depth)[good])
        curvature_errors.append((rim.curvature / k_t - 1)[good])
        sigmas.append(rim.depth_sigma[good])
    vertices = np.asarray(scene_object.mesh().vertices)
    depth_error = _joined(depth_errors)
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = depth_error / _joined(sigmas)
    return {
        "distance": statistics(1e3 * _joined(distances), "mm"),
        "depth_error": statistics(1e3 * np.abs(depth_error), "mm"),
        "relative_curvature_error": statistics(np.abs(_joined(curvature_errors)), "1"),
        "depth_error_over_sigma_std": float(np.nanstd(normalised)) if len(normalised) else None,
        "tool_check_mm": float(1e3 * np.abs(scene_object.distance(vertices)).max()),
    }


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *parts])
