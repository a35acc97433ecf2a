"""In which other frame a mesh agrees with silhouettes that it is far off.

Programs that show and mend meshes have other axes upwards, count in millimetres, mirror what they
read, or move it to their origin.
"""

from collections.abc import Sequence
from itertools import permutations, product

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.imaging.joint.space import fixation, usual_distance

from .raycast import RayCaster

Mask = NDArray[np.bool_]
_Way = tuple[Array, Array, float]
"""A (3, 3), t (3,) m: a point of the mesh is A x + t in the object frame; and the IoU it has so"""

_UNITS = {1.0: "", 1e-3: "mm", 1e-2: "cm", 1e3: "1000 m (were the poses in mm?)"}
_AS_LARGE = 3.2  # times the object by the views, or one so many-th of it: half of ten, in powers
_POINTS, _CELLS = 20_000, 40  # of the mesh; along the longer side of a silhouette
_ALIKE, _NEARLY = 0.01, 0.1  # IoU by which axes may fit less than the best; before they are moved
_TRIED, _STEPS = 4, 4  # of the axes, moved so that the mesh lies in its silhouettes, and by steps
_AGREES = 0.9  # IoU in the mean
_BETTER = 3.0  # times less of the silhouettes is off then
_AXES = "xyz"


def in_another_frame(mesh: trimesh.Trimesh, seen: Sequence[tuple[Camera, Mask]], iou: float) -> str:
    """How to read a mesh so that it agrees with silhouettes, in words: with its axes exchanged or
    turned round, in another unit, moved; "" where that is of little help.

    Args:
        mesh: metres, object frame, as it is given.
        seen: by which camera, and what of the object: (h, w), True inside.
        iou: of the mesh with the silhouettes as it is given, in the mean.
    """
    some = [_small(camera, mask) for camera, mask in seen if mask.any()]
    if not some:
        return ""
    points = np.asarray(trimesh.sample.sample_surface(mesh, _POINTS, seed=0)[0])
    size, middle = _object(some)
    units = [
        unit
        for unit in _UNITS
        if 1 / _AS_LARGE < unit * float(mesh.extents.max()) / size < _AS_LARGE
    ]
    found = []
    for A in [unit * axes for axes in _axes() for unit in units]:
        found.append((A, np.zeros(3), _agreement(points @ A.T, some)))
    for moved in (False, True):
        ways = _in_place(points, found, middle, some) if moved else _likely(found, _ALIKE)
        for A, t, _ in ways[:1]:
            exact = _exact(mesh.triangles @ A.T + t, seen)
            if exact >= _AGREES and (1 - exact) * _BETTER < 1 - iou:
                return f"it agrees (IoU {exact:.2f} in the mean) if {_words(A, t)}"
    return ""


def _likely(ways: Sequence[_Way], alike: float) -> list[_Way]:
    """Those that agree but for so much as the best of them, in their order."""
    best = max((way[2] for way in ways), default=0.0)
    return [way for way in ways if way[2] > best - alike]


def _axes() -> list[Array]:
    """Signed permutations (3, 3): those that turn first, the more axes stay the earlier."""
    found = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return sorted(found, key=lambda A: (np.linalg.det(A) < 0, -np.trace(A)))


def _small(camera: Camera, mask: Mask) -> tuple[Camera, Mask]:
    """A view of which a silhouette is so many cells long."""
    scale = min(1.0, _CELLS / max(cv2.boundingRect(mask.astype(np.uint8))[2:]))
    small = camera.resized(*(max(1, round(scale * side)) for side in mask.shape[::-1]))
    how = cv2.INTER_AREA
    inside = cv2.resize(255 * mask.astype(np.uint8), (small.width, small.height), interpolation=how)
    return small, inside > 0


def _object(views: Sequence[tuple[Camera, Mask]]) -> tuple[float, Array]:
    """How large an object is by its silhouettes, m, and (3,) about where its middle is."""
    cameras = [camera for camera, _ in views]
    away = usual_distance(cameras)
    sides = [max(cv2.boundingRect(mask.astype(np.uint8))[2:]) / c.K[0, 0] for c, mask in views]
    middle = fixation(cameras)
    for _ in range(_STEPS):
        middle = middle + _step(middle[None], views)
    return away * max(sides), middle


def _drawn(points: Array, camera: Camera) -> Mask:
    """(h, w) the cells that points (n, 3) are seen in."""
    uv = camera.project(points)
    u, v = np.rint(np.nan_to_num(np.clip(uv, -1, 1e6), nan=-1)).astype(np.intp).T
    there = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    drawn = np.zeros((camera.height, camera.width), bool)
    drawn[v[there], u[there]] = True
    return drawn


def _agreement(points: Array, views: Sequence[tuple[Camera, Mask]]) -> float:
    """IoU of points with small silhouettes in the mean."""
    drawn = [(_drawn(points, camera), mask) for camera, mask in views]
    return float(np.mean([(d & mask).sum() / (d | mask).sum() for d, mask in drawn]))


def _step(points: Array, views: Sequence[tuple[Camera, Mask]]) -> Array:
    """(3,) by which to move points (n, 3), so that the boxes about their images have the middles
    that those about the silhouettes have (least squares)."""
    rows, off = list[Array](), list[Array]()
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for camera, mask in views:
        uv = camera.project(points)
        x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
        wanted = np.array([x + 0.5 * (width - 1), y + 0.5 * (height - 1)])
        off.append(wanted - 0.5 * (uv.min(axis=0) + uv.max(axis=0)))
        X = camera.in_camera(middle)
        J = np.array([[1, 0, -X[0] / X[2]], [0, 1, -X[1] / X[2]]]) / X[2]
        rows.append(camera.K[:2, :2] @ J @ camera.R_camera_object)
    A, b = np.concatenate(rows), np.concatenate(off)
    if not np.isfinite(b).all():  # some of them are behind a camera
        return np.zeros(3)
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])


def _in_place(
    points: Array, ways: Sequence[_Way], middle: Array, views: Sequence[tuple[Camera, Mask]]
) -> list[_Way]:
    """Ways to read points (n, 3), the best first, each with the place where they lie in the
    silhouettes of an object, about the middle (3,) of this."""
    put = list[_Way]()
    for A, _, _ in ways:
        turned = points @ A.T
        t = middle - 0.5 * (turned.min(axis=0) + turned.max(axis=0))
        put.append((A, t, _agreement(turned + t, views)))
    found = list[_Way]()
    for A, t, _ in _likely(put, _NEARLY)[:_TRIED]:
        turned = points @ A.T
        for _ in range(_STEPS):
            t = t + _step(turned + t, views)
        found.append((A, t, _agreement(turned + t, views)))
    return sorted(found, key=lambda way: -way[2])


def _exact(triangles: NDArray, seen: Sequence[tuple[Camera, Mask]]) -> float:
    """IoU of triangles (m, 3, 3) with silhouettes in the mean."""
    caster = RayCaster(triangles)
    drawn = [(caster.silhouette(camera), mask) for camera, mask in seen if mask.any()]
    return float(np.mean([(d & mask).sum() / (d | mask).sum() for d, mask in drawn]))


def _words(A: Array, t: Array) -> str:
    """How to read a mesh, A of whose coordinates, and t beside, are those of the object frame."""
    unit = float(np.abs(A).max())
    found = list[str]()
    if not np.array_equal(np.sign(A), np.eye(3)):
        rows = np.abs(A).argmax(axis=0)
        named = [f"{'-' if A[i, k] < 0 else ''}{_AXES[i]}" for k, i in enumerate(rows)]
        mirrored = ", which mirrors it" if np.linalg.det(A) < 0 else ""
        found.append(f"its axes x, y, z are {', '.join(named)} of the poses{mirrored}")
    if name := _UNITS[unit]:
        found.append(f"its unit is {name}")
    if t.any():
        found.append(f"it is moved by ({', '.join(f'{x:.4g}' for x in t)}) m then")
    return ", and ".join(found)
