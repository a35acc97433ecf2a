"""The outlines of a turn as cameras around an axis see them, and what is left between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, robust_sigma

from .refine_coherence import Coherence
from .refine_outlines import place
from .refine_rig import Rig
from .refine_tangencies import HullView, Tangencies

_APART = np.deg2rad([8.0, 100.0])  # turn between two views that are compared
_ELEVATIONS = np.deg2rad(np.arange(-60, 61, 20))
_ROLLS = np.deg2rad(np.arange(0, 360, 30))
_MOST_STEPS, _MOST_RAD, _LITTLE = 30, 0.3, 1e-3
_MOST_DAMPING = 1e6
_SAME_RAD, _SAME_FOCAL = np.deg2rad(3.0), 0.2  # solutions apart by less are one
_AHEAD = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])  # of a camera at (1, 0, 0), z upright
_FARTHEST = 3.0  # sigmas that what was told may be off
_STARTS = 12


@dataclass(frozen=True)
class TurnView:
    """One view, and by how much the object has turned, rad."""

    contours: Contours
    hull: HullView
    angle: float


@dataclass(frozen=True)
class State:
    """Rotation (3, 3) object -> first camera, the logarithm of the focal length's factor, and the
    factor of the angles by which the object has turned."""

    R: Array
    focal: float
    rate: float = 1.0

    def moved(self, by: Array) -> State:
        """Turned in the camera's frame (3, rad), with a longer focal length, turning faster."""
        turned = Rotation.from_rotvec(by[:3]).as_matrix() @ self.R
        return State(turned, self.focal + float(by[3]), self.rate + float(by[4]))

    def like(self, other: State) -> bool:
        """Whether they are one solution."""
        apart = Rotation.from_matrix(self.R @ other.R.T).magnitude()
        return bool(apart < _SAME_RAD and abs(self.focal - other.focal) < _SAME_FOCAL)


@dataclass(frozen=True)
class Fit:
    """Residuals of a state by their places: which there are; in ``soft``; what they lose; their
    derivatives by the parameters. One that is not there is zero and loses as much as one at
    ``soft``.
    """

    there: NDArray[np.bool_]
    z: Array
    loss: Array
    J: Array


class Turn:
    """The outlines of a turn, as cameras see them that are told by a state."""

    def __init__(
        self,
        views: Sequence[TurnView],
        camera: Camera,
        focals: Sequence[float],
        focal_sigma: float,
        rate_sigma: float,
    ) -> None:
        self._contours = [view.contours for view in views]
        self._hulls = [view.hull for view in views]
        angles = np.array([view.angle for view in views])
        self._camera, self._focals, self._sigma = camera, focals, focal_sigma
        self._usual = float(np.mean(focals))
        self._angles, self._rate_sigma = angles, rate_sigma
        self._uv = np.concatenate([hull.uv for hull in self._hulls])
        self.size = float(np.median([np.ptp(hull.uv, axis=0).max() for hull in self._hulls])) / 2
        self._tangencies = Tangencies(self._hulls)
        pairs = self._tangencies.pairs
        apart = np.abs((angles[pairs[0]] - angles[pairs[1]] + np.pi) % (2 * np.pi) - np.pi)
        pairs = pairs[:, (apart > _APART[0]) & (apart < _APART[1])]
        self._tangencies.pairs = pairs
        self.owners = np.repeat(pairs, 2, axis=1).T
        self._free = np.array([1, 1, 1, focal_sigma, rate_sigma]) > 0
        self._rays: Coherence | None = None

    def look_along_rays(self) -> None:
        """Compare the rays of all outlines from now on, too."""
        self._rays = Coherence(self._contours, [self._camera] * len(self._contours))
        self.owners = np.concatenate([self.owners, np.column_stack([self._rays.view] * 2)])

    def rig(self, state: State) -> Rig:
        """The cameras. With a longer focal length they are as much farther from the axis, so that
        the object is as large as before."""
        K = np.tile(self._K(state.focal), (len(self._angles), 1, 1))
        about = state.rate * self._angles[:, None] * [0, 0, 1]
        turned = Rotation.from_rotvec(about).as_matrix()
        return Rig(state.R @ turned, np.exp(state.focal) * turned[:, 0], K)

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

    def starts(self, soft: float) -> list[State]:
        """The best of some that look at the axis from all around, by residuals softened at so many
        px."""
        found = []
        for focal in self._focals:
            aimed = Rotation.align_vectors([self._middle(focal)], [[0, 0, 1.0]])[0]
            for elevation in _ELEVATIONS:
                seen = Rotation.from_euler("x", elevation).as_matrix() @ _AHEAD
                for roll in _ROLLS:
                    R = (aimed * Rotation.from_euler("z", roll)).as_matrix() @ seen
                    found.append(State(R, float(focal)))
        found.sort(key=lambda state: self.loss(state, soft))
        return found[:_STARTS]

    def mirrored(self, state: State) -> State:
        """The same turn reflected in depth, the other way: alike but for perspective."""
        middle = self._middle(state.focal)
        return replace(state, R=(2 * np.outer(middle, middle) - np.eye(3)) @ state.R)

    def _place(self, rig: Rig) -> tuple[Array, float]:
        return place(self._tangencies.rays(rig), rig, self._hulls)

    def lens(self, state: State) -> Camera:
        """The camera, with its focal length."""
        return replace(self._camera, K=self._K(state.focal))

    def height(self, state: State) -> float:
        """Of the object's middle above the cameras, of their distance from the axis."""
        middle, _ = self._place(self.rig(state))
        return float(middle[2] / np.exp(state.focal))

    def apart(self, state: State) -> float:
        """How far apart two views see one plane, robust, px."""
        return robust_sigma(self._tangencies.residuals(self.rig(state))[0].value)

    def noise(self, state: State) -> float:
        """The same, or what the outlines are known to if that is more."""
        return max(self.apart(state), self._tangencies.usual_sigma)

    def gain(self, best: Fit, other: Fit) -> float:
        """By how many standard errors one fits better than another; from view to view, half of
        what a pair of views loses counted for each."""
        views = self._by_view((other.loss - best.loss)[:, None] / 2)[:, 0]
        return float(views.sum() / max(2 * np.sqrt(len(views)) * np.std(views), 1e-12))

    def sigmas(self, state: State, fit: Fit) -> tuple[float, float, float]:
        """1 sigma of the rotation, degrees, of the focal length and of the rate, of themselves:
        what the outlines of single views pull at the solution is taken for their errors."""
        free = self._free
        inverse = np.zeros((len(free), len(free)))
        inverse[np.ix_(free, free)] = np.linalg.inv(self.normal(state, fit)[0][np.ix_(free, free)])
        pull = self._by_view((2 * fit.z / (1 + fit.z**2))[:, None] * fit.J, twice=False)
        covariance = inverse @ pull.T @ pull @ inverse + inverse / 2
        rotation = float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])))
        focal, rate = np.sqrt(np.diag(covariance)[3:])
        return rotation, float(focal), float(rate)

    def _by_view(self, values: Array, twice: bool = True) -> Array:
        """(views, k) sums of values (places, k) over the views that they belong to; those of rays,
        which belong to one, counted twice or once."""
        found = np.zeros((len(self._angles), values.shape[1]))
        first, second = self.owners.T
        np.add.at(found, first, values)
        both = np.ones(len(first), np.bool_) if twice else first != second
        np.add.at(found, second[both], values[both])
        return found

    def searched(self, state: State, soft: float) -> Fit:
        """``fit``, and where rays pass best looked for along the whole of them."""
        if self._rays is not None:
            rig = self.rig(state)
            self._rays.search(rig, *self._place(rig))
        return self.fit(state, soft)

    def fit(self, state: State, soft: float) -> Fit:
        """What is left in a state, softened at so many px."""
        rig = self.rig(state)
        parts = [self._tangencies.residuals(rig)]
        parts[0][0].by_camera[:, 0, 8] += parts[0][0].value  # a pixel is a smaller angle
        if self._rays is not None:
            first = len(self.owners) - len(self._rays)
            found = self._rays.residuals(rig, *self._place(rig))
            parts.append((found, first + np.arange(len(found))))
        z, J = np.zeros(len(self.owners)), np.zeros((len(self.owners), len(self._free)))
        there, loss = np.zeros(len(z), np.bool_), np.full(len(z), np.log(2.0))
        # A camera turns about the axis and moves on around it.
        turning = np.concatenate([state.R[:, 2], -np.exp(state.focal) * state.R[:, 1]])
        for residuals, where in parts:
            z[where] = residuals.value / soft
            by = residuals.by_camera.sum(axis=1)
            by[:, 8] += by[:, 3:6] @ state.R[:, 0] * np.exp(state.focal)
            turn = residuals.by_camera[..., :6] @ turning * self._angles[residuals.camera]
            by[:, 9] = turn.sum(axis=1)
            J[where] = np.where(self._free, by[:, [0, 1, 2, 8, 9]], 0.0) / soft
            there[where], loss[where] = True, np.log1p(z[where] ** 2)
        return Fit(there, z, loss, J)

    def loss(self, state: State, soft: float) -> float:
        """Cauchy's, of all residuals."""
        return float(self.fit(state, soft).loss.sum()) + self._prior(state)

    def _prior(self, state: State) -> float:
        away = self._away(state)
        return float(0.5 * away @ away) if np.abs(away).max() < _FARTHEST else np.inf

    def _away(self, state: State) -> Array:
        """(2,) sigmas of focal length and rate from what they were told to be."""
        sigmas = np.array([self._sigma, self._rate_sigma])
        off = np.array([state.focal - self._usual, state.rate - 1.0])
        return np.where(sigmas > 0, off / np.where(sigmas > 0, sigmas, 1.0), 0.0)

    def settled(self, states: Iterable[State], softs: Iterable[float]) -> list[State]:
        """Where they descend to, step by step, the best first, each once."""
        softs = list(softs)
        ends = []
        for state in states:
            for soft in softs:
                state = self._descended(state, soft)
            ends.append((self.loss(state, softs[-1]), state))
        found: list[State] = []
        for _, state in sorted(ends, key=lambda end: end[0]):
            if not any(state.like(other) for other in found):
                found.append(state)
        return found

    def _descended(self, state: State, soft: float) -> State:
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

    def normal(self, state: State, fit: Fit) -> tuple[Array, Array]:
        """Normal equations."""
        w = 2 / (1 + fit.z**2)
        A, g = (fit.J.T * w) @ fit.J, fit.J.T @ (w * fit.z)
        for k, sigma, away in zip(
            (3, 4), (self._sigma, self._rate_sigma), self._away(state), strict=True
        ):
            if sigma:
                A[k, k] += sigma**-2
                g[k] += away / sigma
        return A, g
