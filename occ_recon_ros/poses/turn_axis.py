"""The axis of a turntable from outlines alone: no board, no poses, steps that are known.

The object turns, the camera stands: in the object's frame the camera goes around the axis, which is
put at z with the camera at height 0, for outlines know nothing of that. Left are the camera's
rotation (from how high it looks, where it sees the axis, its roll) and, if it is not known, the
focal length. Planes that touch two outlines tell them (Mendonca, Wong and Cipolla, IEEE PAMI 23(6),
2001, doi:10.1109/34.927465), from starts all around; then the rays of all outlines together, for
planes touch where a body is round more often than elsewhere. A turn the other way is that of
a camera upside down; it and its reflection in depth differ by perspective alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, thinned
from occ_recon_ros.geometry.pose import CameraPose

from .refine_tangencies import HullView
from .turn_views import State, Turn, TurnView

FEWEST = 8  # views with an outline
TOO_FEW = f"{{}} images can be used: {FEWEST} with an outline are needed, 36 are good"
_SEARCHED, _POLISHED = 16, 40  # views that are looked at
_FOCALS = (0.8, 1.4, 2.8)  # of the image's longer side, where it is not known
_WIDE = 0.7  # 1 sigma of the logarithm of such a one
_ENDS, _RIVALS = 8, 4
_ROUGHLY, _CLOSER = (0.15, 0.04), (0.02, 0.005)  # residuals that count, of the outline's size
_SOFT = 2.0  # sigmas where residuals begin to count less
_FAR_WORSE = 6.0  # times the loss, with which a solution is none
_SURE = 2.0  # standard errors by which all others must be worse
_FITS, _FITS_WELL = 0.02, 0.005  # of the outline's size, that tangent planes may differ
_KNOWN_DEG, _HARDLY_DEG = 1.0, 4.0  # 1 sigma of the camera's rotation
_KNOWN_FOCAL, _KNOWN_RATE = 0.1, 0.01
_CALIBRATE = "calibrate the camera (occ-recon calibrate intrinsics, --camera-info)"
_ROUND = (
    "a body of revolution looks the same from all sides. Put a small thing beside it that turns "
    f"with it, use a printed board, or {_CALIBRATE}"
)
_STEPS = (
    "Was it a whole turn in equal steps, are the images in its order by their names, and did "
    "camera and axis stand still?"
)


@dataclass(frozen=True)
class TurnAxis:
    """Cameras around an axis that was found, and how well it is known.

    Attributes:
        cameras: n, in the object frame: z the axis, upwards in the images; the object's middle at
            height 0.
        elevation_deg: by how much the cameras look down along the axis.
        apart_px: how far apart two views see the planes that touch the object, robust, px.
        rotation_deg: 1 sigma of the cameras' rotation, degrees, by errors of the outlines alone:
            unequal steps and pixels that are not square come on top, seen at three times as much.
        focal: the same of the focal length, of itself; 0 where it was known.
        rate: factor of the angles that were told; 1 where they were known.
        doubts: sentences, none where all is well known.
        uneven: of these that by which the steps are not equal; empty where they are.
        fits_px: how far apart views may see those planes where all is well, px.
    """

    cameras: list[Camera]
    elevation_deg: float
    apart_px: float
    rotation_deg: float
    focal: float
    rate: float
    doubts: tuple[str, ...]
    uneven: str
    fits_px: float


def find_turn_axis(
    contours: Sequence[Contours],
    camera: Camera,
    angles: Array,
    focal_sigma: float = 0.0,
    distance: float = 1.0,
    rate_sigma: float = 0.0,
) -> TurnAxis:
    """Cameras of a turn from the outlines of its views.

    Args:
        contours: n, made with this camera.
        camera: the lens of all views; its place counts for nothing.
        angles: (n,) float64, by which the object has turned, rad, in either direction.
        focal_sigma: of the logarithm of the focal length. 0: known; infinite: unknown.
        distance: of the cameras from the axis, metres.
        rate_sigma: of the factor by which all angles may be wrong. 0: they are known.

    Raises:
        ValueError: too few outlines, none that fit, or more than one way they fit; in words.
    """
    seen = [
        TurnView(view, hull, float(angle))
        for view, angle in zip(contours, angles, strict=True)
        if (hull := HullView.of(view, camera)) is not None
    ]
    if len(seen) < FEWEST:
        raise ValueError(TOO_FEW.format(len(seen)))
    focals: Sequence[float] = (0.0,)
    if not np.isfinite(focal_sigma):
        longer = max(camera.width, camera.height) / camera.K[0, 0]
        focals, focal_sigma = np.log(np.multiply(_FOCALS, longer)), _WIDE
    few, more = (
        Turn(thinned(seen, most), camera, focals, focal_sigma, rate_sigma)
        for most in (_SEARCHED, _POLISHED)
    )
    found = _searched(few, more)
    if found.wrong is not None:
        raise ValueError(found.wrong)
    best, turn = found.best, found.turn
    rotation, focal, _ = found.sigmas
    turned = best.rate * np.asarray(angles)
    cameras = _placed(turn.lens(best), best.R, turned, distance, turn.height(best))
    return TurnAxis(
        cameras=cameras,
        elevation_deg=_elevation_deg(cameras[0].R_camera_object),
        apart_px=found.apart,
        rotation_deg=rotation,
        focal=focal,
        rate=best.rate,
        doubts=found.doubts,
        uneven=found.uneven,
        fits_px=found.fits_px,
    )


@dataclass(frozen=True)
class _Solved:
    """The best solution of a search, and how sure it is.

    Attributes:
        turn: the outlines it was searched in.
        best: the solution.
        apart: how far apart two views see the planes that touch the object, robust, px.
        rival: the best of all others, None where there is none.
        ahead: by how many standard errors it is worse; infinite without.
        sigmas: of the rotation, degrees, of the focal length and of the rate, of themselves.
    """

    turn: Turn
    best: State
    apart: float
    rival: State | None
    ahead: float
    sigmas: tuple[float, float, float]

    @property
    def wrong(self) -> str | None:
        """Why it cannot be used, if so."""
        if self.apart > _FITS * self.turn.size:
            return (
                "the outlines fit no turn in such steps about one axis: they are "
                f"{self.apart:.1f} px apart at best. {_STEPS}"
            )
        if self.ahead >= _SURE and self.sigmas[0] <= _HARDLY_DEG:
            return None
        if self.apart > self.fits_px:
            return (
                "the outlines fit no turn in such steps about one axis well, "
                f"{self.apart:.1f} px at best, and do not tell how the camera sees it. {_STEPS} "
                f"If all that is so: {_ROUND}"
            )
        why = _ROUND
        if self.rival is not None and self.sigmas[0] <= _HARDLY_DEG:
            ways = " as well as ".join(self._seen_as(state) for state in (self.best, self.rival))
            why = f"they fit {ways}: {_CALIBRATE}, or go nearer or higher up. Or {why}"
        return (
            f"the outlines do not tell how the camera sees the axis: {why}. By their names the "
            "images must be in the order of the turn, too"
        )

    def _seen_as(self, state: State) -> str:
        down, focal = _elevation_deg(state.R), self.turn.lens(state).K[0, 0]
        return (
            f"a camera that looks down by {down:.1f} degrees with a focal length of {focal:.0f} px"
        )

    @property
    def fits_px(self) -> float:
        """How far apart they may be where all is well, px."""
        return _FITS_WELL * self.turn.size

    @property
    def uneven(self) -> str:
        """That the steps are not equal, in a sentence; empty where they are."""
        if self.apart <= self.fits_px:
            return ""
        return f"the outlines fit a turn in equal steps to {self.apart:.1f} px only"

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is not well known, in sentences."""
        rotation, focal, rate = self.sigmas
        doubts = [self.uneven] if self.uneven else []
        if rotation > _KNOWN_DEG:
            doubts.append(f"the outlines tell the axis to {rotation:.1f} degrees only")
        if focal > _KNOWN_FOCAL:
            doubts.append(f"the outlines tell the focal length to {focal:.0%} only: {_CALIBRATE}")
        if rate > _KNOWN_RATE:
            doubts.append(f"the outlines tell by how much the table turned to {rate:.0%} only")
        return tuple(doubts)


def _searched(few: Turn, more: Turn) -> _Solved:
    """The best solution: searched from all around in few views, then polished in more."""
    ends = few.settled(few.starts(few.size * _ROUGHLY[0]), few.size * np.array(_ROUGHLY))
    ends = few.settled([*ends, few.mirrored(ends[0])], few.size * np.array(_ROUGHLY[-1:]))
    ends = more.settled(ends[:_ENDS], more.size * np.array(_CLOSER))
    soft = _SOFT * more.noise(ends[0])
    ends = more.settled(ends, [soft])
    least = more.loss(ends[0], soft)
    ends = [end for end in ends if more.loss(end, soft) < _FAR_WORSE * least][:_RIVALS]
    more.look_along_rays()
    ends = more.settled(ends, [more.size * _CLOSER[0], soft, soft])
    best, fit = ends[0], more.searched(ends[0], soft)
    gains = [more.gain(fit, more.searched(end, soft)) for end in ends[1:]]
    rival = ends[1 + int(np.argmin(gains))] if gains else None
    ahead = min(gains, default=np.inf)
    return _Solved(more, best, more.apart(best), rival, ahead, more.sigmas(best, fit))


def _elevation_deg(R_camera_object: Array) -> float:
    """By how much a camera looks down along z, degrees."""
    return float(np.rad2deg(np.arcsin(np.clip(-R_camera_object[2, 2], -1, 1))))


def _placed(
    camera: Camera, R: Array, angles: Array, distance: float, height: float
) -> list[Camera]:
    """A camera around the axis.

    Args:
        camera: its lens.
        R: (3, 3) object -> first camera.
        angles: (n,) of the object.
        distance: from the axis, metres.
        height: of the object above the camera, of the distance.
    """
    up = np.diag([1.0, -1.0, -1.0]) if R[1, 2] > 0 else np.eye(3)
    turned = Rotation.from_rotvec(angles[:, None] * [0, 0, 1]).as_matrix()
    found = []
    for turn in turned:
        centre = distance * (turn[0] - [0, 0, height]) @ up
        found.append(camera.at(CameraPose((R @ turn @ up).T, centre)))
    return found
