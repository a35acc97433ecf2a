"""Images that were taken otherwise than the others: blurred, or with another exposure."""

from collections.abc import Sequence

import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.exposure import listed
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.imaging.edge_width import edge_width

from .figures import Report

_BLURRED = 2.0  # times the usual width of the edges along outlines; of sharp images 1.5 at most
_MANY = 0.5  # of the images: of more they are the usual ones
_BRIGHTER = 1.2  # times as bright: two exposures, a half or third of a stop and more apart
_LEAST = 5.0  # grey levels: of less a factor tells nothing
_FEWEST = 2  # images of one exposure
_ALIKE = 0.5  # of the way between two exposures, that images of one of them differ by


class ImageQuality:
    """Last, by the masks that are played: which images are blurred, and whether they are of two
    exposures. Where there are no masks the single images agreed, and nothing is asked.

    Attributes:
        report: ``notes`` in words, and what is to be ``checked`` where all is not well.
    """

    name = "image_quality"

    def __init__(self) -> None:
        self.report: Report = {}

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; nothing is changed."""
        if not views.masked():
            return Changes()
        widths, levels = list[float](), list[float]()
        for k, view in enumerate(views, 1):
            progress(k, len(views))
            mask = np.zeros(view.image.shape[:2], np.uint8) if view.mask is None else view.mask
            widths.append(edge_width(view.image, mask))
            # What hides the object in an image whose view was left out is no other exposure.
            seen = view.mask is None or mask.any()
            away = view.image[mask == 0] if seen else view.image[:0]
            levels.append(float(np.median(away[::7])) if away.size else np.nan)
        images = views.images() or [{"name": ""}] * len(widths)
        named = [row["name"] or str(k) for k, row in enumerate(images)]
        notes, checked = list[str](), list[str]()
        if len(blurred := _blurred(widths)):
            names = listed([named[k] for k in blurred])
            wide, usual = np.median(np.array(widths)[blurred]), np.nanmedian(widths)
            notes.append(
                f"{len(blurred)} of {len(widths)} images are blurred: along the outline an edge is "
                f"{wide:.0f} px wide, {usual:.0f} in the others: take them again: {names}"
            )
            checked.append(f"the blurred images ({names})")
        if len(brighter := _brighter(levels)):
            names = listed([named[k] for k in brighter])
            others = np.delete(levels, brighter)
            times = np.nanmedian(np.array(levels)[brighter]) / np.nanmedian(others)
            notes.append(
                f"the images are of two exposures: {len(brighter)} of {len(levels)} are "
                f"{times:.2g} times as bright as the others: take all with one: {names}"
            )
            checked.append("the images of another exposure")
        if notes:
            self.report = {"notes": notes, "checked": checked}
        return Changes()


def _blurred(widths: Sequence[float]) -> list[int]:
    """Numbers of the images whose edges are wider than the usual, by far."""
    wide = np.array(widths)
    if np.isnan(wide).all():
        return []
    found = np.flatnonzero(wide > _BLURRED * np.nanmedian(wide))
    return found.tolist() if len(found) <= _MANY * len(wide) else []


def _brighter(levels: Sequence[float]) -> list[int]:
    """Numbers of the images that are brighter than all others by one factor; none where they are
    not of two exposures."""
    known = np.flatnonzero(np.array(levels) > _LEAST)
    if len(known) < 2 * _FEWEST:
        return []
    logs = np.full(len(levels), np.nan)
    logs[known] = np.log(np.array(levels)[known])
    order = known[np.argsort(logs[known])]
    steps = np.diff(logs[order])
    first = int(np.argmax(steps)) + 1
    dark, bright = logs[order[:first]], logs[order[first:]]
    apart = float(np.median(bright) - np.median(dark))
    if min(len(dark), len(bright)) < _FEWEST or apart < np.log(_BRIGHTER):
        return []
    spread = max(np.ptp(dark), np.ptp(bright))
    return sorted(order[first:].tolist()) if spread < _ALIKE * apart else []
