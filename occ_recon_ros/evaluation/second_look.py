"""Masks found again in corrected cameras, and cameras by them, in turn."""

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress

from .figures import Report
from .refinement import Refine
from .segmentation import SURE, Segmentation

_LOOKS = 3  # at all views, after the first


class SecondLook:
    """Where masks were in doubt and cameras were corrected since: the views together once more.
    Not where masks came with them: these do not depend on poses.

    Masks that are found in wrong poses are as wide as these are off, and yet tell where the
    cameras were. Each time what is believed more of two masks is taken, and the cameras are
    corrected by them, anew from those that were given.

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
        try:
            for _ in range(_LOOKS):
                before = _belief(self._masks.report)
                cameras = known.then(taken).cameras
                if not in_doubt(self._masks.report) or cameras is None:
                    break
                masks = self._masks.anew()
                views.changes = Changes(cameras=cameras)
                if views.masked():
                    break
                found = masks(views, progress)
                if found.masks is None or _belief(masks.report) <= before:
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
        return taken


def in_doubt(report: Report) -> bool:
    """Whether masks are, by the report on them, as a whole: not where some views are bad alone."""
    return bool(report.get("warnings")) and _belief(report) < SURE


def _belief(report: Report) -> float:
    """0 to 1; nothing speaks against masks of which nothing is said."""
    return float(report.get("belief", 0.0 if report.get("warnings") else 1.0))
