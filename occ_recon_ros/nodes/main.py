"""Running one node as a program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from occ_recon_ros.resources import config_file

from .parameters import SettingsError

_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def use_large_image_profile() -> None:
    """Let Fast DDS carry large images, unless the user has a profile of their own.

    To be called before rclpy.init.
    """
    if not any(os.environ.get(name) for name in _PROFILE_VARIABLES):
        os.environ[_PROFILE_VARIABLES[0]] = str(config_file("fastdds.xml"))


def run_node(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM.

    Returns:
        The exit code: 0 after a signal, 2 when arguments or parameters cannot be used.
    """
    use_large_image_profile()
    # rclpy misses a signal that comes before it listens, and calls these handlers as well.
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: came.append(number))
    node = None
    try:
        rclpy.init(args=args)
        node = make_node()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not came:
            executor.spin_once()  # the timer of the diagnostics ends it, each second at least
    except (KeyboardInterrupt, ExternalShutdownException, ROSInterruptException):
        pass
    except (SettingsError, rclpy.exceptions.InvalidParameterValueException) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except Exception as error:
        if came:
            return 0  # it took the context away while the node was being made, or worked
        if node is not None or not isinstance(error, RuntimeError):
            raise
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
