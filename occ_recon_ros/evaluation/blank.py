"""Images that are nearly black or white all over, unlike the others, left out before all else."""

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.exposure import black_or_white, ends_of, listed
from occ_recon_ros.bags.views import BagViews, Progress, doing

from .figures import Report


class Blank:
    """First of all: images without a mask that show nothing, as of a lamp that was out. Looked at
    together with the others they spoil what is learnt of colours, and edges of noise fit any pose.

    Attributes:
        report: ``notes`` in words, and ``stamps_ns`` of those that were left out.
    """

    name = "blank_images"

    def __init__(self) -> None:
        self.report: Report = {}

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; nothing is changed but that blank ones are ``left_out`` of them."""
        doing(progress, "images")
        stamps, ends, bare = list[int](), list[tuple[float, float]](), set[int]()
        for k, view in enumerate(views):
            progress(k + 1, len(views))
            stamps.append(view.stamp_ns)
            ends.append(ends_of(view.image))
            if view.mask is None:
                bare.add(k)
        images = views.images() or [{"name": ""}] * len(ends)
        names = [row["name"] or f"view {k}" for k, row in enumerate(images)]
        notes = []
        for what, alike in black_or_white(ends).items():
            if not (rows := [k for k in alike if k in bare]):
                continue
            notes.append(
                f"{len(rows)} of {len(ends)} images are nearly {what} all over, unlike the others, "
                f"and were left out: take them again: {listed([names[k] for k in rows])}"
            )
            views.left_out |= {stamps[k] for k in rows}
        if notes:
            self.report = {"notes": notes, "stamps_ns": sorted(views.left_out)}
        return Changes()
