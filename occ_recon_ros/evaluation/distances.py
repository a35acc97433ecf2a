"""How far two surfaces are from each other."""

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.scene.closest import closest_on_triangles

from .figures import Report

_SAMPLES = 30_000
_TARGET_SAMPLES = 100_000
_NEAREST = 8
_SHARE = 0.9  # of the mesh, for the accuracy


def compare_surfaces(
    mesh: trimesh.Trimesh, truth: trimesh.Trimesh, within_m: float, samples: int = _SAMPLES
) -> Report:
    """Accuracy and completeness as the Middlebury benchmark defines them, and more.

    Accuracy is the distance d such that 90 % of the mesh is within d of the truth;
    completeness is the share of the truth that lies within a given distance of the mesh.
    Both surfaces are sampled evenly by area.

    Seitz et al., CVPR 2006, DOI 10.1109/CVPR.2006.19, section 4.

    Args:
        mesh: metres, in the frame of the truth.
        truth: metres.
        within_m: distance of the completeness.
        samples: points on each surface.

    Returns:
        Figures in millimetres (volumes in m^3) by name.
    """
    to_truth = distances(sampled(mesh, samples), truth)
    to_mesh = distances(sampled(truth, samples), mesh)
    return {
        "accuracy_mm": 1e3 * float(np.quantile(to_truth, _SHARE)),
        "accuracy_share": _SHARE,
        "completeness": float((to_mesh <= within_m).mean()),
        "completeness_within_mm": 1e3 * within_m,
        "mesh_to_truth": _statistics(to_truth),
        "truth_to_mesh": _statistics(to_mesh),
        "volume_m3": _volume(mesh),
        "truth_volume_m3": _volume(truth),
    }


def sampled(mesh: trimesh.Trimesh, count: int) -> Array:
    """(count, 3) points evenly on a mesh, the same at each call."""
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=0)
    return np.asarray(points, np.float64)


def distances(points: Array, mesh: trimesh.Trimesh) -> Array:
    """(n,) distances of points (n, 3) to a mesh, in its unit.

    The triangles about the nearest samples of the mesh are tried, each of them exactly, so
    that a distance is never too small and a point of the mesh is at zero.
    """
    triangles = np.asarray(mesh.triangles, np.float64)
    spread, rows = trimesh.sample.sample_surface(mesh, _TARGET_SAMPLES, seed=1)
    best = np.full(len(points), np.inf)
    # Small triangles are found by their middles, large ones by what is spread over them.
    for places, owner in (
        (triangles.mean(axis=1), np.arange(len(triangles))),
        (np.asarray(spread), rows),
    ):
        _, near = cKDTree(places).query(points, min(_NEAREST, len(owner)))
        for column in near.reshape(len(points), -1).T:
            candidates = triangles[owner[column]]
            weights = closest_on_triangles(points, candidates)
            away = points - np.einsum("ni,nij->nj", weights, candidates)
            best = np.minimum(best, np.linalg.norm(away, axis=1))
    return best


def _statistics(distance_m: Array) -> Report:
    percentiles = {f"p{q}_mm": 1e3 * float(np.percentile(distance_m, q)) for q in (50, 90, 95, 99)}
    return {
        "mean_mm": 1e3 * float(distance_m.mean()),
        "rms_mm": 1e3 * float(np.sqrt((distance_m**2).mean())),
        **percentiles,
        "max_mm": 1e3 * float(distance_m.max()),
    }


def _volume(mesh: trimesh.Trimesh) -> float | None:
    return float(mesh.volume) if mesh.is_watertight else None
