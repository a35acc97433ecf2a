"""What single views show, or the masks that came with them, and in which cameras it agrees."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.joint.edges import edge_strength
from occ_recon_ros.imaging.joint.mask_edges import MaskEdges
from occ_recon_ros.poses.refine import event_between
from occ_recon_ros.streams.alone import MANY, Outlines
from occ_recon_ros.streams.held import Held, where_poses_do_it

from .evidence import Evidence
from .findings import FAILED
from .verdict import Verdict, judge


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
    """Outlines held against each other, what is to be thought of them, and the cameras by stamp,
    empty where they are as given."""

    held: Held
    verdict: Verdict
    cameras: Mapping[int, Camera] = field(default_factory=dict)


def judged_together(looked: Looked) -> Judged:
    """All outlines together; those of images with what moved taken back, or in corrected poses,
    where they agree so."""
    seen = looked.seen
    # A mask that ends at the border of its image is no reason to look for another.
    sizes = [] if looked.masked else [(camera.width, camera.height) for camera in seen.cameras]
    evidence = Evidence(seen.contours, sizes, looked.wanted, good_share=1.0, bounded=True)
    found = _judged(evidence)
    if looked.masked:
        return found
    if found.held.wrong.sum() > MANY * len(seen):
        found = _before_the_event(seen, evidence) or found
    if looked.by_image:
        return found
    cameras = [*found.cameras.values()] or seen.cameras
    better = where_poses_do_it(found.held, cameras)
    if better is None:
        return found
    own = replace(evidence, contours=better.held.contours, agreement=better.held.agreement)
    return _judged(own, dict(zip(seen.masks, better.cameras, strict=True)))


def _judged(evidence: Evidence, cameras: Mapping[int, Camera] | None = None) -> Judged:
    verdict = judge(evidence)
    held = Held(evidence.contours, verdict.agreement, failed=verdict.word == FAILED)
    return Judged(held, verdict, cameras or {})


def _before_the_event(seen: Outlines, evidence: Evidence) -> Judged | None:
    """With what moved in the middle of the scan taken back; None where nothing did. Masks that are
    drawn in the poses of before agree with them."""
    found = event_between(seen.contours, seen.cameras)
    if found is None:
        return None
    _, cameras = found
    moved = [seen_by(camera, own) for camera, own in zip(cameras, seen.contours, strict=True)]
    own = dict(zip(seen.masks, cameras, strict=True))
    return _judged(replace(evidence, contours=moved), own)
