"""A first pass over a recording that finds masks which hold in all views together."""

from collections.abc import Sequence
from pathlib import Path

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.writer import choose_storage, refuse_bag
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.alone import each_alone
from occ_recon_ros.evaluation.base import base_under
from occ_recon_ros.evaluation.blank import Blank
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.second_look import SecondLook, in_doubt
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.report.pictures import write_mask_sheet
from occ_recon_ros.streams.alone import Outlines

from .arguments import Values
from .progress import ProgressBar
from .reading import open_views


def segment(
    source: Path,
    target: Path,
    way: str,
    storage: str | None,
    overwrite: bool,
    progress: ProgressBar,
    values: Values,
    remaps: Sequence[str] = (),
) -> Report:
    """Write a bag again with masks, and beside it a contact sheet to look at.

    Raises:
        UserError: a bag that cannot be read or written, or no masks were found.
    """
    refuse_bag(target, choose_storage(target, storage), overwrite)
    views = open_views(source, remaps, values)
    blank, step = Blank(), Segmentation(way)
    blank(views, progress)
    step.configure(values.get("contour_tracker", {}))
    came = views.masked()
    views.changes = step(views, progress)
    if not came and (in_doubt(step.report) or views.changes.masks is not None):
        # Poses may be off: the masks are then taken from corrected ones, the poses stay.
        poses = Refine("auto")
        views.changes = views.changes.then(poses(views, progress.part("poses")))
        second = SecondLook(step, poses)(views, progress.part("second look"))
        views.changes = views.changes.then(second)
        views.changes = Changes(masks=views.changes.masks)
    if views.changes.masks is None and step.report["way"] == "single":
        if step.report.get("warnings") and not came:
            raise UserError(f"{source}: {step.report['warnings'][0]}")
        # A rough outline of a small object is a pixel too large: these are to a part of a pixel.
        views.changes = Changes(masks=each_alone(views, progress, ContourSettings()).masks)
        step.report["way"] = "given" if came else "single"
    base = None
    if not step.bounded:
        seen = Outlines()
        for view in views:
            if view.mask is not None and view.mask.any():
                seen.add(view.image, view.camera, view.stamp_ns, view.mask)
        base = base_under(seen.contours)
    if base is not None:
        how = f"if it is not of the object: {base.options()}"
        step.report["warnings"] = [*step.report.get("warnings", ()), f"{base.said()}; {how}"]
    if notes := blank.report.get("notes"):
        step.report["notes"] = [*notes, *step.report.get("notes", ())]
    views.write(target, storage, overwrite, step.report)
    sheet = target.with_name(target.name + ".masks.png")
    write_mask_sheet(views, sheet, None if base is None else base.edge)
    report = step.report | {"sheet": str(sheet), "images": views.images()}
    doubts = report.pop("single_images", ()) if came else ()  # nothing was sought in the images
    if doubts and "not_used" not in report:
        given = [f"given masks: {doubt}" for doubt in doubts]
        report["warnings"] = [*given, *report.get("warnings", ())]
    return report
