"""What silhouettes say together: those that contradict the others are left out of carving, and
so are holes and bites that the others refute.

A silhouette that is too large never carves; one that is too small does, and one alone is
enough. Three kinds of it are told from the truth:

- a view that disagrees with the others by much (``agreement``) is left out;
- where single views refute what all others bear out, what they lack of the hull of the others
  is left open;
- a hole of a silhouette is believed if the hull of the other views is free along some of the
  rays through it: a true hole is seen through by more than one of many views, and where their
  rays cross nothing is left. One that no other sees through is believed where none of them
  shows a surface in it, if it is no mere needle (``tunnels``); a shadow that was taken for a
  hole leaves one, or a tunnel through what others see.

What a view of few pixels lacks within the slack, as by a pose off by a pixel, is not looked at.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ..geometry import Contours
from ..geometry.arrays import Array, Index
from .agreement import Agreement, Comparison, compare
from .cone import Cone, cones_of, inside
from .tunnels import holes_of, may_be

Mask = NDArray[np.bool_]

MOST_DOUBTFUL = 0.35  # of the views: with more of them the rest cannot be told from them
_WITNESSES = 3  # rays of other views that refute a bite, at least
_RAYS_ACROSS = 64  # a view that has a bite
_ROOM = 0.6  # of a silhouette's size about it, where it may lack something
_DEPTHS = 96
_SLACK_PX = 2.0
_RAYS_PER_HOLE = 150
_FREE = 0.1  # of the rays through a true hole, at least
_GROWN_PX = 3  # to either side of what is left open, where the outline ran


@dataclass(frozen=True)
class CarvingCones:
    """The cones that carve.

    Attributes:
        cones: of the views that do.
        left_out: indices into the views of those that contradict the others.
        mended: indices of views of which a hole or a bite is not believed.
        agreement: of all views with each other; None where there are too few to tell.
        undecided: so many views contradict each other that nobody can tell who is right; all
            of them carve.
    """

    cones: Sequence[Cone]
    left_out: tuple[int, ...] = ()
    mended: tuple[int, ...] = ()
    agreement: Agreement | None = None
    undecided: bool = False


def all_of(contours: Sequence[Contours]) -> CarvingCones:
    """All silhouettes as they are, whether they agree or not."""
    return CarvingCones([*cones_of(contours).values()])


def weigh(contours: Sequence[Contours]) -> CarvingCones:
    """Hold the silhouettes against each other.

    Args:
        contours: of all views, in one object frame.
    """
    cones = cones_of(contours)
    if len(cones) < 3:
        return CarvingCones([*cones.values()])
    found = compare(cones, len(contours))
    agreement = found.agreement
    doubtful = [i for i in cones if agreement.doubtful[i]]
    if len(doubtful) > MOST_DOUBTFUL * len(cones):
        return CarvingCones([*cones.values()], (), (), agreement, True)
    trusted = {i: cone for i, cone in cones.items() if i not in doubtful}
    mended = []
    # All are held against what they were, so that their order does not matter.
    opened = {i: _refuted(i, trusted, contours, found) for i in trusted}
    for i, (cone, region) in opened.items():
        if region.any():
            cone.leave_open(region)
            trusted[i] = cone
            mended.append(i)
    left_out = tuple(i for i in cones if i not in trusted)
    return CarvingCones([*trusted.values()], left_out, tuple(mended), agreement)


def _refuted(
    i: int, cones: Mapping[int, Cone], contours: Sequence[Contours], found: Comparison
) -> tuple[Cone, Mask]:
    """A view's cone, perhaps with more room about it, and where on its image others refute what is
    outside of the silhouette."""
    cone = cones[i]
    holes = np.zeros(cone.image.shape, bool)
    for rows, columns in holes_of(cone):
        true = _free(rows, columns, i, cones, found) or (
            cone.image[rows, columns].max() > _SLACK_PX
            and may_be(i, rows, columns, cones, contours, found)
        )
        holes[rows, columns] = not true
    witnesses = found.witnesses.get(i, np.zeros((0, 3)))
    if len(witnesses) < _WITNESSES:
        return cone, holes
    roomy = Cone(contours[i], room=_ROOM)
    step = -(-max(roomy.image.shape) // _RAYS_ACROSS)
    lacking = (roomy.image > _SLACK_PX) & ~roomy.unknown
    rows, columns = (
        k.ravel() for k in np.mgrid[: lacking.shape[0] : step, : lacking.shape[1] : step]
    )
    small = np.zeros(lacking[::step, ::step].shape, bool)
    ask = lacking[rows, columns]
    holding = _that_hold(witnesses, i, cones)
    small.ravel()[ask] = _blocked(i, roomy.rays(rows[ask], columns[ask]), holding, found)
    parts, count = label(small, np.ones((3, 3)))
    u, v = np.clip(np.rint(roomy.pixels_of(witnesses) / step), 0, np.array(small.shape[::-1]) - 1).T
    near = cv2.dilate(parts.astype(np.float32), np.ones((3, 3), np.uint8))
    hits = np.bincount(near[v.astype(int), u.astype(int)].astype(int), minlength=count + 1)
    bitten = [k for k in range(1, count + 1) if hits[k] >= _WITNESSES]
    region = _on(roomy, cone, holes)
    if bitten:
        bites = np.isin(parts, bitten).astype(np.uint8)
        bites = np.asarray(cv2.resize(bites, lacking.shape[::-1], interpolation=0), np.uint8)
        # Up to the silhouette: the rays nearest to it are up to a step away.
        reach = 2 * (step + _GROWN_PX) + 1
        region |= cv2.dilate(bites, np.ones((reach, reach), np.uint8)) > 0
    return roomy, region


def _that_hold(witnesses: Array, i: int, cones: Mapping[int, Cone]) -> dict[int, Cone]:
    """Those that hold (m, 3) witnesses against view i, and view i: of several masks that lack one
    leg, each would hide from the others that it is there."""

    def lacks(cone: Cone) -> bool:
        a_pixel = cone.pixel * np.linalg.norm(witnesses - cone.centre, axis=1)
        return bool((cone.outside(witnesses) > _SLACK_PX * a_pixel).sum() >= _WITNESSES)

    return {j: cone for j, cone in cones.items() if j == i or not lacks(cone)}


def _on(roomy: Cone, cone: Cone, region: Mask) -> Mask:
    """A region of a cone's image on the image with more room."""
    x, y = np.rint((cone.low - roomy.low) / roomy.pixel).astype(int)
    wide = np.zeros(roomy.image.shape, bool)
    wide[y : y + region.shape[0], x : x + region.shape[1]] = region
    return wide


def _free(
    rows: Index, columns: Index, i: int, cones: Mapping[int, Cone], found: Comparison
) -> bool:
    """Whether the hull of the other views is free along some of the rays through a hole."""
    picked = np.random.default_rng(0).permutation(len(rows))[:_RAYS_PER_HOLE]
    T = cones[i].rays(rows[picked], columns[picked])
    return bool(np.mean(_blocked(i, T, cones, found)) < 1 - _FREE)


def _blocked(i: int, T: Array, cones: Mapping[int, Cone], found: Comparison) -> Mask:
    """(n,) whether rays (n, 3) of a view, of depth 1, meet the hull of the others."""
    points, depths = found.along(cones[i], T, _DEPTHS)
    others = [cone for j, cone in cones.items() if j != i]
    return np.asarray(inside(points, others, 0.5 * (depths[1] - depths[0])).any(axis=1))
