"""What a view shows as backdrop is taken off a body, unless others then lack what they see.

Voxels that lie behind one another hold each other up: where few views look past a hollow of the
outline, no voxel of what fills it is refuted by its own colours, for the others fill the ray. So
the body is pared from its outlines inwards, and asked whether it still explains all that is lit.
"""

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from .regions import Mask, disc, grown, of_border

_BACKDROP, _OBJECT = 1.0, 1.0  # nats from which on a cell shows either
_AROUND = 2.0  # cells, sigma of the part of an outline that is judged as one
_HELD = 0.03  # share of it that others need, from which on it stays
_CLOSE = 3  # cells about a place that others need that stay too
_LAYERS = 24  # most that is taken off, cells


class Sighting(Protocol):
    """What one view says of the voxels of a body, as ``occupancy.Sight``."""

    @property
    def index(self) -> NDArray[np.int32]:
        """(m,) the cell of its raster on which each voxel falls."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(m,) whether it sees the voxel."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the raster."""

    def nats(self) -> NDArray[np.float32]:
        """(cells,) by which each cell of the raster speaks for the object."""


def pared(sights: Sequence[Sighting]) -> tuple[Mask, list[Mask]]:
    """What of a body is left without what views see past, layer by layer.

    Args:
        sights: n views, of the m voxels of the body.

    Returns:
        (m,) the voxels that stay; of each view, (rows, columns) of its raster, the cells that look
        as backdrop along the outline and stay because other views need what lies there.
    """
    stay = np.ones(len(sights[0].index), np.bool_)
    nats = [sight.nats() for sight in sights]
    counts = [_count(sight, np.arange(len(stay))) for sight in sights]
    past = [n < -_BACKDROP for n in nats]
    lit = [n > _OBJECT for n in nats]
    held = [np.zeros(len(n), np.bool_) for n in nats]
    kept = list(held)
    near = disc(2 * _CLOSE + 1)
    cross = np.asarray(cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)), np.uint8)
    for _ in range(_LAYERS):
        changed = False
        for k, sight in enumerate(sights):
            covered = counts[k] > 0
            # Voxels are drawn with gaps; what they seem to leave open in the middle is none.
            open_ = of_border((~covered & past[k]).reshape(sight.shape))
            beside = grown(open_, cross).ravel()
            layer = covered & past[k] & beside & ~kept[k]
            if not layer.any():
                continue
            voxels = np.flatnonzero(stay & sight.seen & layer[sight.index])
            needed = np.zeros(len(layer), np.bool_)
            for j, other in enumerate(sights):
                if j != k:
                    some = voxels[other.seen[voxels]]
                    cells = other.index[some]
                    left = counts[j] - np.bincount(cells, minlength=len(counts[j]))
                    needed[sight.index[some[(lit[j] & (left == 0))[cells]]]] = True
            keeps = layer & (_share(needed, layer, sight.shape) > _HELD)
            held[k] |= keeps
            # No way leads between two places that others need into the dark side behind them.
            kept[k] = grown(held[k].reshape(sight.shape), near).ravel()
            gone = voxels[~keeps[sight.index[voxels]]]
            if len(gone):
                changed = True
                stay[gone] = False
                for j, other in enumerate(sights):
                    counts[j] -= _count(other, gone)
        if not changed:
            break
    return stay, [h.reshape(sight.shape) for h, sight in zip(held, sights, strict=True)]


def _count(sight: Sighting, voxels: NDArray[np.intp]) -> NDArray[np.int64]:
    """(cells,) how many of the voxels fall on each."""
    some = voxels[sight.seen[voxels]]
    return np.bincount(sight.index[some], minlength=int(np.prod(sight.shape)))


def _share(part: Mask, layer: Mask, shape: tuple[int, int]) -> NDArray[np.float32]:
    """(cells,) share of the layer about each cell that belongs to a part of it."""
    soft = [
        cv2.GaussianBlur(m.astype(np.float32).reshape(shape), (0, 0), _AROUND).ravel()
        for m in (part, layer)
    ]
    return np.asarray(soft[0] / np.maximum(soft[1], 1e-6), np.float32)
