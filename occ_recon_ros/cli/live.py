"""All nodes in one process, live."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from .errors import UserError
from .given import override, parse_settings, ros_arguments
from .pipeline import pipeline, prepare_environment

KEEPERS = ("reconstructor", "mesher")
"""The nodes that keep the scan in a checkpoint."""


def run_live(
    params: Path | None, assignments: Sequence[str], resume: Path | None, log_level: str
) -> None:
    """Run the three nodes until SIGINT or SIGTERM.

    Args:
        params: YAML file of parameters, or None.
        assignments: NODE.PARAM=VALUE.
        resume: folder of the checkpoints of a scan to go on with, or None.
        log_level: what the nodes log.

    Raises:
        UserError: parameters or a checkpoint that cannot be used.
    """
    values = parse_settings(assignments)
    if resume is not None:
        if not any(resume.glob("*.checkpoint")):
            raise UserError(
                f"--resume {resume}: no checkpoints there; a scan leaves them with "
                "checkpoint_every in its parameters"
            )
        for node in KEEPERS:
            override(values, node, resume=True, checkpoint_path=str(resume))
    arguments = ros_arguments(params, log_level)
    prepare_environment(local=False)
    ended = suppress(KeyboardInterrupt, ExternalShutdownException, ROSInterruptException)
    with ended, pipeline(arguments, values, signals=SignalHandlerOptions.ALL) as nodes:
        print(f"{', '.join(nodes.nodes)} are running; Ctrl-C ends them", flush=True)
        nodes.executor.spin()
