"""Which voxels the views take to be occupied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from .carving import pared
from .cuts import cut_volume
from .each import each
from .regions import Mask
from .small_view import SmallView
from .space import Grid, pixel_of

Array = NDArray[np.floating]

_CELL = 1.2  # voxels that a cell of the raster is wide, so that none falls between them
_ELSEWHERE = 0.8  # chance that the ray of an empty voxel meets the object elsewhere
_WRONG = 0.04  # chance that a view is wrong about a pixel
_UNFILLED = 0.01  # the same of a ray that has not the object's colour
_ALONE = 0.25  # share of the voxels of a ray that speak for themselves, not as their neighbours
_SURE = 8.0  # nats, most that is believed of a voxel
_PASSES, _DAMPED = 6, 0.5  # passes over all rays, and the share of the last that each keeps
_DOUBT = 0.7  # nats that a colour must speak for the object before it counts as such
_STIFFNESS = 0.6
_MINORITY = 0.2  # of the views may be wrong about a voxel
_REFUTES, _OUTLIER = 0.15, 4.0  # share of the body that a wrong mask refutes, and times the usual
_ROUNDS = 4


@dataclass(frozen=True)
class Sight:
    """What one view says of the voxels, on a raster as coarse as they are.

    Attributes:
        index: (m,) int32, the cell of the raster on which each voxel falls, 0 where unseen.
        seen: (m,) bool, whether the view sees the voxel.
        against: (cells,) float32, how much likelier a cell looks as backdrop than as object.
        shape: rows and columns of the raster.
    """

    index: NDArray[np.int32]
    seen: NDArray[np.bool_]
    against: NDArray[np.float32]
    shape: tuple[int, int]

    def nats(self) -> NDArray[np.float32]:
        """(cells,) by which each cell speaks for the object."""
        return np.asarray(_DOUBT - np.log(self.against), np.float32)

    @staticmethod
    def of(
        grid: Grid,
        view: SmallView,
        nats: NDArray[np.float32],
        points: NDArray[np.float64] | None = None,
    ) -> Sight:
        """What a view says by its pixels' nats (h, w) for the object.

        Args:
            grid: of the voxels.
            view, nats: what it sees.
            points: (m, 3) centres of those voxels that are asked for, None: of all.
        """
        camera = view.camera
        middle = grid.low + 0.5 * grid.size * np.array(grid.shape)
        away = float((camera.R_camera_object @ middle + camera.t_camera_object)[2])
        cell = _CELL * grid.size * float(camera.K[0, 0]) / max(away, 1e-9)
        width = max(1, round(camera.width / max(cell, 1.0)))
        height = max(1, round(camera.height * width / camera.width))
        raster = camera.resized(width, height)
        index, seen = grid.pixels(raster) if points is None else pixel_of(raster, points)
        size = width, height
        coarse = cv2.resize(nats, size, interpolation=cv2.INTER_AREA)
        shown = cv2.resize(view.picture.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        seen &= (shown.ravel() > 0.5)[index]
        against = np.exp(_DOUBT - coarse.ravel() / np.maximum(shown.ravel(), 0.5))
        return Sight(index, seen, against.astype(np.float32), (height, width))

    def votes(self, empty: NDArray[np.float32] | None, solid: float) -> NDArray[np.float32]:
        """(m,) float32, nats by which the view speaks for each voxel.

        A cell shows backdrop only if every voxel on its ray is empty. So where others fill the
        ray, its colour says nothing of this one; where none else does, all.

        Args:
            empty: (m,) log of the chance that a voxel is empty; None: not known yet, and the
                ray of each is taken to be filled by others with one and the same chance.
            solid: chance that a ray is empty which others seem to fill, where it has the
                object's colour: so far each such ray speaks for all voxels on it.
        """
        if empty is None:
            table = -np.log(_ELSEWHERE + (1 - _ELSEWHERE) * self.against)
            vote = np.maximum(table, np.log(_WRONG)).astype(np.float32)[self.index]
        else:
            rays = np.bincount(self.index[self.seen], empty[self.seen], len(self.against)).astype(
                np.float32
            )
            free = np.take(rays, self.index) - empty
            np.exp(_ALONE * np.minimum(free, 0.0, out=free), out=free)
            least = np.where(self.against < 1, np.float32(solid), np.float32(_UNFILLED))
            vote = np.maximum(free, np.take(least, self.index), out=free)
            vote *= np.take(self.against - 1.0, self.index)
            vote += 1.0
            np.log(vote, out=vote)
            np.negative(vote, out=vote)
            np.clip(vote, np.log(_WRONG), -np.log(_WRONG), out=vote)
        vote[~self.seen] = 0.0
        return vote


def occupied(
    grid: Grid,
    views: Sequence[SmallView],
    saying: Sequence[NDArray[np.float32]],
    allowed: Mask,
    solid: float,
) -> tuple[Mask, NDArray[np.float32]]:
    """The body that the views see.

    Each voxel's chance to be occupied follows from what the pixels on which it falls look
    like and from the chances of all other voxels on their rays (Franco and Boyer 2005,
    doi:10.1109/ICCV.2005.105, with the rays' own state in place of a constant). A dark place on
    the object carves nothing where the ray must be filled anyway, and a lit outline outweighs
    a dark one.

    Args:
        grid: its voxels.
        views, saying: n views and what they say of their pixels (h, w).
        allowed: (nx, ny, nz) voxels that may be occupied.
        solid: as of ``Sight.votes``; the higher, the more views must see backdrop through a
            voxel: gaps close and dark places hold.

    Returns:
        (nx, ny, nz) the body, and (m,) float32 nats for each voxel.
    """
    sights = each(Sight.of, repeat(grid), views, saying)
    seen = np.sum([sight.seen for sight in sights], axis=0, dtype=np.int32)
    never = ~allowed.ravel() | (seen < 0.5 * len(views))
    total = np.sum(each(Sight.votes, sights, repeat(None), repeat(solid)), axis=0)
    for _ in range(_PASSES):
        total[never] = -_SURE
        empty = chance_empty(total)
        now = np.zeros_like(total)
        for vote in each(Sight.votes, sights, repeat(empty), repeat(solid)):
            now += vote
        total = _DAMPED * total + (1 - _DAMPED) * now
    total[never] = -_SURE
    body = cut_volume(total.reshape(grid.shape), _STIFFNESS) & allowed
    at = np.flatnonzero(body)
    if len(at):
        stay, _ = pared([replace(s, index=s.index[at], seen=s.seen[at]) for s in sights])
        body.ravel()[at[~stay]] = False
    return body, total


def finely_pared(
    grid: Grid, body: Mask, views: Sequence[SmallView], saying: Sequence[NDArray[np.float32]]
) -> tuple[Grid, Mask, list[Mask]]:
    """The body in voxels half as large, without what views see past.

    Args:
        grid, body: (nx, ny, nz) occupied voxels.
        views, saying: n views and what they say of their pixels (h, w).

    Returns:
        The finer grid, its occupied voxels, and of each view (h, w) where its outline looks as
        backdrop and yet others need what lies there.
    """
    nx, ny, nz = grid.shape
    fine = Grid(grid.low, 0.5 * grid.size, (2 * nx, 2 * ny, 2 * nz))
    solid = body.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)
    at = np.argwhere(solid)
    points = fine.low + fine.size * (at + 0.5)
    sights = each(Sight.of, repeat(fine), views, saying, repeat(points))
    stay, held = pared(sights)
    solid[tuple(at[~stay].T)] = False
    needed = [
        cv2.resize(h.astype(np.uint8), v.picture.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        for h, v in zip(held, views, strict=True)
    ]
    return fine, solid, needed


def chance_empty(total: NDArray[np.float32]) -> NDArray[np.float32]:
    """(m,) log of the chance that a voxel is empty, by the nats for it."""
    return np.asarray(-np.logaddexp(0.0, np.clip(total, -_SURE, _SURE)), np.float32)


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
