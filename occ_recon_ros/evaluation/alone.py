"""Whether the views of a recording agree as they are, one by one."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.exposure import listed, numbered
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.joint.mask_edges import redrawn
from occ_recon_ros.streams.alone import DOUBT, MANY, MISPLACED, MOST_DOUBTFUL, ROUGH
from occ_recon_ros.streams.held import Flags, in_corrected_poses

from .single_views import Judged, Looked, judged_together, look_at_each
from .trimmed import LACKS, Trimmed, lacking, trimmed

Mask = NDArray[np.uint8]

_ON_EDGES = 0.5  # of the slope of the image along the sharper masks: so many lie on edges


@dataclass(frozen=True)
class Alone:
    """What each view says by itself: the mask that came with it, or its image.

    Attributes:
        masks: (h, w) uint8 coverage by stamp; views without an outline have none.
        doubts: sentences on what speaks against them, none where they agree.
        agreeing: of the masks, those to begin from; none where too many disagree.
        refuted: numbers of views that came with a mask which the others contradict, and why.
        torn: of these, those where that is at one place: no pose does so, whatever edges the object
            has there.
        misplaced: numbers of views whose mask is contradicted by much and yet lies on the edges
            of its image, as where the pose is wrong; and why.
        corrected: of a few such views, those that all others agree with where poses are corrected.
        contrary: numbers of views whose image has an outline that is contradicted by as much.
        cameras: by stamp, of images whose outlines agree where their poses or calibration are
            corrected, or with what moved in the middle of the scan taken back; empty where nothing
            is to be corrected.
        off_edges: sentences on masks that came and do not lie on the edges of their images.
        off_px: by how much these lie outside of them in all images, negative: inside; of those that
            are named in ``beside``, where there are any.
        beside: numbers of views whose masks alone do so.
        trimmed: by the number of the view, masks that came and hold more than the object, without
            that; where too many do to take the others as they are, these are among ``agreeing``.
        lacking: by the number of the view, of masks that came and leave out what those of most
            hold, how much of these it is; they are among ``misplaced``.
        bare: numbers of views that came without a mask, where others came with one.
        redrawn: by stamp, masks that lay beside the edges of their images, drawn there; empty where
            they do not.
    """

    masks: Mapping[int, Mask]
    doubts: tuple[str, ...]
    agreeing: Mapping[int, Mask]
    refuted: Mapping[int, str]
    misplaced: Mapping[int, str]
    contrary: frozenset[int] = frozenset()
    cameras: Mapping[int, Camera] = field(default_factory=dict)
    off_edges: Sequence[str] = ()
    off_px: float = 0.0
    beside: Collection[int] = ()
    torn: frozenset[int] = frozenset()
    corrected: Mapping[int, str] = field(default_factory=dict)
    trimmed: Mapping[int, Trimmed] = field(default_factory=dict)
    lacking: Mapping[int, float] = field(default_factory=dict)
    redrawn: Mapping[int, Mask] = field(default_factory=dict)
    bare: Sequence[int] = ()


def at_edges(views: BagViews, progress: Progress, to_correct: bool = True) -> Alone:
    """Each view alone, as ``each_alone``; where all masks that came, or some of them, lie beside
    the edges of their images by as much, with these drawn there, if nothing is beside them any
    more."""
    alone = each_alone(views, progress, to_correct=to_correct)
    if not alone.off_px:
        return alone
    known = views.changes
    doing(progress, "masks at the edges of their images")
    masks = {}
    for k, view in enumerate(views):
        progress(k + 1, len(views))
        if view.mask is not None:
            drawn = not alone.beside or k in alone.beside
            mask = redrawn(view.image, view.mask, alone.off_px) if drawn else view.mask
            masks[view.stamp_ns] = mask
    try:
        views.changes = known.then(Changes(masks=masks))
        again = each_alone(views, progress, to_correct=to_correct)
    finally:
        views.changes = known
    if again.off_edges:
        return alone
    return replace(again, off_edges=alone.off_edges, redrawn=masks)


def each_alone(
    views: BagViews,
    progress: Progress,
    settings: ContourSettings = ROUGH,
    to_correct: bool = True,
) -> Alone:
    """Segment each view, with these settings, and hold the outlines against each other.

    Where some images came with masks, those without are not looked at. Views whose poses are wrong
    are only kept where these are to be corrected.
    """
    looked = look_at_each(views, progress, settings)
    judged = judged_together(looked)
    weighed = _weighed(looked, judged, to_correct)
    doubts = _contradictions(looked, judged, weighed)
    by_body = "" if looked.masked else judged.held.doubt_of_hull or judged.held.doubt_of_holes
    if more := looked.by_image or by_body:
        doubts.append(more)
        weighed = replace(weighed, usable=False)
    alone = _parted(looked, judged, weighed, _sorted(looked, judged, weighed))
    if looked.edges.boxes():
        doubts, alone = looked.edges.doubts(), replace(alone, agreeing={}, refuted={})
    off_edges = looked.edges.doubts()
    off_px = 0.0 if looked.edges.boxes() else looked.edges.off_px()
    rows, off_in_some = looked.edges.off_in_some()
    beside = [looked.numbers[i] for i in rows]
    if beside:
        off_px, off_edges = off_in_some, [_beside(beside, off_in_some, views), *off_edges]
    return replace(
        alone,
        doubts=tuple(doubts),
        off_edges=off_edges,
        off_px=off_px,
        beside=beside,
        bare=looked.bare,
    )


def _beside(numbers: Sequence[int], off_px: float, views: BagViews) -> str:
    """That the masks of some views lie beside the edges of their images."""
    images = views.images()
    named = listed([numbered(k, images) for k in numbers])
    side = "outside" if off_px > 0 else "inside"
    what = f"the masks of {len(numbers)} views lie some {abs(off_px):.0f} px {side} of the edges"
    return f"{what} of their images, unlike the others (views {named})"


@dataclass(frozen=True)
class _Weighed:
    """What is wrong with the n outlines that others contradict.

    Attributes:
        wrong: (n,) the outline.
        misplaced: (n,) the pose, by much, as the mask lies on edges of its image.
        corrected: (n,) the same, and all agree in corrected poses.
        usable: whether enough agree to begin from these.
        moved: whether all agree in corrected poses, where some were far off.
    """

    wrong: Flags
    misplaced: Flags
    corrected: Flags
    usable: bool
    moved: bool


def _weighed(looked: Looked, judged: Judged, to_correct: bool) -> _Weighed:
    shares, count = judged.held.shares, len(looked.seen)
    right = _right(looked, judged)
    wrong, far_off = shares > DOUBT, right & (shares > MISPLACED)
    few, corrected = far_off.sum() <= MANY * count, np.zeros_like(wrong)
    asked = far_off.any() and (to_correct or not few)
    moved = bool(asked and in_corrected_poses(judged.held, looked.seen.cameras))
    if moved:
        # That all agree in corrected poses is no chance.
        corrected = far_off & few
        wrong &= ~right
        far_off = np.zeros_like(wrong)
    # In few views a mask that lies on edges may still lack a little.
    wrong &= ~right if wrong.sum() > MANY * count else ~far_off
    return _Weighed(wrong, far_off, corrected, judged.held.usable_without(wrong), moved)


def _right(looked: Looked, judged: Judged) -> Flags:
    """(n,) which masks came and lie on edges: they are right, and what contradicts one is a
    pose."""
    sharp = np.percentile([*looked.strength, 0.0], 75)
    right = looked.outlined & (np.array(looked.strength) > _ON_EDGES * sharp)
    # But poses move all of an outline, and what is missing of a mask, or stuck to it, is somewhere.
    contradicted = judged.held.wrong
    if (judged.held.local & contradicted).sum() > 0.5 * contradicted.sum():
        right &= ~judged.held.local
    return right


def _contradictions(looked: Looked, judged: Judged, weighed: _Weighed) -> list[str]:
    """What speaks against the outlines by the others, or as some are missing."""
    count, wrong = len(looked.seen), weighed.wrong
    agree = looked.masked and not wrong.any() and count == looked.wanted
    doubts = [] if agree else list(judged.verdict.reasons)
    if bare := len(looked.bare):
        doubts.append(f"{bare} of {looked.wanted + bare} images came without a mask")
    if wrong.any() and not len(judged.verdict.doubtful_views):
        doubts.append(f"{wrong.sum()} of {count} outlines leave a little of the object out")
    return doubts


def _sorted(looked: Looked, judged: Judged, weighed: _Weighed) -> Alone:
    """The views, by what is wrong with them."""
    masks, shares, wrong = looked.seen.masks, judged.held.shares, weighed.wrong
    by_image, by_mask = weighed.usable and not looked.masked, weighed.usable and looked.masked

    def numbered(flags: Flags) -> dict[int, int]:
        return {looked.numbers[i]: i for i in np.flatnonzero(flags).tolist()}

    def named(flags: Flags, words: Callable[[float], str]) -> dict[int, str]:
        return {number: words(shares[i]) for number, i in numbered(flags).items()}

    agreeing = {s: mask for (s, mask), bad in zip(masks.items(), wrong, strict=True) if not bad}
    doubtful = np.isin(np.arange(len(wrong)), judged.verdict.doubtful_views)
    # With more of them, nothing speaks for the masks.
    some = weighed.usable and weighed.misplaced.sum() <= MOST_DOUBTFUL * len(wrong)
    return Alone(
        masks=masks,
        doubts=(),
        agreeing=agreeing if weighed.usable else {},
        refuted=named(wrong & doubtful, _refuted) if by_mask else {},
        misplaced=named(weighed.misplaced, _misplaced) if some else {},
        contrary=frozenset(numbered(shares > MISPLACED) if by_image else ()),
        cameras=judged.cameras,
        torn=frozenset(numbered(wrong & judged.held.local) if by_mask else ()),
        corrected=named(weighed.corrected, _corrected),
    )


def _parted(looked: Looked, judged: Judged, weighed: _Weighed, alone: Alone) -> Alone:
    """Of masks some of which hold a part that the others leave out, those of fewer views without
    it, or, where they lack it, left out. What a stand does to a mask lies on edges, too."""
    doubtful = len(judged.verdict.doubtful_views) and not weighed.moved
    if not (looked.outlined and (weighed.wrong.any() or doubtful)):
        return alone
    seen, numbers = looked.seen, looked.numbers
    masks, stamps = seen.masks, [*seen.masks]
    # Of a few views the poses may be wrong instead.
    few = weighed.misplaced.sum() <= MANY * len(weighed.misplaced)
    cut = trimmed([*masks.values()], seen.contours, seen.cameras)
    cut = {i: row for i, row in cut.items() if not (few and numbers[i] in alone.misplaced)}
    if cut:
        begun = alone.agreeing if weighed.usable else masks
        own = {stamps[i]: row.mask for i, row in cut.items() if stamps[i] in begun}
        rows = {numbers[i]: row for i, row in cut.items()}
        left = {k: why for k, why in alone.misplaced.items() if k not in rows}
        return replace(alone, agreeing={**begun, **own}, misplaced=left, trimmed=rows)
    short = lacking(seen.contours)
    if not short:
        return alone
    shares = {numbers[i]: share for i, share in short.items()}
    out = {k: LACKS.format(share) for k, share in shares.items()}
    agreeing = {stamp: masks[stamp] for i, stamp in enumerate(stamps) if i not in short}
    misplaced = {**alone.misplaced, **out}
    return replace(alone, agreeing=agreeing, misplaced=misplaced, lacking=shares)


def _refuted(share: float) -> str:
    return f"its mask contradicts those of the others by {share:.0%}"


def _misplaced(share: float) -> str:
    return f"{_on_edges(share)}: left out; something is before the object, or its pose is wrong"


def _corrected(share: float) -> str:
    return f"{_on_edges(share)}, and nothing where its pose is corrected: its pose is wrong"


def _on_edges(share: float) -> str:
    return f"its mask lies on edges of its image, but {share:.0%} of it contradicts the others"
