"""Poses that came with images by their numbers, and are those of images after or before: exchanged
before anything else is asked of a recording."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.poses.pose_shift import PoseShift, placed_as, pose_shift
from occ_recon_ros.poses.refine_rig import common_axis

from .corrected import camera_rows
from .figures import Report
from .misplaced import Agreed
from .refinement import Refine
from .shifted_masks import given_back, masks_of_others


class ShiftedPoses:
    """First of all, where masks came with the images, which do not depend on poses: poses that are
    those of the next images, or of the ones before, from an image on or all. Each is given its
    own. Where that is nobody's, it is found by the outlines of the others, or the image left out.

    Args:
        poses: says whether poses may be corrected; else it is only told.

    Attributes:
        report: what was found, in words, and the cameras.
    """

    name = "shifted_poses"

    def __init__(self, poses: Refine) -> None:
        self._poses = poses
        self.report: Report = {}

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views. What they should be becomes ``meant`` of the views, for it is no
        change that is found anew in other cameras."""
        if not views.masked():
            return Changes()
        doing(progress, "outlines")
        tracker = ContourTracker(ContourSettings(refine="none"))
        cameras: dict[int, Camera] = {}
        contours: list[Contours | None] = []
        for k, view in enumerate(views, 1):
            progress(k, len(views))
            cameras[view.stamp_ns] = view.camera
            contours.append(None)
            if view.mask is not None:
                with suppress(ContourError):
                    given = view.image, view.camera, view.stamp_ns, "object", view.mask
                    contours[-1] = tracker.process(*given)
        found = pose_shift(contours, [*cameras.values()])
        if found is None:
            return Changes()
        images = [row["name"] for row in views.images()]
        if moved := masks_of_others(views, found):
            self.report["notes"] = [_moved(moved, -found.by, images)]
            came = {k: view.mask for k, view in enumerate(views) if view.mask is not None}
            stamps = [*cameras]
            views.meant = Changes({stamps[k]: own for k, own in given_back(came, moved).items()})
            return Changes()
        self.report |= {"first": found.first, "by": found.by}
        if self._poses.way == "off":
            self.report["warnings"] = [_words(found, images)]
            return Changes()
        doing(progress, "each in its own pose")
        own, left_out = _in_their_own(found, contours, [*cameras.values()])
        meant = dict(zip(cameras, own, strict=True))
        masks = None
        if left_out:
            masks = {
                view.stamp_ns: view.mask * np.uint8(k not in left_out)
                for k, view in enumerate(views)
                if view.mask is not None
            }
        views.meant = Changes(masks, meant)
        self.report["cameras"] = camera_rows(meant, views.recorded_cameras)
        self.report["notes"] = [f"{_words(found, images)}: {_done(found, left_out, images)}"]
        return Changes()


def _in_their_own(
    found: PoseShift, contours: Sequence[Contours | None], cameras: Sequence[Camera]
) -> tuple[list[Camera], list[int]]:
    """The cameras in the poses that are theirs, and the numbers of those whose poses nobody was
    given, and that fit nowhere."""
    known = [k for k, given in enumerate(found.given) if given >= 0]
    own = [
        c if g < 0 else placed_as(c, cameras[g]) for c, g in zip(cameras, found.given, strict=True)
    ]
    for k, given in enumerate(found.given):
        if given < 0:
            own[k] = _between(k, known, own)
    seen = [
        None if c is None else seen_by(camera, c) for c, camera in zip(contours, own, strict=True)
    ]
    agreed = Agreed(own, seen, [k for k in known if seen[k] is not None])
    left_out = []
    for k in set(range(len(own))) - set(known):
        outline = seen[k]
        placed = None if outline is None else agreed.placed(k, outline)
        if placed is None:
            left_out.append(k)
        else:
            own[k] = placed[0].camera
    return own, left_out


def _between(k: int, known: Sequence[int], cameras: Sequence[Camera]) -> Camera:
    """A camera as far between those of the two known views nearest in number, or beyond them, as
    its number is, on the way around their axis."""
    a, b = sorted(sorted(known, key=lambda j: abs(j - k))[:2])
    way = (k - a) / (b - a)
    one, other = cameras[a], cameras[b]
    turn = Rotation.from_matrix(other.R_camera_object.T @ one.R_camera_object).as_rotvec()
    by = Rotation.from_rotvec(way * turn)
    axis = common_axis([cameras[j] for j in known])
    if axis is None:
        centre = one.centre + way * (other.centre - one.centre)
    else:
        centre = axis.point + by.apply(one.centre - axis.point)
    R = one.R_camera_object @ by.as_matrix().T
    return replace(cameras[k], R_camera_object=R, t_camera_object=-R @ centre)


def _moved(moved: Mapping[int, int], by: int, images: Sequence[str]) -> str:
    """What the edges tell of masks, and what was done."""
    first, last = min(moved), max(moved)
    which = {1: "the next image", -1: "the image before"}.get(by, _which(by))
    since = f"from {_called(first, images)} to {_called(last, images)}"
    what = f"{since} each mask is that of {which}"
    said = f"{what}, by the edges of both: each was given its own"
    without = sorted(set(moved) - set(moved.values()))
    if not without:
        return said
    named = ", ".join(_called(k, images) for k in without)
    return f"{said}; {named}, of which there is none, left without one"


def _which(by: int) -> str:
    """Which image is so many places after one."""
    if abs(by) > 1:
        return f"the image {abs(by)} places {'after' if by > 0 else 'before'} it"
    return "the next" if by > 0 else "the one before"


def _words(found: PoseShift, images: Sequence[str]) -> str:
    """What the outlines tell."""
    which = _which(found.by)
    since = f"from {_called(found.first, images)} on each image" if found.first else "each image"
    return f"{since} has the pose of {which}, by the outlines of all"


def _done(found: PoseShift, left_out: Sequence[int], images: Sequence[str]) -> str:
    """What was done."""
    missing = [k for k, given in enumerate(found.given) if given < 0]
    said = ["each was given its own"]
    placed = [_called(k, images) for k in missing if k not in left_out]
    if placed:
        said.append(
            f"{', '.join(placed)}, of which there is none, placed by the outlines of the others"
        )
    if left_out:
        said.append(
            f"{', '.join(_called(k, images) for k in left_out)}, of which there is none, left out"
        )
    return "; ".join(said)


def _called(k: int, images: Sequence[str]) -> str:
    return f"view {k} ({images[k]})" if k < len(images) and images[k] else f"view {k}"
