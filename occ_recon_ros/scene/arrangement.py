"""The outline of a solid out of the images of its rims.

Crossing a rim's image towards the object adds two layers of surface to a viewing ray. So
with every rim walked with the object on its left, the winding number of a pixel counts
its pairs of layers, and the outline is where the winding number just right of a rim is 0.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from occ_recon_ros.geometry.arrays import Array

Rows = NDArray[np.intp]

_ASIDE_PX = 1e-4


@dataclass(frozen=True)
class Arc:
    """A piece of a closed curve between two crossings, or the whole of it.

    Attributes:
        curve: number of the curve.
        start, stop: positions along the curve, in nodes and fractions; start < stop,
            which may exceed the curve's number of nodes.
    """

    curve: int
    start: float
    stop: float


def outline(curves: list[Array]) -> list[list[Arc]]:
    """The loops that bound the union of what some closed curves enclose.

    Args:
        curves: one (n, 2) float64 polygon a rim, pixels, at most a few pixels a side,
            walked with the object on the left as displayed (v down).

    Returns:
        One list of arcs a loop, in the order and sense of walking. Consecutive arcs meet
        at crossings of two curves; a loop of one whole curve is one arc.
    """
    segments = _Segments(curves)
    first, second, along_first, along_second = segments.crossings()
    # Each crossing is one place on each of two curves.
    place = np.concatenate([first + along_first, second + along_second])
    crossing = np.tile(np.arange(len(first)), 2)
    arcs: list[tuple[Arc, int, int]] = []
    for number, (low, high) in enumerate(pairwise(segments.starts)):
        here = np.flatnonzero((place >= low) & (place < high))
        here = here[np.argsort(place[here])]
        cuts, at, count = place[here] - low, crossing[here], high - low
        if not len(cuts):
            arcs.append((Arc(number, 0.0, float(count)), -1, -1))
            continue
        stops, to = np.append(cuts[1:], cuts[0] + count), np.roll(at, -1)
        arcs += [
            (Arc(number, float(a), float(b)), int(p), int(q))
            for a, b, p, q in zip(cuts, stops, at, to, strict=True)
        ]
    free = segments.winding(np.array([segments.right_of(arc) for arc, _, _ in arcs]))
    return _chained([arc for arc, w in zip(arcs, free, strict=True) if w == 0])


def _chained(arcs: list[tuple[Arc, int, int]]) -> list[list[Arc]]:
    """Join arcs that end where another begins into loops."""
    loops = [[arc] for arc, start, _ in arcs if start < 0]
    # Two arcs leave a place where loops touch without crossing; either may go first.
    leaving: dict[int, list[tuple[Arc, int]]] = {}
    for arc, start, stop in arcs:
        if start >= 0:
            leaving.setdefault(start, []).append((arc, stop))
    for begin in list(leaving):
        while leaving[begin]:
            loop, here = [], begin
            while leaving.get(here):
                arc, here = leaving[here].pop()
                loop.append(arc)
            loops.append(loop)
    return loops


class _Segments:
    """All sides of all curves, numbered through."""

    def __init__(self, curves: list[Array]) -> None:
        self.starts: Rows = np.cumsum([0] + [len(curve) for curve in curves])
        self.a = np.concatenate([np.zeros((0, 2)), *curves])
        self.b = np.concatenate([np.zeros((0, 2)), *(np.roll(c, -1, 0) for c in curves)])
        turned = [np.roll(np.arange(low, high), -1) for low, high in pairwise(self.starts)]
        self.next = np.concatenate([np.zeros(0, np.intp), *turned])

    def crossings(self) -> tuple[Rows, Rows, Array, Array]:
        """Pairs of sides that cross, and how far along each (0 to 1)."""
        if not len(self.a):
            none = np.zeros(0, np.intp)
            return none, none, np.zeros(0), np.zeros(0)
        reach = np.linalg.norm(self.b - self.a, axis=1).max()
        pairs = cKDTree(0.5 * (self.a + self.b)).query_pairs(reach, output_type="ndarray")
        i, j = pairs.T
        apart = (self.next[i] != j) & (self.next[j] != i)
        i, j = i[apart], j[apart]
        d, e, across = self.b[i] - self.a[i], self.b[j] - self.a[j], self.a[j] - self.a[i]
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = _cross(d, e)
            s, t = _cross(across, e) / turn, _cross(across, d) / turn
        hit = (s >= 0) & (s < 1) & (t >= 0) & (t < 1)
        return i[hit], j[hit], s[hit], t[hit]

    def right_of(self, arc: Arc) -> Array:
        """A point just right of the middle of an arc, as displayed."""
        low, high = self.starts[arc.curve], self.starts[arc.curve + 1]
        whole, part = divmod(0.5 * (arc.start + arc.stop), 1.0)
        if np.floor(arc.start) != np.floor(arc.stop) and arc.stop - arc.start > 2:
            part = 0.5
        row = low + int(whole) % (high - low)
        d = self.b[row] - self.a[row]
        length = max(float(np.hypot(*d)), 1e-12)
        right = np.array([-d[1], d[0]]) / length
        middle: Array = self.a[row] + part * d + min(_ASIDE_PX, 1e-2 * length) * right
        return middle

    def winding(self, points: Array) -> Rows:
        """Winding numbers (n,) of points (n, 2): how often the object is entered."""
        result = np.zeros(len(points), np.intp)
        for k, (u, v) in enumerate(points):
            # Sides that a horizontal line to the left meets.
            up = (self.a[:, 1] > v) & (self.b[:, 1] <= v)
            down = (self.a[:, 1] <= v) & (self.b[:, 1] > v)
            rows = np.flatnonzero(up | down)
            a, b = self.a[rows], self.b[rows]
            at = a[:, 0] + (v - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
            left = rows[at < u]
            # Going down the screen has its left on the right-hand side of the image.
            result[k] = np.count_nonzero(down[left]) - np.count_nonzero(up[left])
        return result


def _cross(p: Array, q: Array) -> Array:
    product: Array = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    return product
