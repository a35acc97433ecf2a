"""What the images of a turn, or the masks that came with them, say one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.geometry import Contours
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.joint.edges import (
    SOME_WITHOUT_EDGE,
    edge_strength,
    faint,
    small_contrast,
)
from occ_recon_ros.scene import coverage
from occ_recon_ros.surface.cone import Cone
from occ_recon_ros.surface.hull import Hull

from .verdict import FAILED, Evidence, Verdict, body_iou, judge

Mask = NDArray[np.uint8]

ROUGH = ContourSettings(refine="none", spacing_px=2.0)
MOST_DOUBTFUL = 0.4  # of the views: with more, none is taken for right
_DOUBT = 0.01  # share of a silhouette that others contradict; poses off by a pixel do less
_LEAST_COVERED = 0.95  # of the outlines by the body that all of them leave, IoU
_CELLS = 96  # along that body
_ON_EDGES = 0.5  # of the slope of the image along the sharper masks: so many lie on edges
_MANY = 0.1  # of the views, that contradict each other: poses do so in many
_MISPLACED = 0.1  # share of a silhouette; what poses are off by less, a refinement can mend


@dataclass(frozen=True)
class Alone:
    """What each view says by itself: the mask that came with it, or its image.

    Attributes:
        masks: (h, w) uint8 coverage by stamp; views without an outline have none.
        doubts: sentences on what speaks against them, none where they agree.
        agreeing: of the masks, those to begin from; none where too many disagree.
        refuted: numbers of views that came with a mask which the others contradict, and why.
        misplaced: numbers of views whose mask is contradicted by much and yet lies on the edges
            of its image, as where the pose is wrong; and why.
    """

    masks: Mapping[int, Mask]
    doubts: tuple[str, ...]
    agreeing: Mapping[int, Mask]
    refuted: Mapping[int, str]
    misplaced: Mapping[int, str]

    @staticmethod
    def of(views: BagViews, progress: Progress, settings: ContourSettings = ROUGH) -> Alone:
        """Segment each view, with these settings, and hold the outlines against each other."""
        seen = _Outlines.of(views, progress, settings)
        verdict = seen.verdict()
        count = len(seen.masks)
        shares = verdict.shares if len(verdict.shares) else np.zeros(count)
        right = seen.on_edges()
        far_off = right & (shares > _MISPLACED)
        wrong = shares > _DOUBT
        # In few views a mask that lies on edges may still lack a little.
        wrong &= ~right if wrong.sum() > _MANY * count else ~far_off
        doubts = [] if seen.masked and not wrong.any() and seen.all else list(verdict.reasons)
        if seen.bare:
            doubts.append(f"{seen.bare} of {len(views)} images came without a mask")
        if wrong.any() and not len(verdict.doubtful_views):
            doubts.append(f"{wrong.sum()} of {count} outlines leave a little of the object out")
        usable = verdict.word != FAILED and bool(wrong.sum() <= MOST_DOUBTFUL * count)
        more = [] if seen.masked else seen.doubts_of_outlines(wrong, usable)
        usable &= not more
        agreeing, refuted, misplaced = {}, {}, {}
        if usable:
            agreeing = {
                stamp: mask
                for (stamp, mask), bad in zip(seen.masks.items(), wrong, strict=True)
                if not bad
            }
        if usable and seen.masked:
            refuted = {
                seen.numbers[i]: f"its mask contradicts those of the others by {shares[i]:.0%}"
                for i in verdict.doubtful_views
                if wrong[i]
            }
        if far_off.sum() <= MOST_DOUBTFUL * count:
            misplaced = {seen.numbers[i]: _misplaced(shares[i]) for i in np.flatnonzero(far_off)}
        return Alone(seen.masks, (*doubts, *more), agreeing, refuted, misplaced)


@dataclass
class _Outlines:
    """The outlines of all views that have one.

    Attributes:
        masked: whether masks came with the views.
        count: of the views; bare: of those that came without a mask where others have one.
        numbers, contours, sizes, masks, strength, contrasts: of each view with an outline.
    """

    masked: bool
    count: int
    bare: int = 0
    numbers: list[int] = field(default_factory=list)
    contours: list[Contours] = field(default_factory=list)
    sizes: list[tuple[int, int]] = field(default_factory=list)
    masks: dict[int, Mask] = field(default_factory=dict)
    strength: list[float] = field(default_factory=list)
    contrasts: list[NDArray[np.float32]] = field(default_factory=list)

    @staticmethod
    def of(views: BagViews, progress: Progress, settings: ContourSettings) -> _Outlines:
        """Of each image, or of the mask that came with it where some came with any."""
        tracker = ContourTracker(settings)
        seen = _Outlines(views.masked(), len(views))
        for k, view in enumerate(views):
            progress(k + 1, len(views))
            if seen.masked and view.mask is None:
                seen.bare += 1
                continue
            try:
                found = tracker.process(view.image, view.camera, view.stamp_ns, "object", view.mask)
            except ContourError:
                continue
            seen.numbers.append(k)
            seen.contours.append(found)
            seen.sizes.append((view.camera.width, view.camera.height))
            if view.mask is not None:
                seen.masks[view.stamp_ns] = view.mask
                seen.strength.append(edge_strength(view.image, view.mask))
            else:
                mask = seen.masks[view.stamp_ns] = drawn(found, view.image.shape)
                seen.strength.append(0.0)
                seen.contrasts.append(small_contrast(view.image, mask))
        return seen

    @property
    def all(self) -> bool:
        """Whether each view that could have an outline has one."""
        return len(self.masks) == self.count - self.bare

    def verdict(self) -> Verdict:
        """How far they agree."""
        # A mask that ends at the border of its image is no reason to look for another.
        sizes = [] if self.masked else self.sizes
        count = self.count - self.bare
        return judge(Evidence(self.contours, sizes, count, good_share=1.0, bounded=True))

    def on_edges(self) -> NDArray[np.bool_]:
        """(n,) of masks that came: those that lie on edges are right, and what contradicts one
        is a pose."""
        strong = np.percentile([*self.strength, 0.0], 75)
        return np.asarray((np.array(self.strength) > _ON_EDGES * strong) & self.masked)

    def doubts_of_outlines(self, wrong: NDArray[np.bool_], usable: bool) -> list[str]:
        """What speaks against those that are not wrong, where they seem to be usable."""
        edgeless = float(np.median(faint(self.contrasts))) if self.contrasts else 0.0
        if edgeless > SOME_WITHOUT_EDGE:
            where = "where images show no edge, as along shadows"
            return [f"{edgeless:.0%} of the outlines lie {where}"]
        if not usable:
            return []
        covered = _covered([c for c, bad in zip(self.contours, wrong, strict=True) if not bad])
        if covered < _LEAST_COVERED:
            return [f"the body that all outlines leave covers {covered:.0%} of them"]
        return []


def _misplaced(share: float) -> str:
    what = f"its mask lies on edges of its image, but {share:.0%} of it contradicts the others"
    return f"{what}: left out, its pose may be wrong"


def _covered(contours: Sequence[Contours]) -> float:
    """How much of the outlines is left in the images of their own visual hull (mean IoU). Thin
    holes in few views, too small to be a contradiction in any, leave a body in shreds."""
    try:
        hull = Hull([Cone(view) for view in contours])
        return float(body_iou(hull.mesh(_CELLS), contours).mean()) if hull.bounded else 1.0
    except ValueError:  # nothing is left
        return 0.0


def drawn(contours: Contours, shape: tuple[int, ...]) -> Mask:
    """(h, w) uint8, the share of each pixel that lies inside of contours, 255: all of it."""
    return filled([contours.uv[a:b] for a, b in pairwise(contours.loop_starts)], shape)


def filled(loops: Sequence[NDArray[np.float64]], shape: tuple[int, ...]) -> Mask:
    """(h, w) uint8, the share of each pixel that lies inside of loops, 255: all of it."""
    return np.rint(255 * coverage(loops, shape[1], shape[0])).astype(np.uint8)
