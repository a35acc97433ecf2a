"""Whether a mesh holds more than the object: the plate that it stood on, stands, other objects."""

from collections.abc import Sequence

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera

from .raycast import RayCaster, mean_iou

Mask = NDArray[np.bool_]

_BESIDE = 0.01  # of the longer side of a silhouette, by which a right mesh may lie beyond
_AGREES, _BETTER = 0.9, 3.0  # IoU in the mean, and times less of the silhouettes that is off then


def agreeing_part(mesh: trimesh.Trimesh, seen: Sequence[tuple[Camera, Mask]], iou: float) -> str:
    """That a mesh agrees with silhouettes without what lies beyond them, in words; "" if not.

    Args:
        mesh: metres, object frame.
        seen: by which camera, and what of the object: (h, w), True inside.
        iou: of all of the mesh with the silhouettes, in the mean.
    """
    seen = [(camera, mask) for camera, mask in seen if mask.any()]
    within = np.ones(len(mesh.vertices), bool)
    for camera, mask in seen:
        within &= _within(camera.project(np.asarray(mesh.vertices)), mask)
    kept = within[mesh.faces].all(axis=1)
    if not seen or not kept.any():
        return ""
    caster = RayCaster(mesh.triangles[kept])
    exact = mean_iou([(caster.silhouette(camera), mask) for camera, mask in seen])
    if exact < _AGREES or (1 - exact) * _BETTER >= 1 - iou:
        return ""
    corners = mesh.triangles[kept].reshape(-1, 3)
    low, high = (
        ", ".join(f"{x:.3g}" for x in end) for end in (corners.min(axis=0), corners.max(axis=0))
    )
    rest = float(mesh.area_faces[~kept].sum() / mesh.area)
    return (
        f"it holds more than the object: what of it lies within all silhouettes, from ({low}) to "
        f"({high}) m, agrees (IoU {exact:.2f} in the mean); the rest, {rest:.0%} of its surface, "
        "is a plate, a stand or something else beside it: delete that"
    )


def _within(uv: NDArray[np.float64], mask: Mask) -> Mask:
    """(n,) whether image points (n, 2) are inside a silhouette or right beside it."""
    far = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    near = far <= max(1.0, _BESIDE * max(cv2.boundingRect(mask.astype(np.uint8))[2:]))
    u, v = np.rint(np.nan_to_num(np.clip(uv, -1, 1e6), nan=-1)).astype(np.intp).T
    there = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    there[there] = near[v[there], u[there]]
    return there
