"""Where the camera has passed, so that it is known where it passes again."""

from dataclasses import dataclass

import numpy as np

from occ_recon_ros.geometry.arrays import Array

_ASIDE = 0.02  # of the distance to the object: how far beside a path still is the same
_ALONG = 0.7  # cosine of the angle that two steps of one way may differ by (a coarse chord)
_CELLS = 20  # parts of a step that are covered or not
_WHOLE = 0.95  # of a step: all of it but for rounding


@dataclass(frozen=True)
class Step:
    """A step of the camera.

    Attributes:
        start, end: (3,) camera centres, metres.
        distance: from the camera to the object, metres.
    """

    start: Array
    end: Array
    distance: float

    @property
    def length(self) -> float:
        """Metres."""
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True)
class Overlap:
    """What a step has in common with others.

    Attributes:
        own: (k, 2) float64, the part of the step, from 0 to 1, that each of the others
            passes; from 0 to 0 where none.
        theirs: (k, 2) float64, the part of each of the others that the step passes.
    """

    own: Array
    theirs: Array


class CameraPath:
    """Steps of the camera, by running numbers.

    Two steps have in common what lies side by side: lengths count relative to the distance
    from the object, so that neither scale, nor place and turn of the frame matter.
    """

    def __init__(self) -> None:
        self._steps: dict[int, Step] = {}
        self._next = 0

    def add(self, step: Step) -> int:
        """Note a step; gives its number."""
        self._steps[self._next] = step
        self._next += 1
        return self._next - 1

    def remove(self, number: int) -> None:
        """Forget a step."""
        del self._steps[number]

    def step(self, number: int) -> Step:
        """The step of a number."""
        return self._steps[number]

    def beside(self, step: Step) -> tuple[list[int], Overlap]:
        """Numbers of the other steps that have something in common with one, and what."""
        numbers = [number for number, other in self._steps.items() if other is not step]
        if not numbers or not step.length > 0:
            return [], Overlap(np.zeros((0, 2)), np.zeros((0, 2)))
        start = np.array([self._steps[number].start for number in numbers])
        end = np.array([self._steps[number].end for number in numbers])
        found = overlap(step, start, end)
        rows = np.flatnonzero(np.diff(found.own, axis=1)[:, 0] > 0)
        return [numbers[row] for row in rows], Overlap(found.own[rows], found.theirs[rows])


def overlap(step: Step, start: Array, end: Array) -> Overlap:
    """What a step has in common with others, from (k, 3) start to (k, 3) end."""
    own_way, ways = step.end - step.start, end - start
    own_square = float(own_way @ own_way)
    squares = np.maximum(np.einsum("kj,kj->k", ways, ways), np.finfo(float).tiny)
    on_own = np.stack([(start - step.start) @ own_way, (end - step.start) @ own_way], axis=1)
    on_theirs = np.stack(
        [np.einsum("kj,kj->k", point - start, ways) for point in (step.start, step.end)], axis=1
    )
    own = np.sort(np.clip(on_own / own_square, 0, 1), axis=1)
    theirs = np.sort(np.clip(on_theirs / squares[:, None], 0, 1), axis=1)

    middle = step.start + own.mean(axis=1)[:, None] * own_way
    opposite = start + theirs.mean(axis=1)[:, None] * ways
    gap = np.linalg.norm(middle - opposite, axis=1)
    # Of two chords of one curve the longer is farther from it: by L^2 / 8r, and a circle seen
    # from 60 degrees above has half the radius of its distance.
    bow = np.maximum(squares, own_square) / (4 * step.distance)
    near = gap <= _ASIDE * step.distance + bow
    near &= np.abs(ways @ own_way) >= _ALONG * np.sqrt(own_square * squares)
    near &= (np.diff(own, axis=1) > 0)[:, 0] & (np.diff(theirs, axis=1) > 0)[:, 0]
    return Overlap(np.where(near[:, None], own, 0.0), np.where(near[:, None], theirs, 0.0))


def whole(parts: Array) -> bool:
    """Whether parts (k, 2) of a step, from 0 to 1, are all of it together."""
    at = (np.arange(_CELLS) + 0.5) / _CELLS
    covered = ((parts[:, :1] <= at) & (at <= parts[:, 1:])).any(axis=0)
    return bool(covered.mean() >= _WHOLE)
