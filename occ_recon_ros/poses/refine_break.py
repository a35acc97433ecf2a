"""What moved in the middle of a scan: the object was kicked, the table slipped, or the camera was
bumped, and from then on all views are off by one motion.

Pairs of views from one side of the event agree, and pairs across it do not. One motion, of six
parameters, makes these agree as well, where it is what happened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array, thinned

from .refine_outlines import place
from .refine_rig import POSE, Rig
from .refine_tangencies import HullView, Tangencies

_FEWEST = 3  # views on either side
_MOST = 100  # that are held against each other
_APART = 4.0  # times that pairs across the event are farther apart than the others, to be looked at
_MENDED = 0.15  # of that, less of which one motion leaves; of outlines that are wrong 0.2 stays
_ALIKE = 2.0  # times that they are as far apart as the others then
_COMPARED = 0.5  # of the pairs across it, that have something in common
_CLEARLY = 0.8  # of what one motion leaves, below which another explains it better
_HALF = 0.6745  # sigmas that half of the errors stay below
_FAR_PX = 100.0  # 1 sigma of the motion
_MOST_STEPS = 30
_FEW_STEPS = 15  # from each of the sides on which a thing may lie
_SIDES = Rotation.create_group("O").as_rotvec()[1:]
_LIKELY = 4  # of these, followed to the end


@dataclass(frozen=True)
class Break:
    """An event after which all views are off by one motion.

    Attributes:
        first: number of the first view after it.
        what: "object" or "camera", which of them moved. About the axis of a table either turns
            alike, and it is called the object.
        early: whether the views before it are those that are moved, for they are fewer.
        motion: (6,) float64, of these cameras, so that they agree with the others: rotation vector
            (rad) and shift (m), about ``middle`` in the object frame, or in their own frames.
        middle: (3,) float64, of the object, metres.
    """

    first: int
    what: str
    early: bool
    motion: Array
    middle: Array

    @property
    def turn(self) -> float:
        """By how much, rad."""
        return float(Rotation.from_rotvec(self.motion[:3]).magnitude())

    @property
    def shift(self) -> float:
        """By how much, metres: the middle of the object, or the camera's centre."""
        return float(np.linalg.norm(self.motion[3:]))

    def taken_back(self, rig: Rig) -> Rig:
        """The cameras as they were, in the order of time."""
        moved = (np.arange(len(rig)) < self.first) == self.early
        Q, shift = Rotation.from_rotvec(self.motion[:3]).as_matrix(), self.motion[3:]
        R, C = rig.R.copy(), rig.C.copy()
        if self.what == "object":
            R[moved] = R[moved] @ Q.T
            C[moved] = self.middle + (C[moved] - self.middle) @ Q.T + shift
        else:
            C[moved] = C[moved] + shift @ R[moved]
            R[moved] = Q @ R[moved]
        return replace(rig, R=R, C=C)


def find_break(hulls: Sequence[HullView | None], cameras: Sequence[Camera]) -> Break | None:
    """The event that explains most, None where no one motion makes the views agree.

    Args:
        hulls: of the outlines of n views, in the order of time; None where one has none.
        cameras: n, as given.
    """
    seen = [k for k, hull in enumerate(hulls) if hull is not None]
    some = list(thinned(seen, _MOST))
    while (found := _among(some, hulls, cameras)) is not None:
        last, first = some[found.first - 1 : found.first + 1]
        between = [k for k in seen if last < k < first]
        if not between:
            return replace(found, first=first)
        # Of very many views, then those that were left out about it.
        some = sorted({*thinned(seen, _MOST // 2), last, first, *thinned(between, _MOST // 2)})
    return None


def parted_at(hulls: Sequence[HullView | None], cameras: Sequence[Camera]) -> int | None:
    """First view of the second of two parts in time, each of which agrees within itself, that no
    one motion brings together; None where there are none. Of more than 100 views some are looked
    at.

    Args:
        hulls: of the outlines of n views, in the order of time; None where one has none.
        cameras: n, as given.
    """
    some = list(thinned([k for k, hull in enumerate(hulls) if hull is not None], _MOST))
    if len(some) < 2 * _FEWEST:
        return None
    rig, tangencies = Rig.of([cameras[k] for k in some]), Tangencies([hulls[k] for k in some])
    first = _where(tangencies, rig)
    if first is None:
        return None
    late = np.arange(len(some)) >= first
    across, beside = (_apart(of(late), rig) for of in (tangencies.between, tangencies.within))
    if beside > _MENDED * across or find_break(hulls, cameras) is not None:
        return None
    return some[first]


def _among(
    some: Sequence[int], hulls: Sequence[HullView | None], cameras: Sequence[Camera]
) -> Break | None:
    """The same of some of the views; ``first`` is a place in the list of these."""
    n = len(some)
    if n < 2 * _FEWEST:
        return None
    own, rig = [hulls[k] for k in some], Rig.of([cameras[k] for k in some])
    tangencies = Tangencies(own)
    first = _where(tangencies, rig)
    if first is None:
        return None
    early = 2 * first < n  # what most views say stays
    across = tangencies.between(np.arange(n) >= first)
    if len(across.residuals(rig)[0]) < _COMPARED * 2 * across.pairs.shape[1]:
        return None
    middle, radius = place(tangencies.rays(rig), rig, own)
    a_pixel = rig.pixel_at(middle)
    unit = np.repeat([a_pixel / radius, a_pixel], 3)  # rad or metres that move by a pixel

    def explained(
        what: str, start: Array | None = None, steps: int = _MOST_STEPS
    ) -> tuple[float, Break]:
        event = Break(first, what, early, np.zeros(POSE), middle)
        begun = np.zeros(POSE) if start is None else start / unit
        x = _fitted(across, lambda x: replace(event, motion=unit * x).taken_back(rig), begun, steps)
        event = replace(event, motion=unit * x)
        return _apart(across, event.taken_back(rig)), event

    after, event = explained("object")
    other = explained("camera")
    if other[0] < _CLEARLY * after:
        after, event = other
    beside = _apart(tangencies.within(np.arange(n) >= first), rig)
    most = min(_MENDED * _apart(across, rig), _ALIKE * max(beside, _HALF))
    if after >= most:
        # What fell over lies on another side, too far from where it stood to be found from there.
        sides = [np.append(side, np.zeros(3)) for side in _SIDES]

        # Half of the pairs agree nearly as well where a part of the object looks like another.
        def contrary(explained: tuple[float, Break]) -> float:
            return _contrary(across, explained[1].taken_back(rig))

        likely = sorted((explained("object", side, _FEW_STEPS) for side in sides), key=contrary)
        ends = (explained("object", other.motion) for _, other in likely[:_LIKELY])
        after, event = min(ends, key=contrary)
    return event if after < most else None


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


def _fitted(across: Tangencies, moved: Callable[[Array], Rig], begun: Array, steps: int) -> Array:
    """(6,) motion in pixels that makes pairs across the event agree, begun from another."""
    count = 2 * across.pairs.shape[1]
    missing = _apart(across, moved(begun))

    def off(x: Array) -> Array:
        residuals, place = across.residuals(moved(x))
        z = np.full(count, missing)
        z[place] = residuals.value / residuals.sigma
        return np.concatenate([z, (x - begun) / _FAR_PX])

    def slope(x: Array) -> Array:
        rig = moved(x)
        residuals, place = across.residuals(rig)
        by_motion = np.stack([_moved_by(rig, moved(x + step)) for step in np.eye(POSE)], axis=2)
        by = np.zeros((count, POSE))
        own = residuals.by_camera[:, :, :POSE] / residuals.sigma[:, None, None]
        by[place] = np.einsum("msp,mspq->mq", own, by_motion[residuals.camera])
        return np.concatenate([by, np.eye(POSE) / _FAR_PX])

    x = begun
    for scale in (max(missing, 1.0), 1.0):  # a little is all that the second has to go
        x = least_squares(off, x, slope, loss="cauchy", f_scale=scale, max_nfev=steps).x
    return np.asarray(x)


def _moved_by(rig: Rig, other: Rig) -> Array:
    """(n, 6) from cameras to others: rotation (rad), shift (m), both in the camera's frame."""
    turn = Rotation.from_matrix(other.R @ np.swapaxes(rig.R, 1, 2)).as_rotvec()
    return np.hstack([turn, np.einsum("nij,nj->ni", rig.R, other.C - rig.C)])


def _apart(pairs: Tangencies, rig: Rig) -> float:
    """Sigmas that half of the pairs stay below."""
    residuals, _ = pairs.residuals(rig)
    return float(np.median(np.abs(residuals.value / residuals.sigma))) if len(residuals) else np.inf


def _contrary(pairs: Tangencies, rig: Rig) -> float:
    """How much all pairs speak against cameras, as a robust loss; those that see nothing in common
    as much as those that are far apart."""
    z = np.full(2 * pairs.pairs.shape[1], _FAR_PX)
    residuals, place = pairs.residuals(rig)
    z[place] = residuals.value / residuals.sigma
    return float(np.log1p(z**2).mean())
