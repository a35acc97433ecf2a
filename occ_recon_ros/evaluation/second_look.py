"""Masks found again in corrected cameras, and cameras by them, in turn; or in place of masks that
came and that no camera makes agree."""

from collections.abc import Sequence

import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.imaging.joint.mask_edges import redrawn
from occ_recon_ros.imaging.joint.masks import LEAST_BELIEF
from occ_recon_ros.streams.together import SURE
from occ_recon_ros.surface.covering import covered_by_hull

from .figures import Report
from .given_up import given_up
from .refinement import Refine, outlines_of
from .segmentation import Segmentation

_LOOKS = 3  # at all views, after the first
_APART = 0.0075  # of the size of the outlines: 3 px of the images of the joint pass
_COARSE = 2.2  # sigmas by which outlines of masks that came stay apart; right ones stay below 2
_HELPED = 0.5  # of what views were apart, that is left where cameras were corrected rightly
_FINER = 0.5  # of that, below which what images show instead is taken
_UNSURE = 1.5  # sigmas by which outlines stay apart, from which on masks may be coarse
_REDRAWN = 3  # times, at most, twice each: an outline moves by few pixels at once
_WELL = 0.95  # of the outlines, that this body covers: they are right but for a little
_LOOKED_AT = 5  # images, whether they are cut out
_GIVEN_UP = 0.02  # of masks that came: brushes, hulls, boxes 0.007 at most, lost thirds 0.03
_BETTER = 0.8  # of what the body that all masks leave does not cover, with less of which left


class SecondLook:
    """Where masks were in doubt and cameras were corrected since, or these by much: the views
    together once more. Not where masks came with them: these do not depend on poses. But where no
    correction of the cameras makes these agree, or they lie beside the edges of their images, these
    are asked alone.

    Masks that are found in wrong poses are as wide as these are off, and yet tell where the
    cameras were. Each time what is believed more of two masks is taken, or agrees more where there
    was no doubt, and the cameras are corrected by them, anew from those that were given.

    Args:
        masks: found the masks; its ``report`` becomes that of the masks that are taken.
        poses: corrected the cameras; its ``report`` becomes that of the last correction.
    """

    name = "second_look"

    def __init__(self, masks: Segmentation, poses: Refine) -> None:
        self._masks, self._poses = masks, poses

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; the masks and cameras to be played, or none where those before
        stay."""
        known, taken = views.changes, Changes()
        if self._masks.misread:
            told = self._poses.report.get("warnings", ())
            left = [words for words in self._masks.report["warnings"] if words not in told]
            self._masks.report["warnings"] = left  # each once
            return taken
        if self._masks.on_sheet:
            return taken  # what a sheet says of the cameras does not depend on theirs
        try:
            views.changes = Changes()
            if views.masked() and _cut_out(views):
                return taken
            if views.masked():
                found = self._instead(views, progress)
                views.changes = known
                return found if found.masks is not None else self._drawn_anew(views, progress)
            for look in range(_LOOKS):
                before = self._masks.report
                cameras = known.then(taken).cameras
                far = look == 0 and _far_off(self._poses.report) and "agreement" in before
                if not (in_doubt(before) or far) or cameras is None:
                    break
                masks = self._masks.anew()
                views.changes = Changes(cameras=cameras)
                found = masks(views, progress)
                if found.masks is None or not _better(masks.report, before):
                    break
                taken = taken.then(found)
                self._masks.report = masks.report | {"in_corrected_cameras": True}
                poses = self._poses.anew()
                views.changes = found
                corrected = poses(views, progress)
                if corrected.cameras is None:
                    break
                taken, self._poses.report = taken.then(corrected), poses.report
        finally:
            views.changes = known
        self._doubt_both()
        return taken

    def _doubt_both(self) -> None:
        """Outlines tell poses, and poses outlines: where neither is sure both may be wrong."""
        masks, poses = self._masks.report, self._poses.report
        if _far_off(poses) and LEAST_BELIEF <= _belief(masks) < SURE:
            before, after = poses["before_px"], poses.get("after_px", 0.0)
            what = f"poses or calibration as given are off by {before:.1f} px"
            if after > _HELPED * before:
                # Cameras that are off can be corrected, outlines that are not the object's cannot.
                what = (
                    f"the outlines are {before:.1f} px apart as given, {after:.1f} in any cameras"
                )
            unsure = f"the masks that were found by them are believed by {_belief(masks):.2f} only"
            # Of masks that were drawn where wrong cameras see the object, all else follows.
            masks["warnings"] = [f"{what}, and {unsure}", *masks.get("warnings", ())]

    def _instead(self, views: BagViews, progress: Progress) -> Changes:
        """What images show in place of masks that lie beside their edges, or are coarse: drawn by
        hand, or by a network that saw each image alone; and the cameras that their outlines ask
        for."""
        beside, apart = self._masks.off_edges, self._poses.report.get("after_in_sigmas", 0.0)
        asked = self._masks.way != "single" and "not_used" not in self._masks.report
        if not asked or (apart < _COARSE and not beside):
            return Changes()
        masks, poses = self._masks.anew(images_alone=True), self._poses.anew()
        found = masks(views, progress)
        if found.masks is None or _belief(masks.report) < SURE:
            return self._kept("tell less")
        if given_up(views, found.masks) > _GIVEN_UP:
            return self._kept("leave out parts that look as nothing beside the masks does")
        views.changes = found
        corrected = poses(views, progress)
        most = max(apart, _COARSE) if beside else _FINER * apart
        if poses.report.get("after_in_sigmas", np.inf) > most:
            return self._kept("agree less")
        px = self._poses.report.get("after_px", np.nan)
        what = f"the masks that came are {px:.1f} px apart from each other in any cameras"
        self._masks.report = masks.report | {"not_used": next(iter(beside), what)}
        self._poses.report = poses.report
        if corrected.cameras is None:
            views.changes = Changes()
            corrected = Changes(cameras=views.cameras())
        return found.then(corrected)

    def _kept(self, why: str) -> Changes:
        """No changes: the masks that came stay, and of what is doubtful about them, as beside the
        edges of their images, it is said that these alone are no better."""
        beside, said = self._masks.off_edges, self._masks.report.get("warnings", ())
        if beside:
            kept = [f"{words}; images alone {why}" if words in beside else words for words in said]
            self._masks.report["warnings"] = kept
        return Changes()

    def _drawn_anew(self, views: BagViews, progress: Progress) -> Changes:
        """Masks that came and are coarse, drawn where their images show the outline, if the body
        that these leave covers them better; and the cameras that they ask for."""
        apart = self._poses.report.get("after_in_sigmas", 0.0)
        if self._masks.way == "single" or apart < _UNSURE or "not_used" in self._masks.report:
            return Changes()
        known, found = views.changes, Changes()
        doing(progress, "masks at the edges of their images")
        first = covered = _covered(views, progress)
        for _ in range(_REDRAWN):
            masks = {
                view.stamp_ns: redrawn(view.image, redrawn(view.image, view.mask))
                for view in views
                if view.mask is not None
            }
            views.changes = known.then(Changes(masks=masks))
            now = _covered(views, progress)
            if 1 - now > _BETTER * (1 - covered):
                break
            found, covered = Changes(masks=masks), now
        if found.masks is None:
            return found
        poses = self._poses.anew()
        views.changes = found
        corrected = poses(views, progress)
        self._poses.report = poses.report
        what = "the masks that came are coarse: drawn anew at the edges of their images"
        gain = f"the body that all leave covers {covered:.1%} of them, and not {first:.1%}"
        kind = "notes" if covered > _WELL else "warnings"
        said = [*self._masks.report.get(kind, ()), f"{what}, {gain}"]
        self._masks.report = self._masks.report | {kind: said}
        cameras = views.cameras() if corrected.cameras is None else corrected.cameras
        return Changes(found.masks, cameras)


def _cut_out(views: BagViews) -> bool:
    """Whether images are of one colour all about their masks, and so tell no more than these."""
    for view in views.some(evenly(len(views), _LOOKED_AT)):
        around = view.image[view.mask == 0] if view.mask is not None else view.image[:0]
        if not len(around) or (around != around[0]).any():
            return False
    return True


def _covered(views: BagViews, progress: Progress) -> float:
    _, outlines = outlines_of(views, progress)
    return covered_by_hull([outline for outline in outlines if outline is not None])


def in_doubt(report: Report) -> bool:
    """Whether masks are, by the report on them, as a whole: not where some views are bad alone."""
    return bool(report.get("warnings")) and _belief(report) < SURE


def _better(masks: Report, before: Report) -> bool:
    """Whether masks are believed more than others, or, where these are in no doubt, agree more."""
    gain = _belief(masks) - _belief(before)
    return gain > 0 or (
        gain == 0 and not in_doubt(before) and _agreement(masks) > _agreement(before)
    )


def _far_off(poses: Report) -> bool:
    """Whether views were far apart in the cameras as given."""
    return bool(poses.get("before_of_size", 0.0) > _APART)


def _agreement(report: Report) -> float:
    views: Sequence[float] = report.get("agreement", (0.0,))
    return float(np.mean(views))


def _belief(report: Report) -> float:
    """0 to 1; nothing speaks against masks of which nothing is said."""
    return float(report.get("belief", 0.0 if report.get("warnings") else 1.0))
