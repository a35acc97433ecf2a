"""Running one node as a program."""

import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.resources import config_file

from .executor import NodeExecutor

_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_NOTICE_S = 0.2  # a signal does not wake what waits for messages
_BREATH_S = 0.01  # between two failures of the middleware


def use_large_image_profile() -> None:
    """Let Fast DDS carry large images, unless the user has a profile of their own.

    To be called before rclpy.init.
    """
    if not any(os.environ.get(name) for name in _PROFILE_VARIABLES):
        os.environ[_PROFILE_VARIABLES[0]] = str(config_file("fastdds.xml"))


def note_signals() -> list[int]:
    """From now on SIGINT, SIGTERM, and SIGHUP of a terminal that is closed, are only noted, in the
    list that comes back; a second SIGINT ends the process at once.

    To be used with ``SignalHandlerOptions.NO``: rclpy's own handlers miss a signal that comes
    before they are there, and shut the context down from another thread while it is in use,
    which now and then ends in a segmentation fault.
    """
    came: list[int] = []

    def note(number: int, frame: Any) -> None:
        came.append(number)
        if number == signal.SIGINT:
            signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # of nohup
            signal.signal(number, note)
    return came


def spin_until_noted(executor: SingleThreadedExecutor, came: list[int]) -> None:
    """Work until a signal has been noted, whatever fails between the callbacks, which guard
    themselves: taking a message from the middleware, or waiting for one."""
    failures: Counter[str] = Counter()
    while not came:
        try:
            executor.spin_once(timeout_sec=_NOTICE_S)
        except (ExternalShutdownException, ShutdownException):
            return
        except Exception as error:
            words = repr(error)
            failures[words] += 1
            if failures[words] == 1:  # it may be the same with every turn
                print(f"error: {words}: going on", file=sys.stderr, flush=True)
            time.sleep(_BREATH_S)


def run_node(make_node: Callable[[], Node]) -> int:
    """Run a node until SIGINT or SIGTERM.

    Returns:
        The exit code: 0 after a signal, 1 where a scan could not be saved then, 2 when arguments
        or parameters cannot be used.
    """
    use_large_image_profile()
    came = note_signals()
    node = None
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
        executor = NodeExecutor()
        executor.add_node(node)
        spin_until_noted(executor, came)
    except (SettingsError, rclpy.exceptions.InvalidParameterValueException) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except RuntimeError as error:
        if node is not None:
            raise
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return int(getattr(node, "lost", False))
