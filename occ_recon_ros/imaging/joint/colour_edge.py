"""How far beside the masks of a turn the colours of its images change."""

import numpy as np
from numpy.typing import NDArray

from .colours import COUNT, colour_bins, probability
from .regions import Mask

_BESIDE, _WIDE = 12, 2  # px about an outline where it is sought, and of the rings compared there
_TOLD = 0.2  # bits, that a pixel tells of the side of an edge it is on; shading tells less
_HERE = 0.75  # of the most, told by the outline of the mask: of right ones .83 and more
_AS_MUCH = 0.8  # of the most, where the edge is: it is broad where outlines are not drawn alike
_AWAY = 1.2  # px, from which on masks are beside it; right ones are within .6


class ColourEdge:
    """Colours of rings within and beyond the outlines of all masks of a turn.

    Across the outline of an object colours are others, whatever is printed on what is behind it;
    across that of a mask which is too large both sides show the backdrop.
    """

    def __init__(self) -> None:
        self._rings = np.zeros((2 * (_BESIDE + _WIDE), COUNT))

    def add(self, image: NDArray[np.uint8], away: NDArray[np.float32], picture: Mask) -> None:
        """Look at a view.

        Args:
            image: (h, w, 3) BGR, without noise.
            away: (h, w) px outwards from the outline of its mask.
            picture: (h, w) False on padding.
        """
        count = len(self._rings)
        ring = np.ceil(away).astype(np.intp) - 1 + count // 2
        at = picture & (ring >= 0) & (ring < count)
        places = ring[at] * COUNT + colour_bins(image)[at]
        self._rings += np.bincount(places, minlength=self._rings.size).reshape(count, COUNT)

    def join(self, other: "ColourEdge") -> None:
        """Take what another saw in other views."""
        self._rings += other._rings

    def off_px(self) -> float | None:
        """By how much that edge lies beyond the outlines, negative: within them, 0.0: along them;
        None where colours show none."""
        middles = np.arange(_WIDE, len(self._rings) - _WIDE + 1)
        told = np.array([self._told(int(k)) for k in middles])
        away = middles - len(self._rings) // 2
        most = told.max()
        if most < _TOLD:
            return None
        if told[away == 0][0] > _HERE * most:
            return 0.0
        edge = told > _AS_MUCH * most
        off = float(np.average(away[edge], weights=told[edge]))
        return off if abs(off) > _AWAY else 0.0

    def _told(self, k: int) -> float:
        """Bits that the colour of a pixel tells of whether it is in the rings before the k-th or
        in those from it on: the divergence of Jensen and Shannon."""
        sides = [self._rings[k - _WIDE : k].sum(axis=0), self._rings[k : k + _WIDE].sum(axis=0)]
        if not all(side.any() for side in sides):
            return 0.0
        within, beyond = (probability(side) for side in sides)
        both = (within + beyond) / 2
        return float(sum(p @ np.log2(p / both) for p in (within, beyond)) / 2)
