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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, robust_sigma, thinned

from .refine_coherence import Coherence
from .refine_outlines import place
from .refine_rig import Rig
from .refine_tangencies import HullView, Tangencies

FEWEST = 8  # views with an outline
_SEARCHED, _POLISHED = 16, 40  # views that are looked at
_APART = np.deg2rad([8.0, 100.0])  # turn between two views that are compared
_ELEVATIONS = np.deg2rad(np.arange(-60, 61, 20))
_ROLLS = np.deg2rad(np.arange(0, 360, 30))
_FOCALS = (0.8, 1.4, 2.8)  # of the image's longer side, where it is not known
_WIDE, _FARTHEST = 0.7, 3.0  # 1 sigma of the logarithm of such a one; sigmas that it may be off
_STARTS, _ENDS, _RIVALS = 12, 8, 4
_ROUGHLY, _CLOSER = (0.15, 0.04), (0.02, 0.005)  # residuals that count, of the outline's size
_SOFT = 2.0  # sigmas where residuals begin to count less
_MOST_STEPS, _MOST_RAD, _LITTLE = 30, 0.3, 1e-3
_MOST_DAMPING = 1e6
_SAME_RAD, _SAME_FOCAL = np.deg2rad(3.0), 0.2  # solutions apart by less are one
_FAR_WORSE = 6.0  # times the loss, with which a solution is none
_SURE = 2.0  # standard errors by which all others must be worse
_FITS, _FITS_WELL = 0.02, 0.005  # of the outline's size, that tangent planes may differ
_KNOWN_DEG, _HARDLY_DEG = 1.0, 4.0  # 1 sigma of the camera's rotation
_KNOWN_FOCAL = 0.1
_AHEAD = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])  # of a camera at (1, 0, 0), z upright
_CALIBRATE = "calibrate the camera (occ-recon calibrate intrinsics, --camera-info)"
_UNDETERMINED = (
    "the outlines do not tell how the camera sees the axis: a body of revolution looks the same "
    "from all sides. Put a small thing beside it that turns with it, use a printed board, or "
    f"{_CALIBRATE}"
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
        doubts: sentences, none where all is well known.
    """

    cameras: list[Camera]
    elevation_deg: float
    apart_px: float
    rotation_deg: float
    focal: float
    doubts: tuple[str, ...]


def find_turn_axis(
    contours: Sequence[Contours],
    camera: Camera,
    angles: Array,
    focal_sigma: float = 0.0,
    distance: float = 1.0,
) -> TurnAxis:
    """Cameras of a turn from the outlines of its views.

    Args:
        contours: n, made with this camera.
        camera: the lens of all views; its place counts for nothing.
        angles: (n,) float64, by which the object has turned, rad, in either direction.
        focal_sigma: of the logarithm of the focal length. 0: known; infinite: unknown.
        distance: of the cameras from the axis, metres.

    Raises:
        ValueError: too few outlines, none that fit, or more than one way they fit; in words.
    """
    seen = [
        _View(view, hull, float(angle))
        for view, angle in zip(contours, angles, strict=True)
        if (hull := HullView.of(view, camera)) is not None
    ]
    if len(seen) < FEWEST:
        raise ValueError(f"{len(seen)} images have an outline: {FEWEST} are needed, 36 are good")
    focals: Sequence[float] = (0.0,)
    if not np.isfinite(focal_sigma):
        longer = max(camera.width, camera.height) / camera.K[0, 0]
        focals, focal_sigma = np.log(np.multiply(_FOCALS, longer)), _WIDE
    few, more = (
        _Turn(thinned(seen, most), camera, focals, focal_sigma) for most in (_SEARCHED, _POLISHED)
    )
    ends = few.settled(few.starts(), few.size * np.array(_ROUGHLY))
    ends = few.settled([*ends, few.mirrored(ends[0])], few.size * np.array(_ROUGHLY[-1:]))
    ends = more.settled(ends[:_ENDS], more.size * np.array(_CLOSER))
    soft = _SOFT * more.noise(ends[0])
    ends = more.settled(ends, [soft])
    least = more.loss(ends[0], soft)
    ends = [end for end in ends if more.loss(end, soft) < _FAR_WORSE * least][:_RIVALS]
    more.look_along_rays()
    ends = more.settled(ends, [more.size * _CLOSER[0], soft, soft])
    best, fit = ends[0], more.searched(ends[0], soft)
    apart = more.apart(best)
    if apart > _FITS * more.size:
        raise ValueError(
            f"the outlines fit no turn in such steps about one axis: they are {apart:.1f} px apart "
            "at best. Was it a whole turn in equal steps, and did camera and axis stand still?"
        )
    for other in ends[1:]:
        if more.gain(fit, more.searched(other, soft)) < _SURE:
            raise ValueError(_UNDETERMINED)
    rotation, focal = more.sigmas(best, fit)
    if rotation > _HARDLY_DEG:
        raise ValueError(_UNDETERMINED)
    doubts = []
    if apart > _FITS_WELL * more.size:
        doubts.append(f"the outlines fit a turn in equal steps to {apart:.1f} px only")
    if rotation > _KNOWN_DEG:
        doubts.append(f"the outlines tell the axis to {rotation:.1f} degrees only")
    if focal > _KNOWN_FOCAL:
        doubts.append(f"the outlines tell the focal length to {focal:.0%} only: {_CALIBRATE}")
    cameras = _placed(more.lens(best), best.R, angles, distance, more.height(best))
    sine = float(np.clip(-cameras[0].R_camera_object[2, 2], -1, 1))
    elevation = float(np.rad2deg(np.arcsin(sine)))
    return TurnAxis(cameras, elevation, apart, rotation, focal, tuple(doubts))


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
        R_k = R @ turn @ up
        found.append(replace(camera, R_camera_object=R_k, t_camera_object=-R_k @ centre))
    return found


@dataclass(frozen=True)
class _View:
    """One view, and by how much the object has turned, rad."""

    contours: Contours
    hull: HullView
    angle: float


@dataclass(frozen=True)
class _State:
    """Rotation (3, 3) object -> first camera, and the logarithm of the focal length's factor."""

    R: Array
    focal: float

    def moved(self, by: Array) -> _State:
        """Turned in the camera's frame (3, rad), and with a focal length (1 or none) longer."""
        turned = Rotation.from_rotvec(by[:3]).as_matrix() @ self.R
        return _State(turned, self.focal + float(by[3:].sum()))

    def like(self, other: _State) -> bool:
        """Whether they are one solution."""
        apart = Rotation.from_matrix(self.R @ other.R.T).magnitude()
        return bool(apart < _SAME_RAD and abs(self.focal - other.focal) < _SAME_FOCAL)


@dataclass(frozen=True)
class _Fit:
    """Residuals of a state by their places: which there are; in ``soft``; what they lose; their
    derivatives by the parameters. One that is not there is zero and loses as much as one at
    ``soft``.
    """

    there: NDArray[np.bool_]
    z: Array
    loss: Array
    J: Array


class _Turn:
    """The outlines of a turn, as cameras see them that are told by a state."""

    def __init__(
        self,
        views: Sequence[_View],
        camera: Camera,
        focals: Sequence[float],
        focal_sigma: float,
    ) -> None:
        self._contours = [view.contours for view in views]
        self._hulls = [view.hull for view in views]
        angles = np.array([view.angle for view in views])
        self._camera, self._focals, self._sigma = camera, focals, focal_sigma
        self._usual = float(np.mean(focals))
        self._turned = Rotation.from_rotvec(angles[:, None] * [0, 0, 1]).as_matrix()
        self._uv = np.concatenate([hull.uv for hull in self._hulls])
        self.size = float(np.median([np.ptp(hull.uv, axis=0).max() for hull in self._hulls])) / 2
        self._tangencies = Tangencies(self._hulls)
        pairs = self._tangencies.pairs
        apart = np.abs((angles[pairs[0]] - angles[pairs[1]] + np.pi) % (2 * np.pi) - np.pi)
        pairs = pairs[:, (apart > _APART[0]) & (apart < _APART[1])]
        self._tangencies.pairs = pairs
        self.owners = np.repeat(pairs, 2, axis=1).T
        self._columns = [0, 1, 2, 8] if focal_sigma else [0, 1, 2]
        self._rays: Coherence | None = None

    def look_along_rays(self) -> None:
        """Compare the rays of all outlines from now on, too."""
        self._rays = Coherence(self._contours, [self._camera] * len(self._contours))
        self.owners = np.concatenate([self.owners, np.column_stack([self._rays.view] * 2)])

    def rig(self, state: _State) -> Rig:
        """The cameras. With a longer focal length they are as much farther from the axis, so that
        the object is as large as before."""
        K = np.tile(self._K(state.focal), (len(self._turned), 1, 1))
        return Rig(state.R @ self._turned, np.exp(state.focal) * self._turned[:, 0], K)

    def _K(self, focal: float) -> Array:
        K = self._camera.K.copy()
        K[[0, 1], [0, 1]] *= np.exp(focal)
        return K

    def _middle(self, focal: float) -> Array:
        """(3,) the ray in the middle of all outlines, camera frame: together they are symmetric
        about the axis."""
        rays = np.column_stack([self._uv, np.ones(len(self._uv))]) @ np.linalg.inv(self._K(focal)).T
        middle = rays.min(axis=0) + rays.max(axis=0)
        found: Array = middle / np.linalg.norm(middle)
        return found

    def starts(self) -> list[_State]:
        """The best of some that look at the axis from all around."""
        found = []
        for focal in self._focals:
            aimed = Rotation.align_vectors([self._middle(focal)], [[0, 0, 1.0]])[0]
            for elevation in _ELEVATIONS:
                seen = Rotation.from_euler("x", elevation).as_matrix() @ _AHEAD
                for roll in _ROLLS:
                    R = (aimed * Rotation.from_euler("z", roll)).as_matrix() @ seen
                    found.append(_State(R, float(focal)))
        found.sort(key=lambda state: self.loss(state, self.size * _ROUGHLY[0]))
        return found[:_STARTS]

    def mirrored(self, state: _State) -> _State:
        """The same turn reflected in depth, the other way: alike but for perspective."""
        middle = self._middle(state.focal)
        return _State((2 * np.outer(middle, middle) - np.eye(3)) @ state.R, state.focal)

    def _place(self, rig: Rig) -> tuple[Array, float]:
        return place(self._tangencies.rays(rig), rig, self._hulls)

    def lens(self, state: _State) -> Camera:
        """The camera, with its focal length."""
        return replace(self._camera, K=self._K(state.focal))

    def height(self, state: _State) -> float:
        """Of the object's middle above the cameras, of their distance from the axis."""
        middle, _ = self._place(self.rig(state))
        return float(middle[2] / np.exp(state.focal))

    def apart(self, state: _State) -> float:
        """How far apart two views see one plane, robust, px."""
        return robust_sigma(self._tangencies.residuals(self.rig(state))[0].value)

    def noise(self, state: _State) -> float:
        """The same, or what the outlines are known to if that is more."""
        return max(self.apart(state), self._tangencies.usual_sigma)

    def gain(self, best: _Fit, other: _Fit) -> float:
        """By how many standard errors one fits better than another; from view to view, half of
        what a pair of views loses counted for each."""
        views = self._by_view((other.loss - best.loss)[:, None] / 2)[:, 0]
        return float(views.sum() / max(2 * np.sqrt(len(views)) * np.std(views), 1e-12))

    def sigmas(self, state: _State, fit: _Fit) -> tuple[float, float]:
        """1 sigma of the rotation, degrees, and of the focal length, of itself: what the outlines
        of single views pull at the solution is taken for their errors."""
        inverse = np.linalg.inv(self.normal(state, fit)[0])
        pull = self._by_view((2 * fit.z / (1 + fit.z**2))[:, None] * fit.J, twice=False)
        covariance = inverse @ pull.T @ pull @ inverse + inverse / 2
        rotation = float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])))
        return rotation, float(np.sqrt(covariance[3:, 3:].sum()))

    def _by_view(self, values: Array, twice: bool = True) -> Array:
        """(views, k) sums of values (places, k) over the views that they belong to; those of rays,
        which belong to one, counted twice or once."""
        found = np.zeros((len(self._turned), values.shape[1]))
        first, second = self.owners.T
        np.add.at(found, first, values)
        both = np.ones(len(first), np.bool_) if twice else first != second
        np.add.at(found, second[both], values[both])
        return found

    def searched(self, state: _State, soft: float) -> _Fit:
        """``fit``, and where rays pass best looked for along the whole of them."""
        if self._rays is not None:
            rig = self.rig(state)
            self._rays.search(rig, *self._place(rig))
        return self.fit(state, soft)

    def fit(self, state: _State, soft: float) -> _Fit:
        """What is left in a state, softened at so many px."""
        rig = self.rig(state)
        parts = [self._tangencies.residuals(rig)]
        parts[0][0].by_camera[:, 0, 8] += parts[0][0].value  # a pixel is a smaller angle
        if self._rays is not None:
            first = len(self.owners) - len(self._rays)
            found = self._rays.residuals(rig, *self._place(rig))
            parts.append((found, first + np.arange(len(found))))
        z, J = np.zeros(len(self.owners)), np.zeros((len(self.owners), len(self._columns)))
        there, loss = np.zeros(len(z), np.bool_), np.full(len(z), np.log(2.0))
        for residuals, where in parts:
            z[where] = residuals.value / soft
            by = residuals.by_camera.sum(axis=1)
            by[:, 8] += by[:, 3:6] @ state.R[:, 0] * np.exp(state.focal)
            J[where] = by[:, self._columns] / soft
            there[where], loss[where] = True, np.log1p(z[where] ** 2)
        return _Fit(there, z, loss, J)

    def loss(self, state: _State, soft: float) -> float:
        """Cauchy's, of all residuals."""
        return float(self.fit(state, soft).loss.sum()) + self._prior(state)

    def _prior(self, state: _State) -> float:
        away = (state.focal - self._usual) / self._sigma if self._sigma else 0.0
        return 0.5 * away**2 if abs(away) < _FARTHEST else np.inf

    def settled(self, states: Iterable[_State], softs: Iterable[float]) -> list[_State]:
        """Where they descend to, step by step, the best first, each once."""
        softs = list(softs)
        ends = []
        for state in states:
            for soft in softs:
                state = self._descended(state, soft)
            ends.append((self.loss(state, softs[-1]), state))
        found: list[_State] = []
        for _, state in sorted(ends, key=lambda end: end[0]):
            if not any(state.like(other) for other in found):
                found.append(state)
        return found

    def _descended(self, state: _State, soft: float) -> _State:
        """Levenberg and Marquardt's steps."""
        fit, damping = self.searched(state, soft), 1e-3
        for _ in range(_MOST_STEPS):
            A, g = self.normal(state, fit)
            while damping < _MOST_DAMPING:
                step = -np.linalg.solve(A + np.diag(damping * np.diag(A) + 1e-12), g)
                new = state.moved(step * min(1.0, _MOST_RAD / max(np.abs(step).max(), 1e-12)))
                after = self.fit(new, soft)
                both = fit.there & after.there
                gain = float((fit.loss - after.loss)[both].sum())
                gain += self._prior(state) - self._prior(new)
                if gain > 0:
                    break
                damping *= 6
            else:
                break
            state, fit, damping = new, after, max(damping / 10, 1e-6)
            if gain < _LITTLE:
                break
        return state

    def normal(self, state: _State, fit: _Fit) -> tuple[Array, Array]:
        """Normal equations."""
        w = 2 / (1 + fit.z**2)
        A, g = (fit.J.T * w) @ fit.J, fit.J.T @ (w * fit.z)
        if self._sigma:
            A[3, 3] += self._sigma**-2
            g[3] += (state.focal - self._usual) / self._sigma**2
        return A, g
