"""All nodes in one process, live."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from .given import parse_settings, ros_arguments
from .pipeline import pipeline, prepare_environment


def run_live(params: Path | None, assignments: Sequence[str], log_level: str) -> None:
    """Run the three nodes until SIGINT or SIGTERM.

    Raises:
        UserError: parameters that cannot be used.
    """
    values = parse_settings(assignments)
    arguments = ros_arguments(params, log_level)
    prepare_environment(local=False)
    ended = suppress(KeyboardInterrupt, ExternalShutdownException, ROSInterruptException)
    with ended, pipeline(arguments, values, signals=SignalHandlerOptions.ALL) as nodes:
        print(f"{', '.join(nodes.nodes)} are running; Ctrl-C ends them", flush=True)
        nodes.executor.spin()
