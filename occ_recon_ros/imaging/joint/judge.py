"""How far the masks of a turn are to be believed, view by view and as a whole."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from .about import FEW, EdgesAbout, edges_about
from .colours import histogram, probability
from .each import each
from .edges import MANY_STEPS, SOME_WITHOUT_EDGE
from .evidence import telling
from .occupancy import Sight, chance_empty
from .ramps import MUCH_IN_SHADOW
from .regions import Mask, disc, grown, opened, shrunk, square
from .room import SOME_ALONG_ROOM
from .small_view import SmallView
from .solve import Solution
from .space import Array, silhouette

STRANGE = "something is before or beside the object"
_SAYS = 1.0  # nats from which a pixel's colour says something
_LEAST_WRONG = 0.05  # share of the object, disagreement below this is none
_OUTLIER = 4.0  # times the usual disagreement of the views
GOOD_SUPPORT, _POOR_SUPPORT = 0.9, 0.5  # share of an outline that colours confirm
_GOOD_AGREEMENT, _POOR_AGREEMENT = 0.96, 0.75
_MUCH_WITHOUT_EDGE = 0.25  # share of an outline
_TOUCHES = 0.05  # share of an outline along the border of the picture
_CUT = 0.55  # of the belief, lost where this is so in all views: doubt, but no refusal
_EVERY = 0.5  # of the views
MUCH_BESIDE = 0.02  # share of a mask, of what edges enclose beside it
_BESIDE_IN = 0.7  # quantile over the views of that: in some views edges of what is lost leak
_BELIEF_BESIDE = 0.65  # then, as along an edge of the room or a soft shadow, a part may be wrong
_HANGS = 0.5  # of the height of a body, over the ground: a foot that is lost, or all below
_BOTTOM = 1  # percentile of the heights of its voxels
_SEEN_BY = 0.8  # quantile over the views of the share of a colour that counts as known
_COVERED = 0.02  # share of the object that something strange before it covers
_FROM = 0.2  # of that, what is seen of it beside the object
_MORE, _RARE = 6.0, 3e-4  # times the known share, and share of the picture, of a strange one


@dataclass(frozen=True)
class ViewReport:
    """What is made of one view.

    Attributes:
        agreement: 0 to 1, of what this view says by itself with the body that the other views
            see, by area, beyond the resolution of that body.
        support: 0 to 1, share of the outline with the object's colours on its one side and the
            backdrop's on the other.
        touches: share of the outline along the border of the picture.
        why: what is wrong with it, "" for a good view.
        beside: area beside the mask that edges enclose with it, as a share of the mask's.
        edgeless: share of the outline where the image shows no edge.
        covered: share of the object that shows colours of no other view, where it is named for
            that.
    """

    agreement: float
    support: float
    touches: float
    why: str
    beside: float = 0.0
    edgeless: float = 0.0
    covered: float = 0.0

    @property
    def bad(self) -> bool:
        """Whether the view is named as bad."""
        return bool(self.why)

    @property
    def disagrees(self) -> bool:
        """Whether its object has another shape, before nothing strange."""
        return self.bad and not self.covered


@dataclass(frozen=True)
class Judgement:
    """What is made of the masks of a turn.

    Attributes:
        views: each view's report.
        belief: in the whole, 0 to 1.
        doubts: sentences on what is doubtful.
        cut_short: whether images show edges beside the outlines, and their backdrops none
            elsewhere, as where a part of the object is lost.
    """

    views: Sequence[ViewReport]
    belief: float
    doubts: Sequence[str]
    cut_short: bool

    @property
    def agreement(self) -> float:
        """Of the usual view with the body that the others see, 0 to 1."""
        return _usual_agreement(self.views)


def judge(views: Sequence[SmallView], found: Solution, masks: Sequence[Mask]) -> Judgement:
    """How far the masks of views, of each (h, w), are to be believed."""
    held = _held_against_others(views, found, masks)
    about = edges_about(views, found, masks)
    reports = _reports(held, about, found.refuted)
    belief = _belief(reports, about, found.in_shadow)
    doubts = _doubts(reports, about, found.in_shadow)
    if (high := hanging(found)) > _HANGS:
        belief = min(belief, _BELIEF_BESIDE)
        words = (
            f"what was found hangs over the ground, {high:.1f} times its own height: its lower "
            "part looks as the backdrop does and is lost, or what carries it was left out"
        )
        doubts = [words, *doubts]
    return Judgement(reports, belief, doubts, about.steps > MANY_STEPS)


@dataclass(frozen=True)
class _Held:
    """What each view says by itself, held against the body that the others see; all (n,).

    Attributes:
        wrong: share of the object's area that it sees otherwise.
        support, touches: as ``ViewReport``.
        empty: whether nothing was found in it.
        strange: area of what no other view shows, as a share of the object's.
        covered: share of the object that this covers.
    """

    wrong: Array
    support: Array
    touches: Array
    empty: Array
    strange: Array
    covered: Array


def _held_against_others(
    views: Sequence[SmallView], found: Solution, masks: Sequence[Mask]
) -> _Held:
    empty_chance = repeat(chance_empty(found.total))
    seen_by_others = each(_others, views, found.saying, repeat(found), empty_chance)

    def held(
        view: SmallView, saying: NDArray, others: Mask, strange: Mask, mask: Mask
    ) -> tuple[float, float, float, bool, float, float]:
        wrong = _disagreement(view, saying, others, found.footprint)
        beside = _foreign(strange, others, found.footprint)
        return wrong, *outline_support(view, saying, mask), not mask.any(), *beside

    told = each(held, views, found.saying, seen_by_others, unusual(views), masks)
    wrong, support, touches, empty, strange, covered = map(np.array, zip(*told, strict=True))
    unknown = np.isnan(support)
    support[unknown] = 0.0 if unknown.all() else np.median(support[~unknown])
    return _Held(wrong, support, touches, empty, strange, covered)


def hanging(found: Solution) -> float:
    """How high a body hangs over the ground under it, of its own height; 0 where no ground is
    known."""
    if found.ground is None or not found.body.any():
        return 0.0
    points = found.grid.low + found.grid.size * (np.argwhere(found.body) + 0.5)
    plane = found.ground.plane
    heights = (points - plane.origin) @ plane.normal
    low, high = np.percentile(heights, [_BOTTOM, 100 - _BOTTOM])
    return float(low / max(high - low, found.grid.size))


def _reports(held: _Held, about: EdgesAbout, refuted: Sequence[bool]) -> list[ViewReport]:
    limit, foreign = (
        max(_LEAST_WRONG, _OUTLIER * float(np.median(shares)))
        for shares in (held.wrong, held.strange)
    )
    if np.mean(held.strange > foreign) > FEW:
        foreign = np.inf
    usual = float(np.median(held.support))

    def why(k: int) -> str:
        if held.empty[k]:
            return "no object in it"
        if refuted[k]:
            return "its mask contradicts those of the others"
        if held.strange[k] > foreign:
            share = f"{held.strange[k]:.0%} of the object's area"
            return f"{STRANGE} that no other view shows ({share})"
        if held.wrong[k] > limit:
            wrong = min(held.wrong[k], 1.0)
            return f"{wrong:.0%} of the object's area disagrees with the other views"
        if held.support[k] < 0.5 * usual:
            return f"only {held.support[k]:.0%} of the outline has the object's colours inside"
        return ""

    covered = np.where(held.strange > foreign, held.covered, 0.0)
    return [
        ViewReport(
            agreement=max(0.0, 1.0 - float(held.wrong[k])),
            support=float(held.support[k]),
            touches=float(held.touches[k]),
            why=why(k),
            beside=float(about.enclosed[k]),
            edgeless=float(about.edgeless[k]),
            covered=float(covered[k]),
        )
        for k in range(len(held.wrong))
    ]


def _belief(reports: Sequence[ViewReport], about: EdgesAbout, in_shadow: float) -> float:
    agreement = _usual_agreement(reports)
    support = float(np.median([r.support for r in reports]))
    lost = beside_of(reports) > MUCH_BESIDE or about.steps > MANY_STEPS
    in_part_wrong = lost or about.along > SOME_ALONG_ROOM or in_shadow > MUCH_IN_SHADOW
    return min(
        _between(agreement, _POOR_AGREEMENT, _GOOD_AGREEMENT),
        _between(support, _POOR_SUPPORT, GOOD_SUPPORT),
        _belief_in_edges(float(np.median(about.edgeless))),
        _BELIEF_BESIDE if in_part_wrong else 1.0,
        1.0 - _CUT * float(np.mean([r.touches > _TOUCHES for r in reports])),
        1.0 - float(np.mean([r.bad for r in reports])),
    )


def _usual_agreement(reports: Sequence[ViewReport]) -> float:
    return float(np.median([report.agreement for report in reports]))


def beside_of(reports: Sequence[ViewReport]) -> float:
    """Area that edges enclose beside masks, as a share of these, as most views have no more."""
    return float(np.quantile([report.beside for report in reports], _BESIDE_IN))


def agreement_of(views: Sequence[SmallView], found: Solution) -> float:
    """Of the usual view with the body that the others see, 0 to 1, as ``ViewReport`` has it."""
    others = each(_others, views, found.saying, repeat(found), repeat(chance_empty(found.total)))
    wrong = each(_disagreement, views, found.saying, others, repeat(found.footprint))
    return float(np.median([max(0.0, 1.0 - w) for w in wrong]))


def _others(view: SmallView, nats: NDArray, found: Solution, vacant: NDArray[np.float32]) -> Mask:
    """(h, w) the body that the other views see; ``vacant``: (m,) log of the chance that a voxel is
    empty."""
    vote = Sight.of(found.grid, view, nats).votes(vacant, found.solid)
    body = found.body & (found.total - vote > 0).reshape(found.grid.shape)
    return silhouette(found.grid, body if body.any() else found.body, view.camera) > 0.5


def _disagreement(view: SmallView, nats: NDArray, others: Mask, footprint: float) -> float:
    """Share of the object's area that this view by itself sees otherwise than the others."""
    area = max(1, int(np.count_nonzero(others)))
    near = _unsure(footprint)
    lacking = shrunk(others, near) & (nats < -_SAYS)
    beyond = grown(others, near, 4) & ~grown(others, near) & (nats > _SAYS)
    wrong = [opened(mask & view.picture, square(3)) for mask in (lacking, beyond)]
    return int(np.count_nonzero(wrong)) / area


def _unsure(footprint: float) -> NDArray[np.uint8]:
    """The shape within which the outline of the body is not known."""
    return disc(2 * round(1.5 * footprint) + 1)


def unusual(views: Sequence[SmallView]) -> list[Mask]:
    """Of each view, (h, w) the pixels of colours that hardly any other view shows."""
    shares = np.stack([probability(histogram(view.bins[view.picture])) for view in views])
    known = np.quantile(shares, _SEEN_BY, axis=0)
    return [
        (own > _MORE * known + _RARE)[view.bins] & view.picture
        for own, view in zip(shares, views, strict=True)
    ]


def _foreign(strange: Mask, others: Mask, footprint: float) -> tuple[float, float]:
    """Area of what no other view shows, on and about the object, as a share of the object's; and
    the share of the object itself that it covers.

    Nothing, where it lies beside the object alone: the room behind may look new in each view. Nor
    where it is hardly seen beside it: a side of the object may be seen in few views, but a hand
    comes from somewhere.
    """
    near = _unsure(footprint)
    whole = opened(strange & grown(others, near, 4), square(3))
    area = max(1, int(np.count_nonzero(others)))
    core = shrunk(others, near)
    hidden = int(np.count_nonzero(whole & core))
    beyond = int(np.count_nonzero(whole & ~grown(others, near)))
    if hidden < _COVERED * area or beyond < _FROM * hidden:
        return 0.0, 0.0
    return int(np.count_nonzero(whole)) / area, hidden / max(1, int(np.count_nonzero(core)))


def outline_support(view: SmallView, nats: NDArray, mask: Mask) -> tuple[float, float]:
    """Share of the outline that the colours on its two sides confirm, NaN where nothing beside it
    tells, and share of it that lies along the border of the picture."""
    if not mask.any():
        return 0.0, 0.0
    ring = square(5)
    edge = mask & ~shrunk(mask, square(3), goes_on=False)
    free = edge & shrunk(view.picture, ring, goes_on=False)
    touches = 1.0 - np.count_nonzero(free) / max(1, int(np.count_nonzero(edge)))
    # Beside the edges of a print that is known nothing can confirm.
    free &= grown(~mask & telling(view), ring)
    if not free.any():
        return np.nan, touches
    inside = cv2.dilate(np.where(mask, nats, -9).astype(np.float32), ring)
    outside = cv2.erode(np.where(mask, 9, nats).astype(np.float32), ring)
    confirmed = (inside[free] > 0.5) & (outside[free] < -0.5)
    return float(np.mean(confirmed)), float(touches)


def support_doubt(support: float) -> str:
    """The sentence on outlines of which colours confirm so much, 0 to 1; "" where it is enough."""
    if support >= GOOD_SUPPORT:
        return ""
    return (
        f"only {support:.0%} of the outlines lie between colours of the object and of the backdrop"
    )


def _doubts(reports: Sequence[ViewReport], about: EdgesAbout, in_shadow: float) -> list[str]:
    said = []
    bad = [k for k, r in enumerate(reports) if r.bad]
    if len(bad) > FEW * len(reports):
        said.append(f"{len(bad)} of {len(reports)} views disagree with the others")
    if np.mean([r.touches > _TOUCHES for r in reports]) > _EVERY:
        said.append("the object touches the border of the picture in most views")
    if unconfirmed := support_doubt(float(np.median([r.support for r in reports]))):
        said.append(unconfirmed)
    beside = beside_of(reports)
    if beside > MUCH_BESIDE:
        said.append(
            f"edges enclose {beside:.0%} more beside the outlines: a part of the object that looks "
            "as the backdrop may be lost, or a shadow or what it stands on ends as sharply"
        )
    if about.steps > MANY_STEPS:
        said.append(
            "the images show edges beside the outlines that the backdrop shows nowhere else: a "
            "part of the object that looks as the backdrop may be lost, or a shadow is hard"
        )
    if about.along > SOME_ALONG_ROOM:
        said.append(
            f"{about.along:.0%} of the outlines lie along an edge of the room that goes on beyond: "
            "the object may be cut there"
        )
    if in_shadow > MUCH_IN_SHADOW:
        said.append(
            f"{in_shadow:.0%} of the outlines run through the contact shadow, where the ground is "
            "dimmed on both sides, or did before it was cut off: some of it may be left, or a part "
            "of the object as grey as that be lost"
        )
    edgeless = float(np.median(about.edgeless))
    if edgeless > SOME_WITHOUT_EDGE:
        said.append(
            f"{edgeless:.0%} of the outlines lie where the images show no edge: shadows or what "
            "the object stands on may be taken for it, or dark parts of it be lost; a scan volume "
            "(volume_*) tells"
        )
    return said


def _belief_in_edges(edgeless: float) -> float:
    """Doubt, but never refusal: dark places of a right outline have no edge either."""
    if edgeless <= SOME_WITHOUT_EDGE:
        return 1.0
    return 0.45 + 0.25 * _between(-edgeless, -_MUCH_WITHOUT_EDGE, -SOME_WITHOUT_EDGE)


def _between(value: float, low: float, high: float) -> float:
    return float(np.clip((value - low) / (high - low), 0.0, 1.0))
