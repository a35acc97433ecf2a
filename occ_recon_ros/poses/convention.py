"""Which way round given poses are: object -> camera, or one of what others write instead.

All that is known here of how others write poses, and where they have the first pixel, stands in
this file; what is known of their lenses stands where these are read.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from ..geometry.arrays import Array
from ..geometry.camera import Camera
from ..imaging.joint.space import fixation, optical_axes

_RIGHT = 0.9
"""Share of the views in whose image the fixation point lies where poses are right; a few may be
wrong for other reasons."""
_WRONG = 0.5
"""The same, below which poses cannot be right."""
_MEET = 0.4
"""Of how far the cameras are spread, the most by which axes miss each other that meet."""
_BETTER = 1 / 3
"""Of the miss of poses as they are, the most of those that were meant another way; of right ones no
other way of reading them leaves less than two thirds."""

_PRINTED = 0.01
"""Largest entry of R R^T - I of a rotation that was written with two digits."""

_UNIT = 0.05
"""By how much the length of a quaternion may be off 1; some programs leave them as an optimiser
did."""
_THREE_DIGITS = 2e-3
"""The same, of one that was written with three digits: not worth a word."""

ROUNDED = 1e-9  # of a distance from the origin, in float64; no more, for that may be far away

# x right, y down, z forward is ours; OpenGL and Blender have y up and z back.
_FLIP = np.diag([1.0, -1.0, -1.0])


def _inverse(camera: Camera) -> Camera:
    R, t = camera.R_camera_object, camera.t_camera_object
    return replace(camera, R_camera_object=R.T, t_camera_object=-R.T @ t)


def _flipped(camera: Camera) -> Camera:
    R, t = camera.R_camera_object, camera.t_camera_object
    return replace(camera, R_camera_object=_FLIP @ R, t_camera_object=_FLIP @ t)


def _reordered(camera: Camera, first: int, inverted: bool) -> Camera:
    """The camera of a quaternion whose four numbers, in the order x y z w of SciPy and ROS, begin
    with that one in truth; inverted: it leads from camera to object, and the centre is right."""
    R, centre = camera.R_camera_object, camera.centre
    q = np.roll(Rotation.from_matrix(R.T if inverted else R).as_quat(), -first)
    meant = Rotation.from_quat(q).as_matrix()
    if not inverted:
        return replace(camera, R_camera_object=meant)
    return replace(camera, R_camera_object=meant.T, t_camera_object=-meant.T @ centre)


Ways = Mapping[str, Callable[[Camera], Camera]]
"""{what poses may be: how to make them object -> camera}."""


OTHER_CONVENTIONS: Ways = {
    "camera -> object: give R^T and -R^T t": _inverse,
    "of a camera that looks along -z with y up (OpenGL, Blender): "
    "change the sign of the second and third row of R and t": _flipped,
    "camera -> object, of a camera that looks along -z with y up (OpenGL, Blender): "
    "invert them, then change the sign of the second and third row of R and t": (
        lambda camera: _flipped(_inverse(camera))
    ),
}
"""Of R and t."""


QUATERNION_ORDERS: Ways = {
    f"of quaternions {written}{to} that were read as {read}: read them in the order "
    f"{written}": partial(_reordered, first=first, inverted=inverted)
    for written, read, first in (("x y z w", "w x y z", 3), ("w x y z", "x y z w", 1))
    for to, inverted in (("", False), (", camera -> object,", True))
}
"""The same, of another order of four numbers. A turn read so is a turn about another axis, so that
axes alone do not tell."""


OF_TRANSFORMS: Ways = {
    "of a camera with y down that looks along z (OpenCV, COLMAP): change the sign of the second "
    "and third column of transform_matrix": _flipped,
    "world -> camera (OpenGL): give the inverse of transform_matrix": (
        lambda camera: _flipped(_inverse(_flipped(camera)))
    ),
    "world -> camera, of a camera with y down that looks along z (OpenCV, COLMAP): invert "
    "transform_matrix, then change the sign of its second and third column": (
        lambda camera: _inverse(_flipped(camera))
    ),
}
"""The same of transforms.json: what its poses may be that were read by ``from_opengl``."""


FIRST_PIXEL = 0.5
"""Where COLMAP, instant-ngp and nerfstudio have the centre of the first pixel, in u and v; for
OpenCV, ROS and us it is at 0. COLMAP: src/colmap/sensor/models.h and the tutorial, "the center of
the upper left most pixel has coordinate (0.5, 0.5)". nerfstudio: ``pixel_offset`` of
``get_image_coords`` in cameras/cameras.py. Blender, whose camera_angle_x is of the whole image from
edge to edge, agrees."""


def nearest_rotation(R: Array) -> Array:
    """The rotation (3, 3) next to a matrix that is one but for few printed digits; others as they
    are.

    Raises:
        ValueError: it mirrors.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        orthogonal = np.abs(R @ R.T - np.eye(3)).max() <= _PRINTED
    if not orthogonal:
        return R
    if np.linalg.det(R) < 0:
        raise ValueError(
            "its rotation mirrors (its determinant is -1): one axis of the camera or of the world "
            "is the other way round, as in left-handed programs (Unity, Unreal); negate that row "
            "or column"
        )
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)


def from_colmap(quaternion: Array, t: Array) -> tuple[Array, Array]:
    """A pose of COLMAP, whose camera axes are ours (https://colmap.github.io/format.html).

    Args:
        quaternion: (4,) float64, w x y z, Hamilton's, world -> camera.
        t: (3,) float64, world -> camera, any unit.

    Returns:
        R (3, 3) and t (3,), object -> camera, of the quaternion made one of length 1.

    Raises:
        ValueError: not finite, or a quaternion far from unit length.
    """
    if not (np.isfinite(quaternion).all() and np.isfinite(t).all()):
        raise ValueError("the pose is not finite (NaN or infinity)")
    length = float(_lengths(quaternion))
    if abs(length - 1) > _UNIT:
        raise ValueError(f"the quaternion must have length 1, got {length:.3g}")
    w, x, y, z = quaternion
    return Rotation.from_quat([x, y, z, w]).as_matrix(), t


def made_unit(quaternions: Array) -> str:
    """What is to be said of those that ``from_colmap`` makes ones of length 1; "" of none.

    Args:
        quaternions: (n, 4) float64.
    """
    off = np.abs(_lengths(quaternions) - 1)
    off = off[(off > _THREE_DIGITS) & (off <= _UNIT)]
    if not len(off):
        return ""
    return (
        f"the quaternions of {len(off)} of {len(quaternions)} images differ from length 1 by up to "
        f"{100 * off.max():.2g} %: they are normalised"
    )


def _lengths(quaternions: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(quaternions, axis=-1))


def from_opengl(T_world_camera: Array) -> tuple[Array, Array]:
    """A pose of transforms.json (https://docs.nerf.studio/quickstart/data_conventions.html).

    Args:
        T_world_camera: (4, 4) or (3, 4) float64, camera -> world, any unit; the camera has x right,
            y up, and looks along -z.

    Returns:
        R (3, 3) and t (3,), object -> camera.

    Raises:
        ValueError: it is not made of a rotation and a place alone, or mirrors.
    """
    R_world_camera, centre = nearest_rotation(T_world_camera[:3, :3]), T_world_camera[:3, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        rotation = np.abs(R_world_camera.T @ R_world_camera - np.eye(3)).max() < _PRINTED
        lengths = ", ".join(f"{n:.3g}" for n in np.linalg.norm(R_world_camera, axis=0))
    if not rotation:
        raise ValueError(f"it holds no rotation: its first three columns have lengths {lengths}")
    if not np.allclose(T_world_camera[3:], [0, 0, 0, 1]):
        raise ValueError("its last row must be 0 0 0 1")
    R = _FLIP @ R_world_camera.T
    return R, -R @ centre


def from_projection(P: Array) -> tuple[Array, Array, Array]:
    """A camera of one matrix, as those of OpenCV: the first pixel is at 0.

    Args:
        P: (3, 4) float64, world (any unit) -> pixels, of any scale and sign.

    Returns:
        K (3, 3) with K[2, 2] = 1, R (3, 3) and t (3,), object -> camera.

    Raises:
        ValueError: not finite, or of no camera that has a place.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        det = np.linalg.det(P[:, :3]) if np.isfinite(P).all() else np.nan
    if not np.isfinite(det) or det == 0:
        raise ValueError("the matrix is not finite, or of no camera that has a place")
    P = P * np.sign(det)
    K, R = rq(P[:, :3])
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    return K / K[2, 2], R, np.linalg.solve(K, P[:, 3])


def other_convention(
    cameras: Sequence[Camera], ways: Ways = OTHER_CONVENTIONS
) -> tuple[str, bool] | None:
    """What the poses seem to be where others than object -> camera make better sense.

    Views of one object look at a common place: the point nearest to all optical axes lies in
    front of each camera and inside its image. Poses of another convention look past each other, or
    their axes meet less well than those of what was meant.

    Args:
        cameras: the views as given, metres.
        ways: what they may be.

    Returns:
        Words, and whether they cannot be what they are given as; None where they agree with each
        other as they are, or as nothing known.
    """
    if len(cameras) < 3:
        return None
    share, miss = _in_view(cameras), _miss(cameras)
    apart = share <= _WRONG

    def missing(ways: Ways) -> dict[str, float]:
        return {
            words: _miss(changed)
            for words, change in ways.items()
            if _in_view(changed := [change(camera) for camera in cameras]) >= max(_RIGHT, share)
        }

    others = missing(ways)
    if apart and not others:
        others = missing(QUATERNION_ORDERS)
    best = min(others.values(), default=np.inf)
    if best > (_MEET if apart else min(_MEET, _BETTER * miss)):
        return None
    near = [words for words in others if _BETTER * others[words] <= best]
    return ", or ".join(sorted(near, key=lambda words: others[words])), apart


def _miss(cameras: Sequence[Camera]) -> float:
    """By how much the optical axes miss the point that all look at, in the median, as a share of
    how far the cameras are spread: all of it where they look at no place, or stand at one."""
    centres, axes = np.stack([camera.centre for camera in cameras]), optical_axes(cameras)
    missed = np.linalg.norm(np.cross(axes, fixation(cameras) - centres), axis=1)
    spread = np.linalg.norm(centres - np.median(centres, axis=0), axis=1)
    return float(np.median(missed) / max(np.median(spread), ROUNDED * np.abs(centres).max()))


def _in_view(cameras: Sequence[Camera]) -> float:
    """Share of the views in whose image the point lies that all look at."""
    point = fixation(cameras)[None]
    seen = 0
    for camera in cameras:
        (u, v), size = camera.project(point)[0], (camera.width, camera.height)
        apart, far = np.abs(camera.centre - point).max(), np.abs(camera.centre).max()
        ahead = apart > ROUNDED * far
        seen += bool(ahead and -0.5 <= u < size[0] - 0.5 and -0.5 <= v < size[1] - 0.5)
    return seen / len(cameras)
