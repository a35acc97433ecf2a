"""What single views show, or the masks that came with them, and in which cameras it agrees."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.joint.edges import edge_strength
from occ_recon_ros.imaging.joint.mask_edges import MaskEdges
from occ_recon_ros.poses.refine import event_between, refine
from occ_recon_ros.streams.alone import DOUBT, MANY, MISPLACED, MOST_DOUBTFUL, Outlines
from occ_recon_ros.surface.covering import doubt_of_holes, doubt_of_hull

from .evidence import Evidence
from .findings import FAILED
from .verdict import Verdict, judge

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Looked:
    """What was seen in the views one by one.

    Attributes:
        masked: whether some images came with masks; those without were not looked at.
        seen: the n outlines.
        numbers: n, of their views.
        strength: n, of the slope of the image along a mask that came.
        edges: how such masks lie to the edges of their images.
        bare: numbers of views that were not looked at.
        wanted: how many were; of images that lack a pose no outline was sought.
        by_image: what speaks against outlines of images by their images alone, "" if nothing.
    """

    masked: bool
    seen: Outlines
    numbers: Sequence[int]
    strength: Sequence[float]
    edges: MaskEdges
    bare: Sequence[int]
    wanted: int
    by_image: str

    @property
    def outlined(self) -> bool:
        """Whether masks came, and follow the object."""
        return self.masked and not self.edges.boxes()


def look_at_each(views: BagViews, progress: Progress, settings: ContourSettings) -> Looked:
    """Segment each view with these settings."""
    masked, whole = views.masked(), 0
    seen, edges = Outlines(settings), MaskEdges()
    numbers, strength, bare = list[int](), list[float](), list[int]()
    for k, view in enumerate(views):
        progress(whole := k + 1, len(views))
        if masked and view.mask is None:
            bare.append(k)
        elif seen.add(view.image, view.camera, view.stamp_ns, view.mask):
            numbers.append(k)
            strength.append(0.0 if view.mask is None else edge_strength(view.image, view.mask))
            if view.mask is not None:
                edges.add(view.image, view.mask)
    by_image = "" if masked else seen.doubt()
    return Looked(masked, seen, numbers, strength, edges, bare, whole - len(bare), by_image)


@dataclass(frozen=True)
class Judged:
    """Outlines as cameras see them, what is to be thought of them, and the cameras by stamp, empty
    where they are as given."""

    evidence: Evidence
    verdict: Verdict
    cameras: Mapping[int, Camera] = field(default_factory=dict)

    @property
    def shares(self) -> Array:
        """(n,) of each silhouette, that others contradict; 0 where it could not be told."""
        shares = self.verdict.shares
        return shares if len(shares) else np.zeros(len(self.evidence.contours))

    @property
    def local(self) -> Flags:
        """(n,) whether that is at one place."""
        local = self.verdict.local
        return local if len(local) else np.zeros(len(self.evidence.contours), np.bool_)

    def usable_without(self, wrong: Flags) -> bool:
        """Whether enough outlines agree to take these (n,) for wrong."""
        return self.verdict.word != FAILED and bool(wrong.sum() <= MOST_DOUBTFUL * len(wrong))

    @property
    def agreeing(self) -> list[Contours]:
        """Those that nothing contradicts; none where too many are contradicted to tell."""
        wrong = self.shares > DOUBT
        if not self.usable_without(wrong):
            return []
        return [own for own, bad in zip(self.evidence.contours, wrong, strict=True) if not bad]

    @cached_property
    def doubt_of_hull(self) -> str:
        """What speaks against those that nothing contradicts by the body that they leave, "" where
        nothing does."""
        return doubt_of_hull(own) if (own := self.agreeing) else ""

    @cached_property
    def doubt_of_holes(self) -> str:
        """The same, by that body closed over holes. Poses do not make these, nor mend them."""
        return doubt_of_holes(own) if (own := self.agreeing) else ""


def judged_together(looked: Looked) -> Judged:
    """All outlines together; those of images with what moved taken back, or in corrected poses,
    where they agree so."""
    seen, count = looked.seen, len(looked.seen)
    # A mask that ends at the border of its image is no reason to look for another.
    sizes = [] if looked.masked else [(camera.width, camera.height) for camera in seen.cameras]
    evidence = Evidence(seen.contours, sizes, looked.wanted, good_share=1.0, bounded=True)
    found = Judged(evidence, judge(evidence))
    if looked.masked:
        return found
    if (found.shares > DOUBT).sum() > MANY * count:
        found = _before_the_event(seen, evidence) or found
    if looked.by_image:
        return found
    little = (found.shares > DOUBT) & (found.shares <= MISPLACED)
    if little.sum() > MANY * count:
        return in_corrected_poses(seen, evidence) or found
    # Of thin parts, poses that contradict each other nowhere take much. Right outlines leave a body
    # of 0.97 of them in corrected poses, where shadows and holes still leave 0.94 at most.
    if not (found.shares > MISPLACED).any() and found.doubt_of_hull:
        again = in_corrected_poses(seen, evidence)
        return found if again is None or again.doubt_of_hull else again
    return found


def _seen_from(cameras: Sequence[Camera], seen: Outlines, evidence: Evidence) -> Judged:
    """The same outlines in other poses."""
    pairs = zip(cameras, seen.contours, strict=True)
    moved = replace(evidence, contours=[seen_by(camera, own) for camera, own in pairs])
    return Judged(moved, judge(moved), dict(zip(seen.masks, cameras, strict=True)))


def _before_the_event(seen: Outlines, evidence: Evidence) -> Judged | None:
    """With what moved in the middle of the scan taken back; None where nothing did. Masks that are
    drawn in the poses of before agree with them."""
    found = event_between(seen.contours, seen.cameras)
    return None if found is None else _seen_from(found[1], seen, evidence)


def in_corrected_poses(seen: Outlines, evidence: Evidence) -> Judged | None:
    """In corrected poses, where all outlines agree there; else None."""
    try:
        found = refine(seen.contours, seen.cameras)
    except ValueError:
        return None
    again = _seen_from(found.cameras, seen, evidence)
    shares = again.verdict.shares
    return again if len(shares) and not (shares > DOUBT).any() else None
