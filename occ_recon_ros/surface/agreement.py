"""Which silhouettes contradict the others, and by how much of them.

A ray inside a silhouette meets the object, so that somewhere along it there is a point that
every other view sees inside its own silhouette. Where all depths are refuted, somebody is
wrong: a few views that refute what the rest bear out are too small there (a bite, a hole, an
outline of something else); a ray that many refute is one that the view should not have (its
silhouette is too large, or its pose wrong). After the silhouette coherence of Hernandez, Schmitt
and Cipolla, IEEE PAMI 29(2), 2007, doi:10.1109/TPAMI.2007.42, with the blame shared out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours
from ..geometry.arrays import Array, Index, thinned
from .cone import Cone, cones_of, inside, middle_of

Mask = NDArray[np.bool_]

_RAYS = 400  # of each silhouette
_MANY, _FEWEST_RAYS = 48, 100  # of more views than this each has fewer, but for so many
_DEPTHS = 64
_REACH = 1.3  # radii of the object to either side of its middle, where depths are tried
_SLACK_PX = 2.0  # that a point may lie outside, beside half a step of the depth
_MINORITY = 0.2  # share of the views that may be wrong against the rest
_MOST_VIEWS = 60  # that a ray is held against
_WITNESSES = 4  # views that see best what a view refutes
_ROUNDS = 4
_BLOCK = 8  # depths that are asked for at once
_ONE_PLACE = 0.08  # of the size of a silhouette; poses off by 0.1 degrees or more spread wider
_DEEP = 0.5  # of how wide it is; a pose that loses one claw does not reach so far
_CLEARLY = 0.25  # of what masks with a part too many are refuted by, the others at most
_NAMED = 0.02  # share of a silhouette; right ones with poses off by a pixel stay below 0.01


@dataclass(frozen=True)
class Agreement:
    """How far each of n silhouettes agrees with the others.

    Attributes:
        refuted: (n,) float64, share of the silhouette's inside that most other views refute.
        refutes: (n,) float64, share of other silhouettes' insides that this view refutes
            against most of the rest, in the mean over the few views that see most of it.
        local: (n,) bool, whether what it is at odds over with the others lies at one place and
            is as deep as wide, as a bite is; what a wrong pose moves is a band along the outline.
    """

    refuted: Array
    refutes: Array
    local: Mask

    @property
    def share(self) -> Array:
        """(n,) by how much each view disagrees, the worse of the two."""
        return np.maximum(self.refuted, self.refutes)

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n,) which views disagree with the others by more than right ones do."""
        return self.share > _NAMED

    @property
    def too_large(self) -> NDArray[np.bool_]:
        """(n,) which hold more than the others bear out, by more than right ones do."""
        return self.refuted > _NAMED

    @property
    def too_small(self) -> NDArray[np.bool_]:
        """(n,) which lack what the others bear out, by more than right ones do."""
        return self.refutes > _NAMED

    @property
    def parted(self) -> bool:
        """Whether some hold a part that the others leave out, as a stand, and all else agrees: what
        poses are off by is lacking elsewhere, or spread over all views."""
        large = self.too_large
        if self.too_small.any() or not large.any() or large.all():
            return False
        return bool(self.refuted[~large].max() <= _CLEARLY * np.median(self.refuted[large]))


@dataclass(frozen=True)
class Comparison:
    """All silhouettes held against each other.

    Attributes:
        agreement: of each with the others.
        opposed: (n,) float64, share of the trusted views that refute what each sees where the
            fewest do, in the mean over its inside.
        witnesses: for each view, (m, 3) points that it refutes against most of the others, on
            rays of views that are trusted, metres.
        middle: (3,) the place that all look at.
        radius: of the object, about, metres.
    """

    agreement: Agreement
    opposed: Array
    witnesses: Mapping[int, Array]
    middle: Array
    radius: float

    def along(self, cone: Cone, T: Array, count: int) -> tuple[Array, Array]:
        """(n, count, 3) points through the object on rays T (n, 3) of a cone, of depth 1, and
        (count,) their depths, metres."""
        away = float(np.linalg.norm(self.middle - cone.centre))
        reach = min(_REACH * self.radius, 0.9 * away)
        depths = np.linspace(away - reach, away + reach, count)
        return cone.centre + T[:, None] * depths[None, :, None], depths


def silhouette_agreement(contours: Sequence[Contours]) -> Agreement:
    """Hold every silhouette against all others.

    Args:
        contours: at least three views with an outline, in one object frame.

    Raises:
        ValueError: fewer than three, or views that do not look at a common place.
    """
    return compare(cones_of(contours), len(contours)).agreement


def contradicted(own: Contours, others: Sequence[Contours]) -> float:
    """The share of a silhouette that others contradict, which are taken for right.

    Args:
        own: of a view that is not among the others.
        others: at least two views with an outline, in its object frame.

    Raises:
        ValueError: fewer, or views that do not look at a common place.
    """
    cones = cones_of([own, *thinned(others, _MOST_VIEWS - 1)])
    if len(cones) < 3 or 0 not in cones:
        raise ValueError("at least three views with an outline are needed to compare them")
    trusted = np.isin(np.arange(1 + max(cones)), [*cones][1:])
    middle, radius = middle_of(list(cones.values()))
    rays = {i: _inside(cone, _FEWEST_RAYS if i else _RAYS) for i, cone in cones.items()}
    return float(_compared(cones, rays, trusted, middle, radius).agreement.share[0])


def compare(cones: Mapping[int, Cone], n: int) -> Comparison:
    """Hold the cones of n views, those without an outline left out, against each other.

    Raises:
        ValueError: fewer than three cones.
    """
    if len(cones) < 3:
        raise ValueError("at least three views with an outline are needed to compare them")
    # So many views cost in proportion to their number.
    of_each = max(_FEWEST_RAYS, _RAYS * _MANY // max(_MANY, len(cones)))
    rays = {i: _inside(cone, of_each) for i, cone in cones.items()}
    middle, radius = middle_of(list(cones.values()))
    trusted = np.isin(np.arange(n), list(cones))
    for _ in range(_ROUNDS):
        found = _compared(cones, rays, trusted, middle, radius)
        # The worst go first: they make right ones seem wrong. Where more are wrong than may be,
        # every view is refuted, the wrong ones by more of the others than the right ones.
        doubtful = trusted & found.agreement.doubtful
        for told in (found.agreement.share, found.opposed):
            worst = doubtful & (told >= 0.5 * told[trusted].max(initial=0.0))
            if (trusted & ~worst).sum() >= max(2, 0.5 * len(cones)):
                break
        else:
            break
        if not worst.any():
            break
        trusted &= ~worst
    return found


def _compared(
    cones: Mapping[int, Cone],
    rays: Mapping[int, Array],
    trusted: NDArray[np.bool_],
    middle: Array,
    radius: float,
) -> Comparison:
    """Every silhouette held against those that are trusted, and what those say of it."""
    n = len(trusted)
    refuted, opposed, blame = np.ones(n), np.ones(n), np.zeros((n, n))
    beyond: dict[int, Array] = {}
    judges = np.array(thinned([*cones], _MOST_VIEWS))
    witnesses: dict[int, list[Array]] = {i: [np.zeros((0, 3))] for i in cones}
    local = np.zeros(n, np.bool_)
    result = Comparison(Agreement(refuted, refuted, local), opposed, {}, middle, radius)
    for i, T in rays.items():
        if not len(T):
            continue
        cone, others = cones[i], judges[judges != i]
        away = float(np.linalg.norm(middle - cone.centre))
        points, depths = result.along(cone, T, _DEPTHS)
        slack = 0.5 * (depths[1] - depths[0]) + _SLACK_PX * cone.pixel * away
        sure = trusted[others]
        best, against = _least_refuted(points, [cones[j] for j in others], sure, slack)
        count = against[sure].sum(axis=0)
        few = count <= max(1.0, _MINORITY * sure.sum())
        refuted[i], beyond[i] = float(np.mean(~few)), cone.centre + T[~few]
        opposed[i] = float(np.mean(count)) / max(1, int(sure.sum()))
        if trusted[i]:
            blame[i, others] = against[:, few].sum(axis=1) / len(T)
            at = points[np.arange(len(T)), best]
            for j, lacks in zip(others.tolist(), against & few, strict=True):
                witnesses[j].append(at[lacks])
    refutes = np.sort(blame, axis=0)[-_WITNESSES:].mean(axis=0)
    borne_out = {i: np.concatenate(parts) for i, parts in witnesses.items()}
    for i in beyond:
        local[i] = _local(cones[i], (beyond if refuted[i] > refutes[i] else borne_out)[i])
    return replace(result, agreement=Agreement(refuted, refutes, local), witnesses=borne_out)


def _local(cone: Cone, points: Array) -> bool:
    """Whether points (m, 3) are at one place in a silhouette's image, and far from its outline."""
    if not len(points):
        return False
    at = cone.pixels_of(points)
    spread = float(np.median(np.linalg.norm(at - np.median(at, axis=0), axis=1)))
    a_pixel = np.linalg.norm(points - cone.centre, axis=1) * cone.pixel
    away = np.abs(cone.outside(points)) / a_pixel
    size = 2 * cone.radius / cone.pixel
    return spread < _ONE_PLACE * size and float(np.percentile(away, 75)) > _DEEP * spread


def _least_refuted(
    along: Array, others: Sequence[Cone], sure: Mask, slack: float
) -> tuple[Index, Mask]:
    """The depth of each ray that the fewest views refute, of those that are trusted first.

    Args:
        along: (rays, depths, 3) points along the rays.
        others: v views.
        sure: (v,) which of them are trusted.
        slack: metres that a point may be outside.

    Returns:
        (rays,) the depth's number, the first of several; (v, rays) which views refute it.
    """
    rays, depths, _ = along.shape
    best, todo = np.full(rays, depths), np.arange(rays)
    # Most rays have a depth that none refutes, and beyond the first no other is asked for.
    for first in range(0, depths, _BLOCK):
        fit = inside(along[todo, first : first + _BLOCK], others, slack)
        some = fit.any(axis=1)
        best[todo[some]] = first + fit[some].argmax(axis=1)
        todo = todo[~some]
    refuting = np.zeros((len(others), rays), bool)
    rest = np.flatnonzero(best == depths)
    if len(rest):
        those = along[rest].reshape(-1, 3)
        against = np.stack([cone.outside(those) > slack for cone in others])
        against = against.reshape(len(others), len(rest), depths)
        doubt = against[sure].sum(axis=0) * (len(others) + 1) + against[~sure].sum(axis=0)
        best[rest] = np.argmin(doubt, axis=1)
        refuting[:, rest] = against[:, np.arange(len(rest)), best[rest]]
    return best, refuting


def _inside(cone: Cone, count: int) -> Array:
    """(m, 3) viewing directions, of depth 1, evenly spread over the inside of a silhouette."""
    rows, columns = np.nonzero((cone.image < -_SLACK_PX) & ~cone.unknown)
    picked = np.random.default_rng(0).permutation(len(rows))[:count]
    return cone.rays(rows[picked], columns[picked])
