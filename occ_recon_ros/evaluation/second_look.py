"""Masks found again in corrected cameras."""

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress

from .figures import Report
from .refinement import Refine
from .segmentation import SURE, Segmentation


class SecondLook:
    """Where masks were in doubt and cameras were corrected since: the views together once more.

    Masks that are found in wrong poses are as wide as these are off, and yet tell where the
    cameras were. What is believed more of the two is taken.

    Args:
        first: found the masks; its ``report`` becomes that of the masks that are taken.
        refinement: corrected the cameras.
    """

    name = "second_look"

    def __init__(self, first: Segmentation, refinement: Refine) -> None:
        self._first, self._refinement = first, refinement

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; the masks to be played, or none where those before stay."""
        before = _belief(self._first.report)
        if before >= SURE or not self._refinement.report["corrected"]:
            return Changes()
        again, known = self._first.anew(), views.changes
        views.changes = Changes(cameras=known.cameras)
        try:
            found = again(views, progress)
        finally:
            views.changes = known
        if found.masks is None or _belief(again.report) <= before:
            return Changes()
        self._first.report = again.report | {"in_corrected_cameras": True, "belief_before": before}
        return found


def _belief(report: Report) -> float:
    """0 to 1; nothing speaks against masks of which nothing is said."""
    return float(report.get("belief", 0.0 if report.get("warnings") else 1.0))
