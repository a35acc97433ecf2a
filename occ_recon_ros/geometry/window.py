"""Which frames see each frame's rim points again: partners chosen by angle, not by index."""

from collections.abc import Sequence

import numpy as np

from .arrays import Array
from .contours import Contours

_NEAR = 50  # frames among which the partner is looked for first
_TOLERANCE = 0.98  # steps are never equal: a partner may be this much nearer than asked


class ViewCircle:
    """Where the cameras stand around the object, in the order they came.

    Attributes:
        object_point: (3,) the object's place: the point nearest to the middle rays of all
            frames so far; a point ahead of the camera while that is all that is known.
    """

    def __init__(self) -> None:
        self._centres = np.empty((64, 3))
        self._count = 0
        self._A = np.zeros((3, 3))
        self._b = np.zeros(3)
        self.object_point = np.zeros(3)

    def __len__(self) -> int:
        return self._count

    @property
    def centres(self) -> Array:
        """(frames, 3) camera centres, metres, object frame."""
        return self._centres[: self._count]

    def keep(self, frames: Sequence[int]) -> None:
        """Forget all other frames; these are numbered anew. What all have said of the
        object's place stays."""
        self._count = len(frames)
        self._centres[: self._count] = self._centres[frames]

    def add(self, contours: Contours) -> None:
        """Take in the next frame."""
        forward = contours.middle / np.linalg.norm(contours.middle)
        across = np.eye(3) - np.outer(forward, forward)
        self._A += across
        self._b += across @ contours.centre
        if self._count == len(self._centres):
            self._centres = np.concatenate([self._centres, np.empty_like(self._centres)])
        self._centres[self._count] = contours.centre
        self._count += 1
        values, vectors = np.linalg.eigh(self._A)
        if values[0] < 1e-8 * values[2]:
            self.object_point = contours.centre + forward
        else:
            self.object_point = vectors @ ((vectors.T @ self._b) / values)

    def angles(self, k: int) -> Array:
        """(frames,) angle between frame k and every frame, seen from the object, radians."""
        arms = self.centres - self.object_point
        return self._between(arms, arms[k])

    @staticmethod
    def _between(arms: Array, arm: Array) -> Array:
        """(n,) angles between (n, 3) vectors and one."""
        unit = arms / np.linalg.norm(arms, axis=1, keepdims=True)
        # 2 asin(chord / 2) stays exact for small angles, where arccos does not.
        chord = np.linalg.norm(unit - arm / np.linalg.norm(arm), axis=1)
        return 2 * np.arcsin(np.minimum(chord / 2, 1))

    def earlier(self, k: int, baseline: float) -> int | None:
        """The nearest frame before k that is at least the baseline away."""
        # Most often it is near: the search costs the same in a long scan as in a short one.
        near = self._first(k, range(k - 1, max(k - _NEAR, 0) - 1, -1), baseline)
        if near is None and k > _NEAR:
            near = self._first(k, range(k - _NEAR - 1, -1, -1), baseline)
        return near

    def later(self, k: int, baseline: float) -> int | None:
        """The nearest frame after k that is at least the baseline away."""
        return self._first(k, range(k + 1, len(self)), baseline)

    def _first(self, k: int, others: Sequence[int], baseline: float) -> int | None:
        if not others:
            return None
        arms = self.centres[others] - self.object_point
        far = self._between(arms, self.centres[k] - self.object_point) >= _TOLERANCE * baseline
        return others[int(np.argmax(far))] if far.any() else None

    def opposite(self, k: int, j: int, baseline: float) -> int | None:
        """The frame nearest to k, of all, on the other side of k than j; None if all on
        that side are farther than twice the baseline and twice the usual step."""
        angles = self.angles(k)
        arms = self.centres - self.centres[k]
        side = arms @ arms[j] < 0
        limit = 2 * max(baseline, self._usual_step())
        fit = side & (angles >= _TOLERANCE * baseline) & (angles <= limit)
        return int(np.flatnonzero(fit)[np.argmin(angles[fit])]) if fit.any() else None

    def beyond(self, k: int, j: int, baseline: float, most: float = np.inf) -> int | None:
        """A frame on the same side of k as j, at least the baseline farther away than j, and
        at most so far from k."""
        angles = self.angles(k)
        arms = self.centres - self.centres[k]
        fit = (arms @ arms[j] > 0) & (angles >= angles[j] + _TOLERANCE * baseline)
        fit &= angles <= most
        return int(np.flatnonzero(fit)[np.argmin(angles[fit])]) if fit.any() else None

    def partners(self, k: int, baseline: float) -> tuple[int | None, int | None]:
        """Two partners of frame k wherever they are in the sequence, one on each side if
        the views allow it."""
        near = self.earlier(k, baseline)
        if near is None:
            near = self.later(k, baseline)
        if near is None:
            return None, None
        other = self.opposite(k, near, baseline)
        if other is None:
            other = self.beyond(k, near, baseline)
        return near, other

    def within(self, k: int, i: int, j: int, most: int) -> list[int]:
        """Frames no farther from k than i or j is, without these: at most so many on
        either side of k, spread evenly."""
        angles = self.angles(k)
        arms = self.centres - self.centres[k]
        near = angles <= max(angles[i], angles[j])
        near[[i, j, k]] = False
        frames: list[int] = []
        for side in (arms @ arms[j] > 0, arms @ arms[j] <= 0):
            own = np.flatnonzero(near & side)
            own = own[np.argsort(angles[own])]
            picked = np.linspace(0, len(own) - 1, min(most, len(own))).astype(int)
            frames += own[picked].tolist()
        return frames

    def same_side(self, k: int, i: int, j: int) -> bool:
        """Whether frames i and j lie on the same side of frame k."""
        C = self.centres
        return bool((C[i] - C[k]) @ (C[j] - C[k]) > 0)

    def _usual_step(self) -> float:
        arms = self.centres - self.object_point
        arms = arms / np.linalg.norm(arms, axis=1, keepdims=True)
        steps = np.linalg.norm(np.diff(arms, axis=0), axis=1)
        return float(np.median(steps)) if len(steps) else 0.0
