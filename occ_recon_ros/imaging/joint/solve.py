"""Masks of all views of a calibrated turn together.

The object is where all views look. Colours of object and backdrop are learnt over all
images, voxels gather what the views say, the body is projected back, and the models are
learnt again (Campbell, Vogiatzis, Hernandez, Cipolla 2010, doi:10.1016/j.imavis.2008.09.005).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ...geometry import Camera
from ..volume import Volume
from .barrier import barriers, speaking
from .each import each
from .evidence import explained, likelihood, telling, with_less_alike
from .models import Models, learn
from .occupancy import finely_pared, occupied, trusted
from .plane import Ground, find_ground, ground_at, known_ground
from .regions import Mask, disc, grown, shrunk, square
from .small_view import SmallView, not_known
from .space import Array, Grid, convex_hull, fixation, pixel_of, shared_space, silhouettes

Nats = NDArray[np.float32]

_GRIDS = (48, 64, 72)  # voxels along the longest side, round by round
ROUNDS = len(_GRIDS)
_EDGES_FIRST = 0.3  # of what colours say, while they are learnt from edges
_FIRST_BALL = 0.25  # of the shared space, where the object's colours are looked for first
_BORDER = 12  # the backdrop's first: this share (1/n) of the picture along its border
_GUESSED = 3  # pixels about a mask that is only begun from, which may still be the object
_SMALLEST = 0.005  # parts of the body smaller than this share of the largest are left out
_IN_PICTURE = 0.5  # of the views show all of a part of the object
_FEW = 0.25  # of the views, that may show the backdrop where parts of an object join
_A_PART = 0.05  # of the largest part, from which on what they show so is the object
_USUAL = np.float32(-2.0)  # nats of what looks as usual, before the models are learnt
_EMPTY = np.float32(-8.0)  # nats of a voxel on a ray on which nothing lies
_THROUGH = np.float32(-3.0)  # nats of what is seen through a hole
_GIVEN = 3.0  # nats by which a given mask speaks
_MOSTLY_GIVEN = 0.5
_OVERHANG = 0.75  # of a known sheet's sides to either side: what stands on it may jut out by 0.25
_NEEDED = 1.0  # voxels about a place that others need, in which dark colours say nothing
_SAYS = 1.0  # nats from which a pixel's colour says something
ALIKE_OUTSIDE = 0.02  # the same along its outline
_ALIKE = (0.01, 0.15)  # least and most share of the object that looks as the backdrop
_BLACK = 64  # grey levels, up to which a backdrop is dark


class Trial(NamedTuple):
    """How the body is looked for.

    Attributes:
        solid: how much is taken to be filled, as ``occupied``.
        edged: rounds in which edges speak beside the colours (``barriers``), at most ``ROUNDS``.
        still: what looks the same in most views does not turn.
        shaded: the ground may be in shadow.
    """

    solid: float
    edged: int = 0
    still: bool = True
    shaded: bool = True


@dataclass(frozen=True)
class Solution:
    """The body, and what each view says.

    Attributes:
        grid, body: (nx, ny, nz) occupied voxels.
        total: (m,) nats by which all views speak for each voxel.
        solid: as of ``occupied``.
        models: colours.
        saying: of each view, (h, w) nats that a pixel is of the object, by its colour or its
            given mask.
        outlines: of each view, (h, w) float32, the body projected.
        outside: of each view, (h, w) bool, surely backdrop.
        footprint: pixels of the small images that a voxel covers.
        ground: the plane under the object.
        refuted: of each view, whether its given mask was left out.
        outlining: of each view, (h, w) as ``saying``, for where the body ends.
        blur: pixels of the small images by which ``outlines`` are unsure.
        in_shadow: share of the usual outline that ran through soft shadow, before that was cut off.
        holes: of each view, (h, w) where it sees the backdrop through the body; empty: nowhere.
    """

    grid: Grid
    body: Mask
    total: Nats
    solid: float
    models: Models
    saying: list[Nats]
    outlines: list[NDArray[np.float32]]
    outside: list[Mask]
    footprint: float
    ground: Ground | None
    refuted: list[bool]
    outlining: list[Nats]
    blur: float
    in_shadow: float = 0.0
    holes: Sequence[Mask] = ()


def solve(
    views: Sequence[SmallView],
    volume: Volume | None,
    how: Trial,
    sheet: tuple[float, float] | None = None,
    seek: Callable[[Sequence[SmallView], Array, float], Ground | None] = find_ground,
) -> Solution | None:
    """The body that the views see; None where they see none. ``sheet``: width and height of that of
    which views know what they show, None: there is none; ``seek``: finds the plane under the
    object, as ``find_ground``."""
    cameras = [view.camera for view in views]
    low, high = shared_space(cameras) if volume is None else volume.box(cameras)
    centre = fixation(cameras) if volume is None else 0.5 * (low + high)
    if volume is None and sheet is not None:
        volume, low, high = _over(sheet, low, high)
        centre = np.clip(centre, low, high)
    grid = Grid.around(low, high, _GRIDS[0])
    refuted = [not right for right in trusted(grid, views)]
    views = [replace(v, given=None) if r else v for v, r in zip(views, refuted, strict=True)]
    given = np.mean([view.given is not None for view in views]) >= _MOSTLY_GIVEN
    half = 0.5 * float((high - low).max())
    if sheet is not None:
        ground: Ground | None = known_ground(views, max(sheet))
    elif volume is not None and volume.kind == "plane":
        ground = ground_at(views, volume.centre, volume.axis, centre, half)
    else:
        ground = None if given else seek(views, centre, half)
    usual = explained(views, ground, how.still)
    inside, outside, around = _first_guess(views, grid, centre, volume, ground, usual)
    levels = each(barriers, views) if how.edged else []
    shown: list[Mask] | None = None
    alike = _ALIKE[0]
    found: Solution | None = None
    for k in range(len(_GRIDS)):
        mixed = None if k or given else around
        models = learn(views, inside, outside, shown, ground, mixed, alike, how.shaded)
        saying = each(_said, views, repeat(models), range(len(views)), outside)
        if k < how.edged:
            last = k + 1 == ROUNDS  # by then the colours are learnt
            heard = 1.0 if how.edged < ROUNDS or last else _EDGES_FIRST
            spoken = speaking(
                levels, inside, [o & v.picture for o, v in zip(outside, views, strict=True)]
            )
            saying = [
                nats if view.given is not None else np.where(view.picture, heard * nats + more, 0.0)
                for view, nats, more in zip(views, saying, spoken, strict=True)
            ]
        if k == 0:
            saying = [
                np.where(look & (view.given is None), np.minimum(nats, _USUAL), nats)
                for view, look, nats in zip(views, usual, saying, strict=True)
            ]
        body, total = occupied(grid, views, saying, _allowed(grid, volume, ground), how.solid)
        body = looked_at(grid, largest(body), cameras)
        if not body.any():
            return None
        outlines = silhouettes(grid, body, cameras)
        footprint = _footprint(grid, body, cameras)
        found = Solution(
            grid,
            body,
            total,
            how.solid,
            models,
            saying,
            outlines,
            outside,
            footprint,
            ground,
            refuted,
            [with_less_alike(nats, models.alike, ALIKE_OUTSIDE) for nats in saying],
            footprint,
        )
        inside, outside, shown, alike = _looked_at_anew(views, found)
        if k + 1 < len(_GRIDS):
            grid = Grid.around(*grid.box_of(body, 3 if k == 0 else 2), _GRIDS[k + 1])
    return None if found is None else _finer(views, found)


def _over(sheet: tuple[float, float], low: Array, high: Array) -> tuple[Volume, Array, Array]:
    """What of a box lies over a sheet about the origin, and its lowest and highest corner."""
    reach = np.array([*(_OVERHANG * np.array(sheet)), np.inf])
    low, high = np.maximum(low, -reach), np.minimum(high, reach)
    if not (low < high).all():
        raise ValueError("the views do not look at the board")
    return Volume("box", 0.5 * (low + high), high - low), low, high


def cut_back(
    views: Sequence[SmallView], found: Solution, backdrop: Sequence[Mask]
) -> Solution | None:
    """The body without what only pixels bear that are now known to be of the backdrop (of each
    view, (h, w)); None where nothing is left."""
    saying, outlining = (
        [np.where(b, np.minimum(n, _USUAL), n) for b, n in zip(backdrop, nats, strict=True)]
        for nats in (found.saying, found.outlining)
    )
    body, total = occupied(found.grid, views, saying, found.body, found.solid)
    body = largest(body)
    if not body.any():
        return None
    return _finer(
        views,
        replace(
            found,
            body=body,
            total=total,
            saying=saying,
            outlining=outlining,
            blur=found.footprint,
        ),
    )


def pierced(views: Sequence[SmallView], found: Solution, holes: Sequence[Mask]) -> Solution:
    """The body without what lies on rays on which it is now known that nothing does (of each view,
    (h, w))."""
    at = np.argwhere(found.body)
    points = found.grid.low + found.grid.size * (at + 0.5)
    gone = np.zeros(len(at), np.bool_)
    for view, hole in zip(views, holes, strict=True):
        pixels, inside = pixel_of(view.camera, points)
        gone |= inside & hole.ravel()[pixels]
    body, total = found.body.copy(), found.total.reshape(found.grid.shape).copy()
    body[tuple(at[gone].T)] = False
    total[tuple(at[gone].T)] = _EMPTY
    body = largest(body)
    if not body.any():
        return found
    saying, outlining = (
        [np.where(b, np.minimum(n, _THROUGH), n) for b, n in zip(holes, nats, strict=True)]
        for nats in (found.saying, found.outlining)
    )
    found = replace(found, body=body, total=total.ravel(), saying=saying, outlining=outlining)
    return _finer(views, replace(found, blur=found.footprint, holes=holes))


def joined(views: Sequence[SmallView], found: Solution) -> Solution | None:
    """The body with what lies between its parts and hardly any view clearly shows to be empty, for
    an object is of one piece, and what joins its parts may look as the backdrop does; None where it
    has one part, or views see past all that may join them."""
    _, count = label(found.body)
    if count < 2:
        return None
    free = np.argwhere(convex_hull(found.body) & ~found.body)
    points = found.grid.low + found.grid.size * (free + 0.5)
    against, seen = np.zeros(len(free)), np.zeros(len(free))
    for view, nats in zip(views, found.saying, strict=True):
        pixels, inside = pixel_of(view.camera, points)
        seen += inside
        against += inside & (nats.ravel()[pixels] < -_SAYS)
    body = found.body.copy()
    body[tuple(free[against <= _FEW * seen].T)] = True
    body = largest(body)
    if label(body)[1] >= count:
        return None
    return _finer(views, replace(found, body=body, blur=found.footprint))


def _finer(views: Sequence[SmallView], found: Solution) -> Solution:
    """The outlines of the body in finer voxels."""
    fine, body, needed = finely_pared(found.grid, found.body, views, found.saying)
    if not body.any():
        return found
    outlines = silhouettes(fine, body, [view.camera for view in views])
    around = disc(2 * round(_NEEDED * found.footprint) + 1)
    outlining = []
    for nats, here, outline in zip(found.outlining, needed, outlines, strict=True):
        # What others need is of the object, however dark it looks here; but the body is as thick
        # as its voxels, and beside a lit edge that is all they need.
        dark = ~grown(nats > _SAYS, around)
        void = grown(here & dark, around) & (outline > 0.5) & dark
        outlining.append(np.where(void, np.maximum(nats, 0), nats).astype(np.float32))
    return replace(found, outlines=outlines, outlining=outlining, blur=0.5 * found.footprint)


def _first_guess(
    views: Sequence[SmallView],
    grid: Grid,
    centre: NDArray,
    volume: Volume | None,
    ground: Ground | None,
    usual: list[Mask],
) -> tuple[list[Mask], list[Mask], list[Mask]]:
    """Where to learn the object's and the backdrop's colours before anything is known, and
    the backdrop near the object."""
    extent = np.array(grid.shape) * grid.size
    near = np.linalg.norm(grid.centres() - centre, axis=1) < _FIRST_BALL * extent.min()
    start = near.reshape(grid.shape) & _allowed(grid, volume, ground)
    balls = silhouettes(grid, start, [view.camera for view in views])
    inside, outside, around = [], [], []
    for view, look, drawn in zip(views, usual, balls, strict=True):
        if view.given is not None:
            inside.append(view.given)
            outside.append(~view.given & view.picture)
            around.append(outside[-1])
            continue
        if view.guess is not None:
            inside.append(shrunk(view.guess, square(3)) & view.picture)
            outside.append(~grown(view.guess, square(3), _GUESSED) & view.picture)
            around.append(outside[-1])
            continue
        ball = drawn > 0.5
        wide = max(2, min(view.picture.shape) // _BORDER)
        rim = view.picture & ~shrunk(view.picture, square(3), wide, goes_on=False)
        inside.append(ball & ~look & view.picture & ~rim & telling(view))
        outside.append((rim & ~ball) | look)
        around.append(ball & look & not_known(view))
    return inside, outside, around


def _allowed(grid: Grid, volume: Volume | None, ground: Ground | None) -> Mask:
    """(nx, ny, nz) voxels that may be occupied: within the scan volume, above the ground."""
    points = grid.centres()
    allowed = np.ones(len(points), np.bool_)
    if volume is not None:
        allowed &= volume.contains(points)
    if ground is not None:
        allowed &= ground.above(points)
    return allowed.reshape(grid.shape)


def _said(view: SmallView, models: Models, k: int, outside: Mask) -> Nats:
    if view.given is not None:
        return np.where(view.given, _GIVEN, -_GIVEN).astype(np.float32)
    return likelihood(view, models, k, outside)


def largest(body: Mask) -> Mask:
    """The body without specks."""
    parts, count = label(body)
    if count <= 1:
        return body
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.isin(parts, np.flatnonzero(sizes > _SMALLEST * sizes.max()))


def looked_at(grid: Grid, body: Mask, cameras: Sequence[Camera]) -> Mask:
    """The body without what else stands in the room, around which the camera is carried: who
    photographs an object has it in the picture, and other things where they happen to be."""
    parts, count = label(body)
    if count <= 1:
        return body
    at = np.argwhere(body)
    points = grid.low + grid.size * (at + 0.5)
    part = parts[body] - 1
    sizes = np.bincount(part)
    whole = np.zeros(count)
    for camera in cameras:
        _, inside = pixel_of(camera, points)
        whole += np.bincount(part[~inside], minlength=count) == 0
    out = whole < _IN_PICTURE * len(cameras)
    if sizes[~out].sum() < _A_PART * sizes.max():
        return body
    return np.asarray(body & ~np.isin(parts, 1 + np.flatnonzero(out)))


def _footprint(grid: Grid, body: Mask, cameras: Sequence) -> float:
    middle = grid.low + grid.size * (np.argwhere(body).mean(axis=0) + 0.5)
    away = [float((c.R_camera_object @ middle + c.t_camera_object)[2]) for c in cameras]
    sizes = [grid.size * c.K[0, 0] / max(z, 1e-9) for c, z in zip(cameras, away, strict=True)]
    return float(np.median(sizes))


def _looked_at_anew(
    views: Sequence[SmallView], found: Solution
) -> tuple[list[Mask], list[Mask], list[Mask], float]:
    """Where the object and the backdrop are seen, what of the backdrop is not hidden, and
    the share of the object that looks as the backdrop."""
    near = disc(2 * found.footprint)
    inside, outside, shown = [], [], []
    alike, count, lost = 0, 1, 0
    light = []
    for view, outline, nats in zip(views, found.outlines, found.saying, strict=True):
        covered = outline > 0.5
        around, core = grown(covered, near), shrunk(covered, near) & view.picture
        like = core & (nats < -_SAYS)
        alike, count = alike + int(np.count_nonzero(like)), count + int(np.count_nonzero(core))
        inside.append(core & ~like)
        outside.append(~around & view.picture)
        light.append(float(np.median(view.image[outside[-1]])) if outside[-1].any() else 0.0)
        lost += int(np.count_nonzero(around & ~covered & (nats > _SAYS)))
        shown.append(view.picture & ~grown(around & (nats > _SAYS), square(5)))
    if np.median(light) < _BLACK:
        # What one view sees lit beyond the body, others took for the dark backdrop.
        alike, count = alike + lost, count + lost
    return inside, outside, shown, float(np.clip(alike / count, *_ALIKE))
