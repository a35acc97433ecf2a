"""In which other frame a mesh agrees with silhouettes that it is far off.

Programs that show and mend meshes have other axes upwards, count in millimetres or inches, mirror
what they read, or move it to their origin. What is sought is the similarity that lays the mesh into
its silhouettes: from each exchange of axes, by the boxes about them; of the best, by the outlines
themselves (Gauss-Newton on their signed distances).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations, product

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array, evenly
from occ_recon_ros.imaging.joint.space import fixation, usual_distance

from .raycast import RayCaster, mean_iou

Mask = NDArray[np.bool_]
_View = tuple[Camera, Mask]
_Way = tuple[Array, Array]
"""A (3, 3), t (3,) m: a point x of the mesh is A x + t in the object frame"""

_UNITS = {1e-3: "mm", 1e-2: "cm", 0.0254: "inch", 0.3048: "foot", 1e3: "1000 m"}
_POINTS, _COMPARED = 5_000, 20_000  # of the mesh, by which axes are compared; sought for corners
_TURNS_DEG = (0.0, 30.0, 60.0)  # from each of the axes: outlines are laid from half of a step
_COARSE, _FINE = 40, 160  # px along the longer side of a silhouette: axes compared, outlines laid
_LOST = 0.8  # of a silhouette is left in its small copy: with less, that is too small for it
_BOX_STEPS, _STEPS = 5, 12  # at the most, until boxes, and outlines, stay where they are
_GAIN = 5e-4  # IoU of a step, below which they do
_USUAL_PX, _FAR = 0.5, 2.0  # by which outlines are off at the least; times that weighs less
_MOST_TURNED = 0.3  # rad in one step, for which turning is about linear
_ILL = 0.03  # of what changes outlines most: less is not known, as turns of what is round
_NEARLY, _TRIED = 0.05, 4  # IoU by which axes may fit less than the best, before outlines are laid
_ALIKE = 0.01  # IoU that a simpler way to read the mesh may have less
_ABOUT = 0.05  # by which axes are turned or a unit is off that is meant
_AGREES = 0.9  # IoU in the mean
_BETTER = 3.0  # times less of the silhouettes is off then
_AXES, _DIGITS = "xyz", 4


def in_another_frame(mesh: trimesh.Trimesh, seen: Sequence[_View], iou: float) -> str:
    """How to read a mesh so that it agrees with silhouettes, in words: with its axes exchanged or
    turned, in another unit, moved; "" where that is of little help.

    Args:
        mesh: metres, object frame, as it is given.
        seen: by which camera, and what of the object: (h, w), True inside.
        iou: of the mesh with the silhouettes as it is given, in the mean.
    """
    seen = [(camera, mask) for camera, mask in seen if mask.any()]
    cameras = [camera for camera, _ in seen]
    if len(seen) < 2 or not usual_distance(cameras) > 0 or not mesh.area > 0:
        return ""
    body = _Body(mesh)
    coarse, fine = ([_resized(*view, side) for view in seen] for side in (_COARSE, _FINE))
    points = np.asarray(trimesh.sample.sample_surface(mesh, _POINTS, seed=0)[0])
    corners = _corners(np.asarray(mesh.vertices))
    ways = [_in_boxes(axes, corners, coarse) for axes in _axes(cameras)]
    fits = np.array([_agreement(points @ A.T + t, coarse) for A, t in ways])
    near = np.flatnonzero(fits > fits.max() - _NEARLY)
    tried = sorted({int(near[0]), *near[np.argsort(-fits[near])[:_TRIED]].tolist()})
    laid = [_laid(body, ways[k], fine) for k in tried]
    best = max(fit for fit, _ in laid)
    way = next(way for fit, way in laid if fit > best - _ALIKE)
    ways = _simpler(*way, corners.mean(axis=0))
    A, t = next((way for way in ways if body.iou(*way, fine) > best - _ALIKE), way)
    exact = body.iou(A, t, seen)
    if exact < _AGREES or (1 - exact) * _BETTER >= 1 - iou:
        return ""
    return f"it agrees (IoU {exact:.2f} in the mean) if {_words(A, t)}"


def _corners(points: Array) -> Array:
    """(k, 3) those of points (n, 3) that lie farthest out in some direction."""
    some = points[evenly(len(points), min(len(points), _COMPARED))]
    out = trimesh.creation.icosphere(subdivisions=3).vertices
    return some[np.unique((some @ np.asarray(out).T).argmax(axis=0))]


class _Body:
    """A mesh that is seen however it is read, by moving the cameras instead.

    Args:
        mesh: as it is given.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._middle = np.asarray(mesh.bounds.mean(axis=0))
        self._triangles = np.asarray(mesh.triangles - self._middle)
        self._casters: dict[float, RayCaster] = {}

    def seen(self, camera: Camera, A: Array, t: Array) -> tuple[Mask, Array]:
        """Silhouette (h, w), and (h, w, 3) points in the object frame, metres; NaN beside it."""
        scale, hand = float(np.cbrt(abs(np.linalg.det(A)))), float(np.sign(np.linalg.det(A)))
        flip = np.array([1.0, 1.0, hand])
        if hand not in self._casters:
            self._casters[hand] = RayCaster(self._triangles * flip)
        place, R = A @ self._middle + t, A * flip / scale
        own = replace(
            camera,
            R_camera_object=camera.R_camera_object @ R,
            t_camera_object=camera.in_camera(place) / scale,
        )
        drawn, points = self._casters[hand].seen(own)
        return drawn, scale * points @ R.T + place

    def iou(self, A: Array, t: Array, views: Sequence[_View]) -> float:
        """With silhouettes, in the mean."""
        return mean_iou([(self.seen(camera, A, t)[0], mask) for camera, mask in views])


def _axes(cameras: Sequence[Camera]) -> list[Array]:
    """Signed permutations (3, 3), those that turn first, the more axes stay the earlier; and these
    turned about the axis that the cameras stand around."""
    found = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    found = sorted(found, key=lambda A: (np.linalg.det(A) < 0, -np.trace(A)))
    centres = np.array([camera.centre for camera in cameras])
    axis = np.linalg.svd(centres - centres.mean(axis=0))[2][-1]
    turns = [Rotation.from_rotvec(angle * axis).as_matrix() for angle in np.deg2rad(_TURNS_DEG)]
    return [turn @ A for turn in turns for A in found]


def _resized(camera: Camera, mask: Mask, side: int) -> _View:
    """A view of which a silhouette is so many px long, or as many as it has; longer, where it is
    so thin that it would be lost."""
    scale = min(1.0, side / max(cv2.boundingRect(mask.astype(np.uint8))[2:]))
    whole = 255 * mask.astype(np.uint8)
    while True:
        small = camera.resized(*(max(1, round(scale * side)) for side in mask.shape[::-1]))
        size = small.width, small.height
        inside = cv2.resize(whole, size, interpolation=cv2.INTER_AREA) > 127
        if scale == 1 or inside.mean() > _LOST * mask.mean():
            return small, inside
        scale = min(1.0, 2 * scale)


def _agreement(points: Array, views: Sequence[_View]) -> float:
    """IoU of points (n, 3) with small silhouettes in the mean."""
    pairs = []
    for camera, mask in views:
        uv = camera.project(points)
        u, v = np.rint(np.nan_to_num(np.clip(uv, -1, 1e6), nan=-1)).astype(np.intp).T
        there = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        drawn = np.zeros_like(mask)
        drawn[v[there], u[there]] = True
        pairs.append((drawn, mask))
    return mean_iou(pairs)


def _in_boxes(axes: Array, corners: Array, views: Sequence[_View]) -> _Way:
    """With these axes, in the size and at the place where the boxes about the images of the
    corners (n, 3) of a mesh are those about the silhouettes."""
    cameras = [camera for camera, _ in views]
    boxes = [cv2.boundingRect(mask.astype(np.uint8)) for _, mask in views]
    sizes = [max(box[2:]) / camera.K[0, 0] for box, camera in zip(boxes, cameras, strict=True)]
    A = axes * usual_distance(cameras) * max(sizes) / np.ptp(corners, axis=0).max()
    t = fixation(cameras) - A @ (0.5 * (corners.min(axis=0) + corners.max(axis=0)))
    for _ in range(_BOX_STEPS):
        found = []
        for camera, (x, y, width, height) in zip(cameras, boxes, strict=True):
            X = corners @ A.T + t
            uv = camera.project(X)
            if not np.isfinite(uv).all():  # some of it is behind a camera
                return A, t
            wanted = np.array([x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5])
            off = np.concatenate([uv.min(axis=0), uv.max(axis=0)]) - wanted
            ends = np.concatenate([uv.argmin(axis=0), uv.argmax(axis=0)])
            found.append((camera, X[ends], np.tile(np.eye(2), (2, 1)), off))
        scale, _, by = _step(found, turned=False)
        A, t = scale * A, scale * t + by
    return A, t


def _step(
    found: Sequence[tuple[Camera, Array, Array, Array]], turned: bool
) -> tuple[float, Array, Array]:
    """A similarity that moves points, so that their images move onto lines (robust least squares).

    Args:
        found: camera, points (n, 3), normals (n, 2) of the lines, and how far the images are off
            along these (n,), px.
        turned: whether they may turn as well.

    Returns:
        Scale s, rotation R (3, 3) and t (3,), so that points X move to s R X + t.
    """
    X = np.concatenate([points for _, points, _, _ in found])
    off = np.concatenate([each for _, _, _, each in found])
    middle = X.mean(axis=0)
    size = float(np.sqrt(((X - middle) ** 2).sum(axis=1).mean()))
    J = np.concatenate([_slopes(camera, points, n) for camera, points, n, _ in found])
    around = X - middle
    columns = [np.einsum("ij,ij->i", J, around), *(size * J).T]
    if turned:
        columns += [*np.cross(around, J).T]
    usual = max(_USUAL_PX, float(np.median(np.abs(off))))
    weight = np.minimum(1, _FAR * usual / np.maximum(np.abs(off), usual))
    rows = np.column_stack(columns)
    x = np.linalg.lstsq(weight[:, None] * rows, -weight * off, rcond=_ILL)[0]
    scale = float(np.exp(np.clip(x[0], -1, 1)))
    w = x[4:] if turned else np.zeros(3)
    w = w * min(1.0, _MOST_TURNED / max(float(np.linalg.norm(w)), _MOST_TURNED))
    R = Rotation.from_rotvec(w).as_matrix()
    return scale, R, middle + size * x[1:4] - scale * R @ middle


def _slopes(camera: Camera, points: Array, normals: Array) -> Array:
    """(n, 3) px/m by which images move along normals (n, 2) when points (n, 3) are moved; the lens
    but for its distortion."""
    X = camera.in_camera(points)
    n = normals @ camera.K[:2, :2]
    along = -(n * X[:, :2]).sum(axis=1) / X[:, 2]
    return (np.column_stack([n, along]) / X[:, 2:]) @ camera.R_camera_object


def _laid(body: _Body, way: _Way, views: Sequence[_View]) -> tuple[float, _Way]:
    """Where the outlines of a mesh, read in about this way, come to lie on those of the
    silhouettes: the IoU there, and the way."""
    fields = [_signed_distance(mask) for _, mask in views]
    A, t = way
    best = 0.0
    for _ in range(_STEPS):
        found, pairs = [], []
        for (camera, mask), inside in zip(views, fields, strict=True):
            drawn, points = body.seen(camera, A, t)
            pairs.append((drawn, mask))
            edge = drawn & ~cv2.erode(drawn.astype(np.uint8), np.ones((3, 3))).astype(bool)
            slope = np.column_stack([np.gradient(inside, axis=k)[edge] for k in (1, 0)])
            # The last pixels inside are half a pixel inside.
            found.append((camera, points[edge], slope, inside[edge] - 0.5))
        gained = mean_iou(pairs) - best
        if gained > 0:
            best, way = best + gained, (A, t)
        if gained < _GAIN:
            break
        scale, R, by = _step(found, turned=True)
        A, t = scale * R @ A, scale * R @ t + by
    return best, way


def _signed_distance(mask: Mask) -> Array:
    """(h, w) px of pixels from the outline, above 0 inside."""
    inside = mask.astype(np.uint8)
    far = [cv2.distanceTransform(part, cv2.DIST_L2, 5) for part in (inside, 1 - inside)]
    return np.where(mask, far[0] - 0.5, 0.5 - far[1]).astype(np.float64)


def _simpler(A: Array, t: Array, middle: Array) -> list[_Way]:
    """Ways to read a mesh about the middle (3,) of which is where it is by A and t: the simplest
    first."""
    scale = float(np.cbrt(abs(np.linalg.det(A))))
    units = [unit for unit in (1.0, *_UNITS) if abs(scale / unit - 1) < _ABOUT]
    turns = [A / scale]
    if (np.abs(np.round(turns[0]) - turns[0]) < _ABOUT).all():
        turns.insert(0, np.round(turns[0]))
    simple = [size * R for R in turns for size in (*units, scale)]
    place = A @ middle + t
    return [(B, np.zeros(3)) for B in simple] + [(B, place - B @ middle) for B in simple]


def _words(A: Array, t: Array) -> str:
    """How to read a mesh, A of whose coordinates, and t beside, are those of the object frame."""
    scale = float(np.cbrt(abs(np.linalg.det(A))))
    mirrored = np.linalg.det(A) < 0
    found = list[str]()
    if np.abs(np.abs(A / scale).max(axis=0) - 1).max() > 1e-6:
        w = Rotation.from_matrix((-A if mirrored else A) / scale).as_rotvec()
        angle = float(np.linalg.norm(w) * np.sign(w[np.abs(w).argmax()]))
        about = ", ".join(f"{x:.3g}" for x in np.round(w / angle, 2) + 0.0)
        first = "mirrored in its origin, and " if mirrored else ""
        found.append(f"it is {first}turned by {np.rad2deg(angle):.1f} degrees about ({about})")
    elif not np.array_equal(np.sign(A), np.eye(3)):
        rows = np.abs(A).argmax(axis=0)
        named = [f"{'-' if A[i, k] < 0 else ''}{_AXES[i]}" for k, i in enumerate(rows)]
        mirror = ", which mirrors it" if mirrored else ""
        found.append(f"its axes x, y, z are {', '.join(named)} of the poses{mirror}")
    unit = next((name for size, name in _UNITS.items() if abs(scale / size - 1) < 1e-9), "")
    if unit:
        found.append(f"its unit is {unit}")
    elif abs(scale - 1) > 1e-9:
        found.append(f"it is {scale:.4g} times as large")
    if t.any():
        digits = _DIGITS - int(np.ceil(np.log10(np.abs(t).max())))
        moved = ", ".join(f"{x:.{_DIGITS}g}" for x in np.round(t, digits) + 0.0)
        found.append(f"it is moved by ({moved}) m then")
    return ", and ".join(found)
