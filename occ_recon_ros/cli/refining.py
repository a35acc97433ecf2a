"""A bag with poses and calibration corrected by its contours."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from occ_recon_ros.bags.views import Progress
from occ_recon_ros.bags.writer import choose_storage, refuse_bag
from occ_recon_ros.evaluation.blank import Blank
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.refinement import Refine, apart_words, what_moved
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.evaluation.shifted import ShiftedPoses
from occ_recon_ros.poses.refine_trials import NEEDLESS
from occ_recon_ros.report.words import view_words

from .arguments import Values
from .reading import open_views

_WORDS = {
    "common": "what all views share (where the camera sees the axis or the object frame)",
    "lens": "the lens (principal point, focal length, fy / fx, distortion)",
    "focal": "the focal length",
    "steps": "the steps of the table",
    "views": "each view by itself",
}
_SHORT = {
    "common": "the poses as a whole",
    "lens": "the lens",
    "focal": "the focal length",
    "steps": "the steps of the table",
    "views": "each pose",
}


def refinement_lines(report: Report) -> list[str]:
    """The result in a few lines for the terminal."""
    anew = report.get("placed_anew", {}).items()
    placed = [f"{view_words(k, report)} {row['words']}" for k, row in anew]
    rest = "in the other poses, " if placed else ""
    return [*placed, *(rest + line if k == 0 else line for k, line in enumerate(_of_all(report)))]


def _of_all(report: Report) -> list[str]:
    """What became of the poses as a whole."""
    if "note" in report:
        return [f"nothing corrected: {report['note']}"]
    if "warnings" in report and not report["corrected"]:
        # Of images that were cut the cameras are those of parts, without a correction.
        how = "taken so" if "cameras" in report else "nothing corrected"
        return [f"{how}: {warning}" for warning in report["warnings"]]
    if not report["corrected"]:
        trials = [trial for trial in report["tried"] if trial["groups"]]
        needless = all(trial["refused"] == NEEDLESS for trial in trials)
        why = NEEDLESS if needless else "no correction explains views that were left out"
        apart = f"two views are {report['before_px']:.2f} px apart"
        lines = [f"nothing corrected: {apart} (1 sigma); {why}"]
    else:
        lines = [f"doubtful: {warning}" for warning in report.get("warnings", ())]
        lines += [f"{apart_words(report)}; corrected:"]
        words = [_WORDS[group] for group in report["corrected"] if group in _WORDS]
        lines += [f"  {what}" for what in (*what_moved(report), *words)]
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
        why = f"; not taken: {trial['refused']}" if trial["refused"] else ""
        lines.append(f"  left-out pairs with {groups}: {trial['left_out_px']:.3f} px{gain}{why}")
    if report["not_determined"]:
        lines.append(f"  not determined by these outlines: {', '.join(report['not_determined'])}")
    return [*lines, *(f"  note: {note}" for note in report.get("notes", ()))]


def correction_line(report: Report, may_be_left: bool = True) -> list[str]:
    """What was corrected, in one line; none where that is nothing. ``may_be_left``: whether the
    command that did it has an option for that."""
    if not report.get("corrected"):
        return []
    groups = [_SHORT[group] for group in report["corrected"] if group in _SHORT]
    groups = [*what_moved(report), *groups]
    return [
        f"corrected by the contours: {', '.join(groups)}; {apart_words(report)}"
        + " (--no-refine leaves them)" * may_be_left
    ]


def refine_bag(
    source: Path,
    target: Path,
    storage: str | None,
    overwrite: bool,
    progress: Progress,
    values: Values,
    remaps: Sequence[str] = (),
) -> Report:
    """Write a bag again with corrected poses and calibration, all else as it is.

    Raises:
        UserError: a bag that cannot be read or written.
    """
    refuse_bag(target, choose_storage(target, storage), overwrite)
    views, step = open_views(source, remaps, values), Refine("on")
    blank, shifted = Blank(), ShiftedPoses(step)
    blank(views, progress)
    shifted(views, progress)
    views.changes = step(views, progress)
    last = Misplaced(Segmentation("single"), step)
    views.changes = views.changes.then(last(views, progress))
    views.write(target, storage, overwrite)
    notes = [*blank.report.get("notes", ()), *shifted.report.get("notes", ())]
    notes += [*step.report.get("notes", ())]
    return step.report | {"notes": notes, "images": views.images()}
