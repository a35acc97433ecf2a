"""Whether a calibration is of a lens at all: each pixel must have a ray of its own.

A distortion that was fitted to too little may turn back within the image: farther from the middle
rays then come nearer to it again, two of them to each pixel there, and none to those beyond.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .camera import Camera

MOST_FOLDED = 0.25
"""Share of the pixels that may have no ray: what is far from the middle, where few calibrations
looked and few objects are."""
_GRID = 16  # pixels a side that are asked
_PATH = 24  # places between the middle and each of them
_ANGLES = 200  # between the axis of a fisheye and what is beside it
_STEP = 1e-6  # of derivatives, focal lengths
_RETURNS_PX = 0.5  # how near to its pixel a ray must come again


def folded_share(camera: Camera) -> float:
    """Share of the pixels of an image that have no ray of their own, by its lens, 0 to 1.

    Of a fisheye only pixels in the largest circle of the image count, and none by rays from the
    side or from behind: beyond its circle there is no picture.

    Args:
        camera: of which K, D, distortion and size count. The last 64 of these are remembered.
    """
    if not len(camera.D):
        return 0.0
    size = camera.width, camera.height
    return _folded_share(camera.K.tobytes(), camera.D.tobytes(), camera.distortion, size)


def refuse_folded(camera: Camera) -> None:
    """Keep out what is no lens.

    Raises:
        ValueError: more than MOST_FOLDED of the pixels have no ray of their own.
    """
    if (share := folded_share(camera)) > MOST_FOLDED:
        raise ValueError(
            f"K and D are of no lens: the distortion folds back within the image, "
            f"{100 * share:.0f} % of its pixels have no ray of their own; calibrate again with "
            "fewer coefficients"
        )


def have_ray(camera: Camera, uv: Array) -> NDArray[np.bool_]:
    """(n,) bool, whether image points (n, 2), px, have a ray of their own, by the lens."""
    if not folded_share(camera):
        return np.ones(len(uv), np.bool_)
    return _with_ray(camera, *uv.T)


@lru_cache(maxsize=64)
def _folded_share(K: bytes, D: bytes, distortion: str, size: tuple[int, int]) -> float:
    pose = np.eye(3), np.zeros(3)
    lens = Camera(np.frombuffer(K).reshape(3, 3), *size, *pose, np.frombuffer(D), distortion)
    u, v = (part.ravel() for part in np.meshgrid(*(np.linspace(0, n - 1, _GRID) for n in size)))
    found = _with_ray(lens, u, v)
    if distortion == "equidistant":
        pictured = np.hypot(u - 0.5 * (size[0] - 1), v - 0.5 * (size[1] - 1)) < 0.5 * min(size)
        found = found[pictured]
    return float(1 - found.mean())


def _with_ray(lens: Camera, u: Array, v: Array) -> NDArray[np.bool_]:
    y = (v - lens.K[1, 2]) / lens.K[1, 1]
    x = (u - lens.K[0, 2] - lens.K[0, 1] * y) / lens.K[0, 0]
    with np.errstate(all="ignore"):  # what is no lens may be out of all measure
        if lens.distortion == "equidistant":
            return np.asarray(np.hypot(x, y) <= _reach(lens.D))
        return _has_ray(lens, x, y)


def _reach(D: Array) -> float:
    """How far from the middle a fisheye turns back, focal lengths; inf: nowhere ahead of it."""
    theta = np.linspace(0, 0.5 * np.pi, _ANGLES)
    away = theta * np.polynomial.polynomial.polyval(theta**2, [1.0, *D])
    turns = np.flatnonzero(~(np.diff(away) > 0))
    return float(away[turns[0]]) if len(turns) else np.inf


def _has_ray(lens: Camera, xd: Array, yd: Array) -> NDArray[np.bool_]:
    """(n,) whether there is a ray to image points, and no fold on the way to it.

    Where the derivatives of the distortion are positive definite from the middle to all along the
    border, it maps what is within one to one.
    """
    x, y = lens._undistort(xd, yd)
    fx, fy = lens._distort(x, y)
    found = np.hypot((fx - xd) * lens.K[0, 0], (fy - yd) * lens.K[1, 1]) < _RETURNS_PX
    share = np.linspace(1 / _PATH, 1, _PATH)[:, None]
    x, y = share * x, share * y
    fx, fy = lens._distort(x, y)
    ax, ay = lens._distort(x + _STEP, y)
    bx, by = lens._distort(x, y + _STEP)
    xx, xy, yx, yy = ax - fx, bx - fx, ay - fy, by - fy
    return np.asarray(found & ((xx * yy > xy * yx) & (xx + yy > 0)).all(axis=0))
