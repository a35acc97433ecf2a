"""Other ways from contours to a closed surface: the exact visual hull, and two carvings."""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.scene import coverage

Array = NDArray[np.float64]

_SLICES = 40  # of a cone along the view: long slivers make the intersections slow
_FINER = 4  # pixels of a distance image in one of the camera's
_FAR = 1e6


def exact_hull(contours: Sequence[Contours], low: Array, high: Array) -> trimesh.Trimesh:
    """The intersection of the cones over all outlines, whose corners are all kept.

    Args:
        contours: of all views; holes are cut out of their cones.
        low, high: (3,) a box about the object, metres.
    """
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    hull = manifold3d.Manifold.batch_boolean(
        [_cone(c, middle, radius) for c in contours], manifold3d.OpType.Intersect
    )
    found = hull.to_mesh64()
    vertices, faces = np.asarray(found.vert_properties)[:, :3], np.asarray(found.tri_verts)
    return trimesh.Trimesh(vertices, faces.astype(np.int64), process=False)


def _cone(contours: Contours, middle: Array, radius: float) -> manifold3d.Manifold:
    z = middle - contours.centre
    distance = float(np.linalg.norm(z))
    z = z / distance
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z])
    local = contours.T @ axes.T
    near, far = distance - radius, distance + radius
    outline = local[:, :2] / local[:, 2:] * near
    loops = [outline[a:b] for a, b in pairwise(contours.loop_starts)]
    section = manifold3d.CrossSection(loops, manifold3d.FillRule.EvenOdd)
    cone = section.extrude(far - near, _SLICES, scale_top=(far / near, far / near))
    return cone.transform(np.column_stack([axes.T, contours.centre + near * z]))


def sdf_carving(
    contours: Sequence[Contours], cameras: Sequence[Camera], low: Array, cell: float, cells: int
) -> trimesh.Trimesh:
    """The largest of the signed distances to all outlines, on a grid, by marching cubes.

    Args:
        contours, cameras: of all views, without lens distortion.
        low: (3,) corner of the cube of cells, metres.
        cell: metres.
        cells: along each side.
    """
    along = np.arange(cells + 1) * cell
    field = np.empty((cells + 1,) * 3, np.float32)
    images = [_distances(c, k) for c, k in zip(contours, cameras, strict=True)]
    y, z = np.meshgrid(along + low[1], along + low[2], indexing="ij")
    for i, x in enumerate(along + low[0]):
        xyz = np.stack([np.full_like(y, x), y, z])
        worst = np.full(y.shape, -_FAR, np.float32)
        for (image, corner), camera in zip(images, cameras, strict=True):
            P = camera.K @ np.column_stack([camera.R_camera_object, camera.t_camera_object])
            u, v, w = np.tensordot(P[:, :3], xyz, 1) + P[:, 3, None, None]
            at = (np.stack([u, v]) / w - corner[:, None, None] + 0.5) * _FINER - 0.5
            value = cv2.remap(
                image, *at.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            np.maximum(worst, value * (w / camera.K[0, 0]).astype(np.float32), out=worst)
        field[i] = worst
    return _surface(field, low, cell)


def _distances(contours: Contours, camera: Camera) -> tuple[NDArray[np.float32], Array]:
    """Signed distances to the outline, px of the camera, and its first pixel (2,)."""
    corner = np.floor(contours.uv.min(axis=0)) - 8
    shape = np.ceil(contours.uv.max(axis=0) - corner).astype(int)[::-1] + 9
    uv = (contours.uv - corner + 0.5) * _FINER - 0.5
    filled = _filled(tuple(shape * _FINER), uv, contours)
    into = cv2.distanceTransform(filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    out = cv2.distanceTransform(1 - filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return (np.where(filled > 0, 0.5 - into, out - 0.5) / _FINER).astype(np.float32), corner


def open3d_carving(
    contours: Sequence[Contours], cameras: Sequence[Camera], low: Array, cell: float, cells: int
) -> trimesh.Trimesh:
    """Open3D's VoxelGrid.carve_silhouette, then marching cubes between its voxels.

    Args: as ``sdf_carving``.

    Raises:
        ImportError: Open3D is not installed.
    """
    import open3d

    side = cell * cells
    grid = open3d.geometry.VoxelGrid.create_dense(low, [0, 0, 0], cell, side, side, side)
    view = open3d.camera.PinholeCameraParameters()
    for contour, camera in zip(contours, cameras, strict=True):
        mask = _filled((camera.height, camera.width), contour.uv, contour)
        view.intrinsic = open3d.camera.PinholeCameraIntrinsic(camera.width, camera.height, camera.K)
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = camera.R_camera_object, camera.t_camera_object
        view.extrinsic = extrinsic
        grid.carve_silhouette(open3d.geometry.Image(mask.astype(np.float32)), view)
    field = np.full((cells + 2,) * 3, 0.5, np.float32)
    kept = np.array([voxel.grid_index for voxel in grid.get_voxels()]) + 1
    field[tuple(kept[(kept <= cells).all(axis=1)].T)] = -0.5
    return _surface(field, low - 0.5 * cell, cell)


def _filled(shape: tuple[int, ...], uv: Array, contours: Contours) -> NDArray[np.uint8]:
    """(h, w) 1 where more than half of a pixel lies inside."""
    loops = [uv[a:b] for a, b in pairwise(contours.loop_starts)]
    return (coverage(loops, shape[1], shape[0]) > 0.5).astype(np.uint8)


def _surface(field: NDArray[np.float32], low: Array, cell: float) -> trimesh.Trimesh:
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    return trimesh.Trimesh(low + vertices.astype(np.float64) * cell, faces, process=False)
