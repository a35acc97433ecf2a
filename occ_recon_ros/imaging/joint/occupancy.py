"""Which voxels the views take to be occupied."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .cuts import cut_volume
from .evidence import Mask, SmallView
from .space import Grid

Array = NDArray[np.floating]

_BEHIND = 0.8  # chance that the ray of an empty voxel meets the object elsewhere
_WRONG = 0.04  # chance that a view is wrong about a pixel
_DOUBT = 0.7  # nats that a colour must speak for the object before it counts as such
_STIFFNESS = 0.6
_MINORITY = 0.2  # of the views may be wrong about a voxel
_REFUTES, _OUTLIER = 0.15, 4.0  # share of the body that a wrong mask refutes, and times the usual
_ROUNDS = 4


def votes(grid: Grid, view: SmallView, nats: NDArray[np.float32]) -> tuple[NDArray, NDArray]:
    """Nats by which one view speaks for each voxel (m,) float32, and whether it sees it (m,).

    An empty voxel may lie before or behind the object, so colours of the object say little
    for a voxel, those of the backdrop much against it; but any view may be wrong
    (Franco and Boyer 2005, doi:10.1109/ICCV.2005.105).
    """
    index, inside = grid.pixels(view.camera)
    inside &= view.picture.ravel()[index]
    ratio = np.exp(_DOUBT - nats.ravel())
    vote = np.maximum(-np.log(_BEHIND + (1 - _BEHIND) * ratio), np.log(_WRONG)).astype(np.float32)
    return np.where(inside, vote[index], np.float32(0)), inside


def _keep_worst(worst: NDArray[np.float16], vote: NDArray[np.float16]) -> None:
    """Put a vote (m,) among the lowest so far (k, m), sorted from the lowest."""
    for row in worst:
        lower = np.minimum(row, vote)
        np.maximum(row, vote, out=vote)
        row[:] = lower


def occupied(
    grid: Grid,
    views: Sequence[SmallView],
    saying: Sequence[NDArray[np.float32]],
    forgiven: float = 0.0,
) -> Mask:
    """(nx, ny, nz) the body that the views see.

    Args:
        grid: its voxels.
        views, saying: n views and what they say of their pixels (h, w).
        forgiven: share of the views that are passed over at each voxel, those that speak most
            against it: a crevice as dark as the backdrop lies in a few of them. Limbs grow fat
            and gaps close by it.
    """
    count = int(np.prod(grid.shape))
    total, seen = np.zeros(count, np.float32), np.zeros(count, np.int32)
    worst = np.zeros((round(forgiven * len(views)), count), np.float16)
    for view, nats in zip(views, saying, strict=True):
        vote, inside = votes(grid, view, nats)
        total += vote
        seen += inside
        _keep_worst(worst, vote.astype(np.float16))
    total -= worst.sum(axis=0, dtype=np.float32)
    total[seen < 0.5 * len(views)] = -3.0
    return cut_volume(total.reshape(grid.shape), _STIFFNESS)


def trusted(grid: Grid, views: Sequence[SmallView]) -> list[bool]:
    """Whether each view's given mask holds what most of the others bear out.

    The worst are left out first, for they make right ones seem wrong.
    """
    n = len(views)
    count = int(np.prod(grid.shape))
    against = np.zeros((n, count), np.bool_)
    seen = np.zeros(count, np.int32)
    for k, view in enumerate(views):
        if view.given is None:
            continue
        index, inside = grid.pixels(view.camera)
        against[k] = inside & ~view.given.ravel()[index]
        seen += inside
    given = np.array([view.given is not None for view in views])
    if not given.any():
        return [True] * n
    trust = given.copy()
    for _ in range(_ROUNDS):
        refuting = against[trust].sum(axis=0)
        body = (seen >= 0.5 * given.sum()) & (refuting <= _MINORITY * trust.sum())
        if not body.any():
            break
        refuted = against[:, body].mean(axis=1)
        wrong = trust & (refuted > max(_REFUTES, _OUTLIER * float(np.median(refuted[trust]))))
        wrong &= refuted >= 0.5 * refuted[trust].max()
        if not wrong.any() or (trust & ~wrong).sum() < 0.5 * given.sum():
            break
        trust &= ~wrong
    return list(trust | ~given)
