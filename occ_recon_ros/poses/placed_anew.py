"""The pose of a view that the outlines of the others contradict, from these outlines.

Views whose poses are wrong are few, and a correction of all poses by all outlines bends right ones
to meet them. Here the others stay where they are: the outline of the one view is laid on their
visual hull, which finds it from degrees away, and then brought to touch the planes that touch
theirs, and to leave of the body what their rays ask for. The hull is too large where no view looks;
these are not.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.geometry.viewing import seen_by

from .laid_on_hull import HullOfOthers, moved, units
from .refine_outlines import OutlineResiduals, place
from .refine_rig import Axis, Rig, common_axis
from .refine_solve import scale_of, weights
from .refine_tangencies import HullView, Tangencies, hulls_of

_STANDS_OUT = 3.0  # times what the views are usually off by
_AS_USUAL = 2.0  # times that, up to which a view agrees with the others
_LEAST_OFF = 0.7  # sigmas of the outlines: no view is usually off by less
_FEW = 0.5  # of the planes that views usually touch in common with others
_FEWEST = 6  # other views
_EVEN = 0.25  # of the usual step, 1 sigma, by which steps of an even turn may differ
_REACH = np.deg2rad(20)  # from a pose it is looked for at; farther off it is another image's mask
_ROUNDS = 15
_SEARCHED = 5  # rounds after which rays are looked along as a whole again
_FARTHEST = 0.05  # of the object's radius, in one step
_NEAR = 1e-3  # sigmas of its outline by which a last step moves a view
_KNOWN = 0.01  # of the object's radius, 1 sigma, to which outlines must tell each way of moving
_TOLD = 0.03  # of what is seen of the way of moving that shows most; of less, numbers know nothing


@dataclass(frozen=True)
class Placed:
    """A view in another pose.

    Attributes:
        camera: in that pose.
        turn: of it about the object's middle against the given one, rad.
        shift: of the object's middle against it, in the camera's frame, (3,) metres.
        away: of the camera from the object's middle, metres.
        untold: unit vector (3,), camera frame, of the turn of the object that the outlines tell
            nothing of, None where they tell all; it is that of the place begun from.
        predicted: whether that is where the even steps of the others have it, else as given.
        off: how far its outline is from those of the others, robust, in sigmas.
        usual: the same of the others.
    """

    camera: Camera
    turn: float
    shift: Array
    away: float
    untold: Array | None
    predicted: bool
    off: float
    usual: float

    @property
    def agrees(self) -> bool:
        """Whether it is as near to the others as they usually are to each other."""
        return self.off <= _AS_USUAL * max(self.usual, _LEAST_OFF)


def strays(contours: Sequence[Contours | None], cameras: Sequence[Camera]) -> list[int]:
    """Views that the planes which touch two outlines tell to stand elsewhere, the farthest first.

    Args:
        contours: one a camera, made with it, None where a view has none.
        cameras: n, metres, object frame.
    """
    hulls = hulls_of(contours, cameras)
    if sum(hull is not None for hull in hulls) <= _FEWEST:
        return []
    off = _off(hulls, cameras)
    limit = _STANDS_OUT * max(float(np.nanmedian(off)), _LEAST_OFF)
    order = np.argsort(-np.nan_to_num(off))
    return [int(k) for k in order if off[k] > limit]


def placed_anew(
    k: int,
    contours: Sequence[Contours | None],
    cameras: Sequence[Camera],
    others: Collection[int],
) -> Placed | None:
    """The pose of view k by the outlines of others, which stay where they are.

    Args:
        k: number of the view; it has an outline.
        contours: of all views, made with the cameras.
        cameras: of all views, in the order of time; metres, object frame.
        others: numbers of views whose poses are to be believed.

    Returns:
        None where there are too few others, or it fits nowhere near the given pose, nor where the
        even steps of the others have it.
    """
    others = sorted(o for o in others if contours[o] is not None and o != k)
    own = contours[k]
    if own is None or len(others) < _FEWEST:
        return None
    theirs = [c for o in others if (c := contours[o]) is not None]
    by = [cameras[o] for o in others]
    hulls = hulls_of(theirs, by)
    rig, seen = Rig.of(by), Tangencies(hulls)
    middle, radius = place(seen.rays(rig), rig, hulls)
    usual = float(np.nanmedian(_off(hulls, by)))
    axis = common_axis(by)
    starts = [*_by_neighbours(k, others, by, axis, cameras[k]), cameras[k]]
    hull = HullOfOthers(theirs, by, middle, radius)
    rough = hull.placed(own, starts, None if axis is None else axis.direction)

    def settled(there: Camera) -> tuple[Camera, Array | None]:
        return _Fit([*theirs, seen_by(there, own)], [*by, there], middle, radius).settled()

    camera, untold = settled(rough)
    if untold is not None:
        # The hull has edges that the object has not: by them it was turned.
        turned = _turn(camera, starts[0]) @ untold
        back = np.concatenate([-turned * untold, np.zeros(3)])
        camera, _ = settled(moved(camera, back, middle, radius))
    last = [*hulls, HullView.of(seen_by(camera, own), camera)]
    off = _off(last, [*by, camera])[-1]
    reached = min(float(np.linalg.norm(_turn(camera, start))) for start in starts)
    if not np.isfinite(off) or reached > _REACH:
        return None
    at, was = (c.in_camera(middle) for c in (camera, cameras[k]))
    turn = float(np.linalg.norm(_turn(camera, cameras[k])))
    away = float(np.linalg.norm(at))
    return Placed(camera, turn, at - was, away, untold, len(starts) > 1, float(off), usual)


def _turn(camera: Camera, before: Camera) -> Array:
    """(3,) rotation vector from one camera to another, in their frame, rad."""
    R = camera.R_camera_object @ before.R_camera_object.T
    return np.asarray(Rotation.from_matrix(R).as_rotvec(), np.float64)


def _off(hulls: Sequence[HullView | None], cameras: Sequence[Camera]) -> Array:
    """(n,) how far each outline is from those of the others, robust, in sigmas; NaN without one,
    infinite where it has too few planes in common with them."""
    tangencies = Tangencies(hulls)
    residuals, place = tangencies.residuals(Rig.of(cameras))
    z, pair = residuals.value / residuals.sigma, tangencies.pairs[:, place // 2]
    mine = [(pair == k).any(axis=0) for k in range(len(hulls))]
    few = _FEW * np.median([own.sum() for own, h in zip(mine, hulls, strict=True) if h])
    found = np.full(len(hulls), np.nan)
    for k, (own, hull) in enumerate(zip(mine, hulls, strict=True)):
        if hull is not None:
            found[k] = scale_of(z[own]) if own.sum() > few else np.inf
    return found


def _by_neighbours(
    k: int, others: Sequence[int], cameras: Sequence[Camera], axis: Axis | None, lens: Camera
) -> list[Camera]:
    """Where view k stands if the turn that the others (in the order of time) make is even."""
    if axis is None:
        return []
    turns = [b.R_camera_object.T @ a.R_camera_object for a, b in pairwise(cameras)]
    angles = Rotation.from_matrix(turns).as_rotvec() @ axis.direction
    steps = angles / np.diff(others)
    step = float(np.median(steps))
    if not np.std(steps) < _EVEN * abs(step):
        return []
    near = int(np.argmin(np.abs(np.array(others) - k)))
    turn = Rotation.from_rotvec((k - others[near]) * step * axis.direction)
    R = turn.as_matrix() @ cameras[near].R_camera_object.T
    centre = axis.point + turn.apply(cameras[near].centre - axis.point)
    return [lens.at(CameraPose(R, centre))]


class _Fit:
    """The last view brought to agree with the others by what all outlines say.

    It moves by x (6,): a turn of the object about its middle and a shift of that, in the camera's
    frame, both in radii of the object; along the view in its distances."""

    def __init__(
        self, contours: Sequence[Contours], cameras: Sequence[Camera], middle: Array, radius: float
    ) -> None:
        self._cameras, self._middle, self._radius = list(cameras), middle, radius
        self._outlines = OutlineResiduals(contours, cameras, hulls_of(contours, cameras))

    def settled(self) -> tuple[Camera, Array | None]:
        """The camera, and the turn that the outlines do not tell as in ``Placed``."""
        for k in range(_ROUNDS):
            if k % _SEARCHED == 0:
                self._outlines.search(Rig.of(self._cameras))
            values, ways, pull = self._normal()
            told = _told(values)
            along = ways.T @ pull
            x = -ways @ np.where(told, along / np.where(told, values, 1.0), 0.0)
            length = float(np.linalg.norm(x))
            x = x * min(1.0, _FARTHEST / max(length, 1e-12))
            self._cameras[-1] = moved(self._cameras[-1], x, self._middle, self._radius)
            if not float(x @ (ways * values) @ ways.T @ x) > _NEAR**2:
                break
        values, ways, _ = self._normal()
        if _told(values)[0]:
            return self._cameras[-1], None
        turn = ways[:3, 0]
        return self._cameras[-1], turn / max(float(np.linalg.norm(turn)), 1e-12)

    def _normal(self) -> tuple[Array, Array, Array]:
        """What residuals that depend on the view say of x: the eigenvalues (6,) of their
        information, the least first, its eigenvectors in columns, and their pull (6,)."""
        rig, last = Rig.of(self._cameras), len(self._cameras) - 1
        residuals, _ = self._outlines.residuals(rig)
        mine = (residuals.camera == last)[:, :, None]
        by = np.where(mine, residuals.by_camera[:, :, :6], 0.0).sum(axis=1)
        rows = by.any(axis=1)
        z = residuals.value[rows] / residuals.sigma[rows]
        # Turned about the object's middle its camera is turned as much, and goes around.
        m = self._cameras[-1].in_camera(self._middle)
        to_camera = np.zeros((6, 6))
        to_camera[:3, :3], to_camera[3:, :3] = np.eye(3), -np.cross(np.eye(3), m)  # -[m]x
        to_camera[3:, 3:] = -np.diag(units(m, self._radius))
        J = by[rows] @ to_camera / residuals.sigma[rows, None]
        noise = scale_of(z)
        w = weights(z, noise) / noise**2
        values, ways = np.linalg.eigh(J.T @ (w[:, None] * J))
        return values, ways, J.T @ (w * z)


def _told(values: Array) -> NDArray[np.bool_]:
    """(6,) which ways of moving outlines tell, by the eigenvalues of their information."""
    found: NDArray[np.bool_] = values > max(_KNOWN**-2, _TOLD**2 * values[-1])
    return found
