"""Which voxels the views take to be occupied."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .cuts import cut_volume
from .evidence import Mask, SmallView
from .space import Grid, pixel_of

Array = NDArray[np.floating]

_BEHIND = 0.8  # chance that the ray of an empty voxel meets the object elsewhere
_WRONG = 0.04  # chance that a view is wrong about a pixel
_DOUBT = 0.7  # nats that a colour must speak for the object before it counts as such
_STIFFNESS = 0.6


def gather(
    grid: Grid, views: Sequence[SmallView], saying: Sequence[NDArray[np.float32]]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Nats of all views together that each voxel is occupied, and how many views see it.

    An empty voxel may lie before or behind the object, so colours of the object say little
    for a voxel, those of the backdrop much against it; but any view may be wrong
    (Franco and Boyer 2005, doi:10.1109/ICCV.2005.105).
    """
    points = grid.centres()
    total = np.zeros(len(points), np.float32)
    seen = np.zeros(len(points), np.int32)
    for view, nats in zip(views, saying, strict=True):
        index, inside = pixel_of(view.camera, points)
        inside &= view.picture.ravel()[index]
        ratio = np.exp(_DOUBT - nats.ravel())
        vote = np.maximum(-np.log(_BEHIND + (1 - _BEHIND) * ratio), np.log(_WRONG))
        total += np.where(inside, vote.astype(np.float32)[index], np.float32(0))
        seen += inside
    return total.reshape(grid.shape), seen.reshape(grid.shape)


def occupied(grid: Grid, views: Sequence[SmallView], saying: Sequence[NDArray[np.float32]]) -> Mask:
    """(nx, ny, nz) the body that the views see."""
    evidence, seen = gather(grid, views, saying)
    evidence = np.where(seen >= 0.5 * len(views), evidence, -3.0)
    return cut_volume(evidence, _STIFFNESS)
