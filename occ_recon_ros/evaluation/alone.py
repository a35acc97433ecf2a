"""Whether the views of a recording agree as they are, one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.joint.edges import edge_strength
from occ_recon_ros.imaging.joint.mask_edges import MaskEdges, redrawn
from occ_recon_ros.poses.refine import event_between, refine
from occ_recon_ros.streams.alone import (
    DOUBT,
    MANY,
    MISPLACED,
    MOST_DOUBTFUL,
    ROUGH,
    Outlines,
)
from occ_recon_ros.surface.covering import doubt_of_hull

from .evidence import Evidence
from .findings import FAILED
from .trimmed import Trimmed, trimmed
from .verdict import Verdict, judge

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
        off_px: by how much these lie outside of them in all images, negative: inside.
        trimmed: by the number of the view, masks that came and hold more than the object, without
            that; where too many do to take the others as they are, these are among ``agreeing``.
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
    torn: frozenset[int] = frozenset()
    corrected: Mapping[int, str] = field(default_factory=dict)
    trimmed: Mapping[int, Trimmed] = field(default_factory=dict)
    redrawn: Mapping[int, Mask] = field(default_factory=dict)
    bare: Sequence[int] = ()


def at_edges(views: BagViews, progress: Progress, to_correct: bool = True) -> Alone:
    """Each view alone, as ``each_alone``; where all masks that came lie beside the edges of their
    images by as much, with these drawn there, if nothing is beside them any more."""
    alone = each_alone(views, progress, to_correct=to_correct)
    if not alone.off_px:
        return alone
    known = views.changes
    doing(progress, "masks at the edges of their images")
    masks = {}
    for k, view in enumerate(views):
        progress(k + 1, len(views))
        if view.mask is not None:
            masks[view.stamp_ns] = redrawn(view.image, view.mask, alone.off_px)
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
    masked, bare, whole = views.masked(), list[int](), 0
    seen = Outlines(settings)
    numbers: list[int] = []
    strength: list[float] = []
    edges = MaskEdges()
    for k, view in enumerate(views):
        progress(whole := k + 1, len(views))
        if masked and view.mask is None:
            bare.append(k)
        elif seen.add(view.image, view.camera, view.stamp_ns, view.mask):
            numbers.append(k)
            strength.append(0.0 if view.mask is None else edge_strength(view.image, view.mask))
            if view.mask is not None:
                edges.add(view.image, view.mask)
    # Of images that lack a pose no outline was sought.
    count, wanted = len(seen), whole - len(bare)
    # A mask that ends at the border of its image is no reason to look for another.
    sizes = [] if masked else [(camera.width, camera.height) for camera in seen.cameras]
    evidence = Evidence(seen.contours, sizes, wanted, good_share=1.0, bounded=True)
    verdict, cameras = judge(evidence), dict[int, Camera]()
    if not masked and (verdict.shares > DOUBT).sum() > MANY * count:
        evidence, verdict, cameras = _before_the_event(seen, evidence) or (evidence, verdict, {})
    little = (verdict.shares > DOUBT) & (verdict.shares <= MISPLACED)
    by_image = "" if masked else seen.doubt()
    if not masked and not by_image and little.sum() > MANY * count:
        again = _in_corrected_poses(seen, evidence)
        evidence, verdict, cameras = again or (evidence, verdict, cameras)
    shares = verdict.shares if len(verdict.shares) else np.zeros(count)
    # Masks that came and lie on edges are right, and what contradicts one is a pose.
    sharp = np.percentile([*strength, 0.0], 75)
    outlined = masked and not edges.boxes()
    right = np.array([outlined and own > _ON_EDGES * sharp for own in strength], np.bool_)
    # But poses move all of an outline, and what is missing of a mask, or stuck to it, is somewhere.
    local = verdict.local if len(verdict.local) else np.zeros(count, np.bool_)
    if np.count_nonzero(local & (shares > DOUBT)) > 0.5 * np.count_nonzero(shares > DOUBT):
        right &= ~local
    far = shares > MISPLACED
    far_off, wrong = right & far, shares > DOUBT
    corrected = dict[int, str]()
    some = to_correct or far_off.sum() > MANY * count
    if some and far_off.any() and _in_corrected_poses(seen, evidence):
        # That all agree in corrected poses is no chance.
        if far_off.sum() <= MANY * count:
            corrected = {numbers[i]: _corrected(shares[i]) for i in np.flatnonzero(far_off)}
        wrong &= ~right
        far_off[:] = False
    # In few views a mask that lies on edges may still lack a little.
    wrong &= ~right if wrong.sum() > MANY * count else ~far_off
    doubts = [] if masked and not wrong.any() and count == wanted else list(verdict.reasons)
    if bare:
        doubts.append(f"{len(bare)} of {whole} images came without a mask")
    if wrong.any() and not len(verdict.doubtful_views):
        doubts.append(f"{wrong.sum()} of {count} outlines leave a little of the object out")
    usable = verdict.word != FAILED and bool(wrong.sum() <= MOST_DOUBTFUL * count)
    if not masked:
        right_ones = [c for c, bad in zip(evidence.contours, wrong, strict=True) if not bad]
        more = by_image or (doubt_of_hull(right_ones) if usable else "")
        doubts += [more] if more else []
        usable &= not more
    agreeing, refuted, misplaced, contrary = {}, {}, {}, frozenset[int]()
    torn = frozenset[int]()
    if usable and not masked:
        contrary = frozenset(numbers[i] for i in np.flatnonzero(far))
    if usable:
        pairs = zip(seen.masks.items(), wrong, strict=True)
        agreeing = {stamp: mask for (stamp, mask), bad in pairs if not bad}
    if usable and masked:
        refuted = {
            numbers[i]: f"its mask contradicts those of the others by {shares[i]:.0%}"
            for i in verdict.doubtful_views
            if wrong[i]
        }
        torn = frozenset(numbers[i] for i in np.flatnonzero(wrong & local))
    if usable and far_off.sum() <= MOST_DOUBTFUL * count:  # else nothing speaks for the masks
        misplaced = {numbers[i]: _misplaced(shares[i]) for i in np.flatnonzero(far_off)}
    cut: Mapping[int, Trimmed] = {}
    if outlined and wrong.any():
        rows = trimmed(list(seen.masks.values()), seen.contours, seen.cameras)
        cut = {numbers[i]: row for i, row in rows.items()}
        if rows and not usable:
            stamps = [*seen.masks]
            agreeing = seen.masks | {stamps[i]: row.mask for i, row in rows.items()}
    if edges.boxes():
        doubts, agreeing, refuted = edges.doubts(), {}, {}
    return Alone(
        masks=seen.masks,
        doubts=tuple(doubts),
        agreeing=agreeing,
        refuted=refuted,
        misplaced=misplaced,
        contrary=contrary,
        cameras=cameras,
        off_edges=edges.doubts(),
        off_px=0.0 if edges.boxes() else edges.off_px(),
        torn=torn,
        corrected=corrected,
        trimmed=cut,
        bare=bare,
    )


_Judged = tuple[Evidence, Verdict, dict[int, Camera]]
"""Outlines as cameras see them, what is to be thought of them, and the cameras by stamp."""


def _seen_from(cameras: Sequence[Camera], seen: Outlines, evidence: Evidence) -> _Judged:
    """The same outlines in other poses."""
    pairs = zip(cameras, seen.contours, strict=True)
    moved = replace(evidence, contours=[seen_by(camera, own) for camera, own in pairs])
    return moved, judge(moved), dict(zip(seen.masks, cameras, strict=True))


def _before_the_event(seen: Outlines, evidence: Evidence) -> _Judged | None:
    """With what moved in the middle of the scan taken back; None where nothing did. Masks that are
    drawn in the poses of before agree with them."""
    found = event_between(seen.contours, seen.cameras)
    return None if found is None else _seen_from(found[1], seen, evidence)


def _in_corrected_poses(seen: Outlines, evidence: Evidence) -> _Judged | None:
    """In corrected poses, where all outlines agree there; else None."""
    try:
        found = refine(seen.contours, seen.cameras)
    except ValueError:
        return None
    again = _seen_from(found.cameras, seen, evidence)
    shares = again[1].shares
    return again if len(shares) and not (shares > DOUBT).any() else None


def _misplaced(share: float) -> str:
    return f"{_on_edges(share)}: left out; something is before the object, or its pose is wrong"


def _corrected(share: float) -> str:
    return f"{_on_edges(share)}, and nothing where its pose is corrected: its pose is wrong"


def _on_edges(share: float) -> str:
    return f"its mask lies on edges of its image, but {share:.0%} of it contradicts the others"
