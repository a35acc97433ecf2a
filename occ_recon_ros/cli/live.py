"""All nodes in one process, live."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from occ_recon_ros.nodes.checkpoint import checkpoint_path
from occ_recon_ros.nodes.main import note_signals, spin_until_noted

from .drive import TYPES
from .errors import UserError
from .given import Values, override, parse_remaps, parse_settings, ros_arguments
from .pipeline import pipeline, prepare_environment

KEEPERS = ("reconstructor", "mesher")
"""The nodes that keep the scan in a checkpoint."""


def run_live(
    params: Path | None,
    assignments: Sequence[str],
    remaps: Sequence[str],
    namespace: str,
    resume: Path | None,
    log_level: str,
) -> None:
    """Run the three nodes until SIGINT or SIGTERM.

    Args:
        params: YAML file of parameters, or None.
        assignments: NODE.PARAM=VALUE.
        remaps: FROM:=TO, FROM a topic of the rig, TO that of ours it serves as.
        namespace: of the three nodes.
        resume: folder of the checkpoints of a scan to go on with, or None.
        log_level: what the nodes log.

    Raises:
        UserError: arguments, parameters or a checkpoint that cannot be used.
    """
    values = parse_settings(assignments)
    namespace = f"/{namespace.strip('/')}"
    if resume is not None:
        _resume(values, resume, namespace)
    arguments = ros_arguments(params, log_level)
    if namespace != "/":
        arguments += ["-r", f"__ns:={namespace}"]
    for source, target in parse_remaps(remaps).items():
        if target not in TYPES:
            raise UserError(f"--remap {source}:={target}: {target} is none of {', '.join(TYPES)}")
        arguments += ["-r", f"{target.strip('/')}:={source}"]
    prepare_environment(local=False)
    came = note_signals()
    with pipeline(arguments, values) as nodes:
        print(f"{', '.join(nodes.nodes)} are running; Ctrl-C ends them", flush=True)
        spin_until_noted(nodes.executor, came)


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
