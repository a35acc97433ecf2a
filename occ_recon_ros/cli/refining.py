"""A bag with poses and calibration corrected by its contours."""

from pathlib import Path

import numpy as np

from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.bags.writer import choose_storage, refuse_bag
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.refinement import Refine

_WORDS = {
    "common": "what all views share (where the camera sees the axis or the object frame)",
    "lens": "the lens (principal point, focal length, fy / fx, distortion)",
    "steps": "the steps of the table",
    "views": "each view by itself",
}


def refinement_lines(report: Report) -> list[str]:
    """The result in a few lines for the terminal."""
    if "note" in report:
        return [f"nothing corrected: {report['note']}"]
    if "warnings" in report and not report["corrected"]:
        return [f"nothing corrected: {warning}" for warning in report["warnings"]]
    before, after = report["before_px"], report["after_px"]
    if not report["corrected"]:
        why = (
            "no correction explains views that were left out"
            if report["tried"]
            else ("the outlines agree as well as they are known")
        )
        lines = [f"nothing corrected: two views are {before:.2f} px apart (1 sigma); {why}"]
    else:
        lines = [f"doubtful: {warning}" for warning in report.get("warnings", ())]
        lines += [f"two views were {before:.2f} px apart (1 sigma), now {after:.2f}; corrected:"]
        lines += [f"  {_WORDS[group]}" for group in report["corrected"]]
        for name, row in report["common"].items():
            what, unit = name.rsplit("_", 1)
            pairs = zip(row["value"], row["sigma"], strict=True)
            values = ", ".join(f"{value:.3g} +- {sigma:.2g}" for value, sigma in pairs)
            lines.append(f"  {what.replace('_', ' ')}: {values} {unit}")
        if "steps" in report["corrected"]:
            lines.append(f"  steps: {np.std(report['steps_deg']):.3g} deg rms")
        if "views" in report["corrected"]:
            lines.append(f"  single views: {np.median(report['views_px']):.2g} px in the median")
    for trial in report["tried"]:
        groups = " + ".join(trial["groups"]) or "as given"
        gain = f", {trial['gain_in_standard_errors']:+.1f} standard errors" * bool(trial["groups"])
        better = "" if trial["better"] else ", no gain"
        lines.append(f"  left-out pairs with {groups}: {trial['left_out_px']:.3f} px{gain}{better}")
    if report["not_determined"]:
        lines.append(f"  not determined by these outlines: {', '.join(report['not_determined'])}")
    return lines


def refine_bag(
    source: Path, target: Path, storage: str | None, overwrite: bool, progress: Progress
) -> Report:
    """Write a bag again with corrected poses and calibration, all else as it is.

    Raises:
        UserError: a bag that cannot be read or written.
    """
    refuse_bag(target, choose_storage(target, storage), overwrite)
    views, step = BagViews(source), Refine("on")
    views.changes = step(views, progress)
    views.write(target, storage, overwrite)
    return step.report
