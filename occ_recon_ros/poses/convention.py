"""Which way round given poses are: object -> camera, or one of what others write instead."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array
from ..geometry.camera import Camera
from ..imaging.joint.space import fixation

_RIGHT = 0.9
"""Share of the views in whose image the fixation point lies where poses are right; a few may be
wrong for other reasons."""
_WRONG = 0.5
"""The same, below which poses cannot be right."""

_PRINTED = 0.01
"""Largest entry of R R^T - I of a rotation that was written with two digits."""

_ROUNDED = 1e-9  # of a distance from the origin, in float64; no more, for that may be far away

# x right, y down, z forward is ours; OpenGL and Blender have y up and z back.
_FLIP = np.diag([1.0, -1.0, -1.0])


def _inverse(camera: Camera) -> Camera:
    R, t = camera.R_camera_object, camera.t_camera_object
    return replace(camera, R_camera_object=R.T, t_camera_object=-R.T @ t)


def _flipped(camera: Camera) -> Camera:
    R, t = camera.R_camera_object, camera.t_camera_object
    return replace(camera, R_camera_object=_FLIP @ R, t_camera_object=_FLIP @ t)


OTHER_CONVENTIONS: Mapping[str, Callable[[Camera], Camera]] = {
    "camera -> object: give R^T and -R^T t": _inverse,
    "of a camera that looks along -z with y up (OpenGL, Blender): "
    "change the sign of the second and third row of R and t": _flipped,
    "camera -> object, of a camera that looks along -z with y up (OpenGL, Blender): "
    "invert them, then change the sign of the second and third row of R and t": (
        lambda camera: _flipped(_inverse(camera))
    ),
}
"""{what poses may be: how to make them object -> camera}."""


def nearest_rotation(R: Array) -> Array:
    """The rotation (3, 3) next to a matrix that is one but for few printed digits; others as they
    are."""
    with np.errstate(over="ignore", invalid="ignore"):
        orthogonal = np.abs(R @ R.T - np.eye(3)).max() <= _PRINTED
    if not orthogonal or np.linalg.det(R) < 0:
        return R
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)


def other_convention(cameras: Sequence[Camera]) -> str | None:
    """What the poses seem to be where they cannot be object -> camera.

    Views of one object look at a common place: the point nearest to all optical axes lies in
    front of each camera and inside its image. Poses of another convention look past each other.

    Args:
        cameras: the views as given, metres.

    Returns:
        Words, or None where the poses agree with each other as they are, or as nothing known.
    """
    if len(cameras) < 3 or _in_view(cameras) > _WRONG:
        return None
    for words, change in OTHER_CONVENTIONS.items():
        if _in_view([change(camera) for camera in cameras]) >= _RIGHT:
            return words
    return None


def _in_view(cameras: Sequence[Camera]) -> float:
    """Share of the views in whose image the point lies that all look at."""
    point = fixation(cameras)[None]
    seen = 0
    for camera in cameras:
        (u, v), size = camera.project(point)[0], (camera.width, camera.height)
        apart, far = np.abs(camera.centre - point).max(), np.abs(camera.centre).max()
        ahead = apart > _ROUNDED * far
        seen += bool(ahead and -0.5 <= u < size[0] - 0.5 and -0.5 <= v < size[1] - 0.5)
    return seen / len(cameras)
