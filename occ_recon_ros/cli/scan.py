"""One scan from the command line: options, a source of frames, a folder of results."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

from std_srvs.srv import Trigger

from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.report.heard import Heard, Sent
from occ_recon_ros.report.result import Distance, Run, write_results
from occ_recon_ros.report.words import covered_words, size_words, unit_doubt, view_words

from .arguments import Values, override, parse_settings, ros_arguments
from .listener import Listener
from .pipeline import Pipeline, pipeline, prepare_environment, private_domain
from .progress import SILENT, ProgressBar
from .refining import correction_line
from .results import refuse_results, results_folder, results_only

_MOST_NAMED = 6  # views that something was wrong with, on the terminal
_VIEWS_SHOWN = 4


@dataclass(frozen=True)
class ScanOptions:
    """What every scan may be told.

    Attributes:
        out: folder for the results.
        params: YAML file of parameters, or None.
        assignments: NODE.PARAM=VALUE.
        overwrite: replace results that are there.
        log_level: what the nodes log.
        progress: told the images so far, all of them, and each part of the work that begins.
        view: a viewer is there that shall miss nothing.
    """

    out: Path
    params: Path | None = None
    assignments: Sequence[str] = ()
    overwrite: bool = False
    log_level: str = "error"
    progress: ProgressBar = SILENT
    view: bool = False


class Source(Protocol):
    """Where the frames of a scan come from."""

    command: str  # that report.json names
    distance: Distance | None  # where the true surface is known

    def prepare(self, values: Values, options: ScanOptions) -> int:
        """Set the parameters that this source depends on, before there are any nodes.

        Returns:
            Number of images there will be.
        """

    def play(self, nodes: Pipeline, listener: Listener, progress: ProgressBar) -> Sent:
        """Publish all frames and wait for what becomes of them."""

    def described(self) -> Report:
        """What report.json says of the source."""

    def judge(self, heard: Heard) -> Report:
        """Further parts of the report that only this source can know."""


def run_scan(source: Source, options: ScanOptions) -> Report:
    """Let a source play through the three nodes, from the first frame to the results.

    Raises:
        UserError: bad arguments or input, or no surface came of it.
    """
    started = time.monotonic()
    # The source may be looked at for minutes.
    refuse_results(options.out, source.command, options.overwrite)
    values = parse_settings(options.assignments)
    arguments = ros_arguments(options.params, options.log_level)
    images = source.prepare(values, options)
    prepare_environment(local=True)
    shown = {images * k // _VIEWS_SHOWN for k in range(_VIEWS_SHOWN)}
    with results_folder(options.out, source.command, options.overwrite) as folder:
        override(values, "mesher", **results_only(folder))
        with pipeline(arguments, values, private_domain()) as nodes:
            gap = int(nodes.nodes["contour_tracker"].settings.max_pose_gap * 1e9)
            listener = Listener(shown.__contains__, gap, folder, context=nodes.context)
            nodes.add(listener)
            if options.view:
                nodes.wait_for_viewer()
            sent = source.play(nodes, listener, options.progress)
            options.progress.stage("finishing the turn")
            try:
                finish(nodes, listener, options.progress)
            except UserError as error:
                raise UserError("; ".join([str(error), *_doubts(source.described())])) from None
            heard = listener.heard
            report = {"command": source.command, "source": source.described()}
            report |= source.judge(heard)
            run = Run(folder, started, nodes.nodes, heard, sent, source.distance)
            return write_results(run, report, options.progress)


def _doubts(source: Report) -> list[str]:
    """What was doubtful about the input before it was played."""
    masks = source.get("segmentation", {})
    poses = source.get("refinement", {})
    alone = [f"images one by one: {doubt}" for doubt in masks.get("single_images", ())]
    return [*alone, *masks.get("warnings", ()), *poses.get("warnings", ())]


def lossless(values: Values, node: str, kind: str, *topics: str) -> None:
    """Make topics of images reliable: in one process nothing needs to be lost."""
    for topic in topics:
        policies = f"qos_overrides.{topic}.{kind}"
        override(values, node, **{f"{policies}.reliability": "reliable", f"{policies}.depth": 100})


def finish(pipeline: Pipeline, listener: Listener, progress: ProgressBar) -> None:
    """Close the turn and save the mesh, by the services a user would call.

    Raises:
        UserError: no surface came of it; says what became of the images.
    """
    if not listener.heard.samples:
        why = _why(pipeline) + _last_words(pipeline)
        raise UserError(f"no contours were found in {listener.heard.images} images{why}")
    pipeline.nodes["reconstructor"].on_finishing = progress
    answer = pipeline.call(listener, Trigger, "reconstructor/finish")
    if not answer.success:
        raise UserError(f"the turn could not be closed: {answer.message}")
    pipeline.settle()
    answer = pipeline.call(listener, Trigger, "mesher/save")
    if not answer.success:
        frames = len(listener.heard.samples)
        raise UserError(f"no surface came of {frames} frames: {answer.message}{_why(pipeline)}")


def headline(report: Report) -> list[str]:
    """The result in a few lines for the terminal."""
    frames, samples, mesh = report["frames"], report["samples"], report["mesh"]
    lines = [
        f"{frames['images']} images, {frames['contours']} contours, {frames['rims']} rims over "
        f"{covered_words(report)}, {mesh['triangles']} triangles, " + size_words(mesh["size_m"]),
        f"{100 * samples['fraction_good']:.1f} % of {samples['total']} samples are good; "
        f"{report['decode_to_strip_ms'].get('median_ms', 0):.1f} ms a frame from decode to strip",
    ]
    if "truth" in report:
        distance = report["truth"]["distance"]
        lines.append(
            f"distance to the true surface: mean {distance['mean_mm']:.4f} mm, "
            f"99th percentile {distance['p99_mm']:.4f} mm"
        )
    lines += filter(None, [unit_doubt(mesh["size_m"])])
    source = report["source"]
    from_photographs = "board" in source or "turn" in source  # for which there is no --no-refine
    lines += correction_line(source.get("refinement", {}), not from_photographs)
    masks = source.get("segmentation", {})
    if "not_used" in masks:
        lines.append(f"not used: {masks['not_used']}")
    bad = masks.get("bad_views", {})
    lines += [f"{view_words(k, source)}: {why}" for k, why in islice(bad.items(), _MOST_NAMED)]
    if len(bad) > _MOST_NAMED:
        lines.append(f"and {len(bad) - _MOST_NAMED} more views: report.json")
    verdict = report["verdict"]
    lines.append(": ".join([f"verdict: {verdict['word']}", *verdict["reasons"][:1]]))
    lines += [f"  also: {reason}" for reason in verdict["reasons"][1:]]
    lines += [f"  to do: {advice}" for advice in verdict["advice"]]
    lines += [f"  note: {note}" for note in verdict.get("notes", ())]
    for node, reasons in report["drops"].items():
        lines += [f"{node} dropped {count}: {reason}" for reason, count in reasons.items()]
    if frames["unanswered_stamps_ns"]:
        lines.append(f"nothing came of {len(frames['unanswered_stamps_ns'])} images")
    return lines


def _why(pipeline: Pipeline) -> str:
    drops = [
        f"{count} {reason}"
        for node in pipeline.nodes.values()
        for reason, count in node.drops.most_common(3)
    ]
    return f" (dropped: {', '.join(drops)})" if drops else ""


def _last_words(pipeline: Pipeline) -> str:
    """What was wrong with the last image that was dropped for the commonest reason."""
    tracker = pipeline.nodes["contour_tracker"]
    commonest = [reason for reason, _ in tracker.drops.most_common(1)]
    return "".join(f": {tracker.last_drops[why]}" for why in commonest if why in tracker.last_drops)
