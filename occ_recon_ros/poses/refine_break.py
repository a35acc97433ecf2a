"""What moved in the middle of a scan: the object was kicked, or the camera bumped, and from then on
all views are off by one motion.

Pairs of views from one side of the event agree, and pairs across it do not. One motion, of six
parameters, makes these agree as well, where it is what happened.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.arrays import Array

from .refine_rig import POSE, Rig
from .refine_tangencies import Tangencies

_FEWEST = 3  # views on either side
_APART = 4.0  # times that pairs across the event are farther apart than the others
_MENDED = 0.2  # of that, less of which one motion leaves, and no more than others are apart
_COMPARED = 0.5  # of the pairs across it, that have something in common
_CLEARLY = 0.8  # of what one motion leaves, below which another explains it better
_HALF = 0.6745  # sigmas that half of the errors stay below
_FAR_PX = 100.0  # 1 sigma of the motion
_MOST_STEPS = 30


@dataclass(frozen=True)
class Break:
    """An event after which all views are off by one motion.

    Attributes:
        first: number of the first view after it.
        what: "object" or "camera", which of them moved.
        turn: by how much, rad.
        shift: by how much, metres: of the middle of the object, or of the camera's centre.
    """

    first: int
    what: str
    turn: float
    shift: float


def find_break(
    tangencies: Tangencies, rig: Rig, middle: Array, radius: float
) -> tuple[Break, Rig] | None:
    """The event that explains most, and the cameras with its motion taken back.

    Args:
        tangencies: of all pairs of views, in the order of time.
        rig: their n cameras.
        middle: (3,) float64, of the object, metres.
        radius: of it, metres.

    Returns:
        None where no one motion makes the views agree.
    """
    first = _where(tangencies, rig)
    if first is None:
        return None
    n = len(rig)
    late = np.arange(n) >= first
    moved = late if late.sum() <= n / 2 else ~late  # what most views say stays
    across = tangencies.between(moved)
    if len(across.residuals(rig)[0]) < _COMPARED * 2 * across.pairs.shape[1]:
        return None
    away = np.linalg.norm(rig.C - middle, axis=1)
    a_pixel = float(np.median(away / rig.focal))
    unit = np.repeat([a_pixel / radius, a_pixel], 3)  # rad or metres that move by a pixel
    before = _apart(across, rig)
    found = []
    for what, back in _BACK.items():
        x = unit * _fitted(across, lambda x, back=back: back(rig, moved, unit * x, middle))  # type: ignore[misc]
        now = back(rig, moved, x, middle)
        turn, shift = map(float, np.linalg.norm(x.reshape(2, 3), axis=1))
        found.append((_apart(across, now), Break(first, what, turn, shift), now))
    # About the axis of the table either turns alike: the table has slipped, or its encoder.
    of_object, of_camera = found
    after, event, now = of_camera if of_camera[0] < _CLEARLY * of_object[0] else of_object
    beside = _apart(tangencies.within(moved), rig)
    return (event, now) if after < min(_MENDED * before, max(beside, _HALF)) else None


def _where(tangencies: Tangencies, rig: Rig) -> int | None:
    """The first view after the event; None where pairs across none are farther apart."""
    residuals, _ = tangencies.residuals(rig)
    size = np.log(np.maximum(np.abs(residuals.value / residuals.sigma), _HALF))
    early, late = np.sort(residuals.camera, axis=1).T
    best, most = None, 0.0
    for first in range(_FEWEST, len(rig) - _FEWEST + 1):
        across = (early < first) & (late >= first)
        if not across.any() or across.all():
            continue
        more = float(size[across].mean() - size[~across].mean())
        if more > most and np.median(size[across]) - np.median(size[~across]) > np.log(_APART):
            best, most = first, more
    return best


def _fitted(across: Tangencies, moved: Callable[[Array], Rig]) -> Array:
    """(6,) motion in pixels that makes pairs across the event agree."""
    count = 2 * across.pairs.shape[1]
    missing = _apart(across, moved(np.zeros(POSE)))

    def off(x: Array) -> Array:
        residuals, place = across.residuals(moved(x))
        z = np.full(count, missing)
        z[place] = residuals.value / residuals.sigma
        return np.concatenate([z, x / _FAR_PX])

    x = np.zeros(POSE)
    for scale in (max(missing, 1.0), 1.0):  # a little is all that the second has to go
        x = least_squares(off, x, loss="cauchy", f_scale=scale, max_nfev=_MOST_STEPS).x
    return np.asarray(x)


def _apart(across: Tangencies, rig: Rig) -> float:
    """Sigmas that half of the pairs stay below."""
    residuals, _ = across.residuals(rig)
    return float(np.median(np.abs(residuals.value / residuals.sigma))) if len(residuals) else np.inf


def _object_back(rig: Rig, moved: NDArray[np.bool_], x: Array, middle: Array) -> Rig:
    """The object moved: its later views are those of cameras that moved with it."""
    Q = Rotation.from_rotvec(x[:3]).as_matrix()
    R, C = rig.R.copy(), rig.C.copy()
    R[moved] = R[moved] @ Q.T
    C[moved] = middle + (C[moved] - middle) @ Q.T + x[3:]
    return replace(rig, R=R, C=C)


def _camera_back(rig: Rig, moved: NDArray[np.bool_], x: Array, _: Array) -> Rig:
    """The camera moved, alike before all turns of the object."""
    Q = Rotation.from_rotvec(x[:3]).as_matrix()
    R, C = rig.R.copy(), rig.C.copy()
    C[moved] = C[moved] + np.einsum("nij,i->nj", R[moved], x[3:])
    R[moved] = Q @ R[moved]
    return replace(rig, R=R, C=C)


_BACK = {"object": _object_back, "camera": _camera_back}
