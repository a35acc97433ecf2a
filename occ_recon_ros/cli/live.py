"""All nodes in one process, live."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from occ_recon_ros.errors import UserError
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.checkpoint import checkpoint_path
from occ_recon_ros.nodes.main import note_signals, spin_until_noted
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.streams.topics import TYPE_NAMES

from .arguments import (
    Values,
    override,
    parse_namespace,
    parse_remaps,
    parse_settings,
    ros_arguments,
)
from .pipeline import Kinds, pipeline, prepare_environment
from .watching import viewer_parameters, watched

POSES = ("board", "turntable", "topic", "tf")
"""Where poses come from."""

KEEPERS = ("contour_tracker", "reconstructor", "mesher")
"""The nodes that keep the scan in a checkpoint."""


def run_live(
    params: Path | None,
    assignments: Sequence[str],
    remaps: Sequence[str],
    namespace: str,
    resume: Path | None,
    log_level: str,
    view: bool,
    pose: str,
) -> int:
    """``run``: the three nodes, and one that finds poses, until SIGINT, SIGTERM or SIGHUP; the
    arguments are those of the command.

    Returns:
        The exit code: 1 where a scan could not be saved at the end.

    Raises:
        UserError: arguments, parameters or a checkpoint that cannot be used.
    """
    values = parse_settings(assignments)
    further = _pose_nodes(pose, values)
    namespace = parse_namespace(namespace)
    if resume is not None:
        _resume(values, resume, namespace)
    arguments = ros_arguments(params, log_level)
    if namespace != "/":
        arguments += ["-r", f"__ns:={namespace}"]
    for source, target in parse_remaps(remaps, TYPE_NAMES).items():
        arguments += ["-r", f"{target.strip('/')}:={source}"]
    prepare_environment(local=False)
    with watched(view, None, arguments + viewer_parameters(values), stay=False):
        came = note_signals()
        with pipeline(arguments, values, further=further) as nodes:
            print(f"{', '.join(nodes.nodes)} are running; Ctrl-C ends them", flush=True)
            if sys.stderr.isatty() and log_level != "warn":
                nodes.nodes["reconstructor"].create_timer(1.0, StatusLine(nodes.nodes).show)
            spin_until_noted(nodes.executor, came)
    return int(any(node.lost for node in nodes.nodes.values()))


def _pose_nodes(pose: str, values: Values) -> Kinds:
    """The node that finds poses; the tracker is told where to take them from.

    Raises:
        UserError: no such source of poses.
    """
    if pose not in ("", *POSES):
        raise UserError(f"--pose {pose}: must be one of {', '.join(POSES)}")
    mine = values.get("contour_tracker", {})
    if pose:
        override(values, "contour_tracker", pose_source="tf" if pose == "tf" else "topic")
    if pose == "turntable" and "pose_sync" not in mine:
        # Encoders keep a time of their own.
        override(values, "contour_tracker", pose_sync="interpolate")
    kinds: Kinds = {"board": BoardPoseNode, "turntable": TurntablePoseNode}
    return {f"{pose}_pose": kinds[pose]} if pose in kinds else {}


class StatusLine:
    """The scan in one line of the terminal, which is written over."""

    def __init__(self, nodes: Mapping[str, Any]) -> None:
        self._nodes, self._last = nodes, ""

    def text(self) -> str:
        """Frames, angle covered, share of good samples, triangles."""
        rims, mesh = (self._nodes[name].figures() for name in ("reconstructor", "mesher"))
        counts = {k: int(v) for k, v in rims.items() if k.startswith("samples ")}
        good = 100 * counts.get("samples good", 0) / max(sum(counts.values()), 1)
        return (
            f"{rims['frames']} frames, {rims['angle covered deg']} deg covered, {good:.0f} % of "
            f"the samples good, {mesh['triangles']} triangles"
        )

    def show(self) -> None:
        """Write it if it is news."""
        text = self.text()
        if text != self._last:
            self._last = text
            # What is logged next is written over it.
            print(f"{text}\033[K", end="\r", file=sys.stderr, flush=True)


def _resume(values: Values, folder: Path, namespace: str) -> None:
    """Let the nodes go on with the scan whose checkpoints are in a folder.

    Raises:
        UserError: there are none of these nodes.
    """
    files = [checkpoint_path(str(folder), f"{namespace}/{node}") for node in KEEPERS]
    if not any(file.exists() for file in files):
        raise UserError(
            f"--resume {folder}: no checkpoints there ({', '.join(file.name for file in files)}); "
            "a scan leaves them with checkpoint_every in its parameters"
        )
    for node in KEEPERS:
        override(values, node, resume=True, checkpoint_path=str(folder))
