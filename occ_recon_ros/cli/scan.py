"""One scan from the command line: options, a source of frames, a folder of results."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.report.heard import Heard, Sent

from .arguments import Values, override, parse_settings, ros_arguments
from .listener import Listener
from .pipeline import Pipeline, pipeline, prepare_environment, private_domain
from .progress import SILENT, ProgressBar
from .results import results_folder, results_only
from .session import Distance, finish, write_results

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


class Scan:
    """The three nodes, from the first frame to the results."""

    def __init__(self, options: ScanOptions) -> None:
        self._options = options

    def feed(self, source: Source) -> Report:
        """Let a source play through the nodes and write the results.

        Raises:
            UserError: bad arguments or input, or no surface came of it.
        """
        started, options = time.monotonic(), self._options
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
                    meant = source.described().get("refinement", {}).get("warnings", ())
                    raise UserError("; ".join([str(error), *meant])) from None
                report: Report = {"command": source.command, "source": source.described()}
                further = source.judge(listener.heard)
                return write_results(
                    folder,
                    report,
                    further,
                    nodes,
                    listener,
                    sent,
                    started,
                    source.distance,
                    options.progress,
                )
