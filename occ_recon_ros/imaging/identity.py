"""Which loop of this image is which loop of the last one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from .curves import perimeter, signed_area

Array = NDArray[np.floating]

_IDS = 65536


class Identities:
    """Numbers loops, and keeps the number of a loop while it is seen image after image."""

    def __init__(self) -> None:
        self._last: dict[int, Array] = {}
        self._next = 0

    def name(self, loops: Sequence[Array]) -> tuple[list[int], list[str]]:
        """Identities of the loops of the next image.

        Args:
            loops: (n, 2) float64 arrays, px, object on the left as displayed.

        Returns:
            The identity (0-65535) of each loop, and sentences on loops that came or went.
        """
        first = not self._last
        matched = match_loops(list(self._last.values()), loops)
        old = list(self._last)
        names, said = [], []
        for i, loop in enumerate(loops):
            if i in matched:
                names.append(old[matched[i]])
                continue
            names.append(self._new())
            if not first:
                said.append(f"loop {names[-1]} appeared: {describe(loop)}")
        said += [f"loop {k} ended" for k in old if k not in names]
        self._last = dict(zip(names, loops, strict=True))
        return names, said

    def state(self) -> dict[str, Array]:
        """All that is remembered: loops by their identity, and the next one."""
        loops = {f"loop {name}": points for name, points in self._last.items()}
        return {"next loop": np.array(self._next), **loops}

    def restore(self, state: dict[str, Array]) -> None:
        """Go on from there."""
        self._next = int(state["next loop"])
        self._last = {int(k[5:]): v for k, v in state.items() if k.startswith("loop ")}

    def _new(self) -> int:
        while self._next in self._last:
            self._next = (self._next + 1) % _IDS
        taken, self._next = self._next, (self._next + 1) % _IDS
        return taken


def match_loops(old: Sequence[Array], new: Sequence[Array]) -> dict[int, int]:
    """The old loop for each new one that has one: of the same kind (outer or hole), near,
    and of like size. Keys index ``new``, values ``old``."""
    if not len(old) or not len(new):
        return {}
    cost = _unlike(new, old)
    if min(cost.shape) == 1:
        i, j = (int(k) for k in np.unravel_index(np.argmin(cost), cost.shape))
        return {i: j} if cost[i, j] < 1.0 else {}
    # Not by scipy.optimize, which takes every node a quarter of a second to load. All weights
    # above zero, for zero would be no edge; each pair adds the same.
    rows, columns = min_weight_full_bipartite_matching(csr_array(1.0 + np.minimum(cost, 1e6)))
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1.0}


def describe(loop: Array) -> str:
    """In words: outer loop or hole, and how long."""
    kind = "hole" if signed_area(loop) > 0 else "outer loop"
    return f"{kind}, {perimeter(loop):.0f} px around"


def _unlike(new: Sequence[Array], old: Sequence[Array]) -> Array:
    """(n, m) how far each of n loops is from being each of m, 1 at the limit; infinite where one
    is an outer loop and the other a hole."""
    (area, middle, size), (area_old, middle_old, size_old) = map(_measured, (new, old))
    reach = 0.5 * (size[:, None] + size_old)
    moved = np.abs(middle[:, None] - middle_old) / reach
    large, large_old = (np.log(np.maximum(np.abs(a), 1e-9)) for a in (area, area_old))
    grown = np.abs(large[:, None] - large_old)
    same_kind = area[:, None] * area_old > 0
    return np.where(same_kind, moved + 0.25 * grown, np.inf)


def _measured(loops: Sequence[Array]) -> tuple[Array, NDArray[np.complex128], Array]:
    """Of each loop its signed area, the middle of the box around it (x + iy), and its diagonal."""
    low, high = (np.array([side(loop, axis=0) for loop in loops]) for side in (np.min, np.max))
    middle, across = 0.5 * (low + high) @ (1, 1j), (high - low) @ (1, 1j)
    return np.array([signed_area(loop) for loop in loops]), middle, np.abs(across)
