"""The page of the viewer beside a command: started, named, and ended with it."""

import json
import os
import queue
import subprocess
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

from occ_recon_ros.errors import UserError
from occ_recon_ros.nodes.viewer import ENDS_WITH
from occ_recon_ros.streams.child import end

from .arguments import Values, parse_settings, ros_arguments
from .pipeline import prepare_environment, private_domain

_START_S = 30.0
_LOOK_S = 20.0


def viewer_parameters(values: Values) -> list[str]:
    """Those of --set that are the viewer's, as ROS arguments (JSON is YAML)."""
    given = values.get("viewer", {}).items()
    return [word for name, value in given for word in ("-p", f"{name}:={json.dumps(value)}")]


class Watching:
    """A viewer that runs as a program of its own."""

    def __init__(self, domain_id: int | None, arguments: Sequence[str]) -> None:
        environment = dict(os.environ)
        if domain_id is not None:
            environment["ROS_DOMAIN_ID"] = str(domain_id)
        environment[ENDS_WITH] = str(os.getpid())  # also where this process is killed
        command = [sys.executable, "-m", "occ_recon_ros.nodes.viewer", *arguments]
        self._process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()
        self.url = self._wait_for("viewer: ", _START_S)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put(None)

    def _wait_for(self, start: str, seconds: float) -> str:
        """The rest of the first line that begins so.

        Raises:
            UserError: the viewer has ended; says why.
        """
        end, said = time.monotonic() + seconds, ""
        while (left := end - time.monotonic()) > 0:
            with suppress(queue.Empty):
                line = self._lines.get(timeout=min(left, 0.2))
                if line is None:
                    raise UserError(f"the page could not be opened: {said or 'the viewer ended'}")
                if line.startswith(start):
                    return line.removeprefix(start)
                said = line.removeprefix("error: ")
        return ""

    def wait_until_seen(self) -> None:
        """Until somebody has the page open, or for a while."""
        if not self._wait_for("somebody looks", _LOOK_S):
            print("nobody has opened the page yet; going on", file=sys.stderr)

    def wait_until_ended(self) -> None:
        """Until the viewer ends, or Ctrl-C."""
        with suppress(KeyboardInterrupt):
            print(f"the page stays at {self.url} until Ctrl-C", file=sys.stderr, flush=True)
            self._process.wait()

    def end(self) -> None:
        """End the viewer."""
        end(self._process)


@contextmanager
def watched(
    wanted: bool, domain_id: int | None, arguments: Sequence[str] = (), stay: bool = True
) -> Iterator[None]:
    """A page that shows what the block does.

    Args:
        wanted: nothing happens if not.
        domain_id: of the nodes; None for that of the environment.
        arguments: of the viewer, --ros-args and so on.
        stay: wait until the page is open before the block, and keep it afterwards until Ctrl-C.
    """
    if not wanted:
        yield
        return
    page = Watching(domain_id, arguments)
    try:
        print(f"watch it at {page.url}", file=sys.stderr, flush=True)
        if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            webbrowser.open(page.url)
        if stay:
            page.wait_until_seen()
        yield
        if stay:
            page.wait_until_ended()
    finally:
        page.end()


def watched_alone(
    wanted: bool, params: Path | None, assignments: Sequence[str]
) -> AbstractContextManager[None]:
    """A page for a command that keeps to a ROS domain of its own.

    Raises:
        UserError: parameters that cannot be.
    """
    prepare_environment(local=True)
    arguments = ros_arguments(params, "warn") + viewer_parameters(parse_settings(assignments))
    return watched(wanted, private_domain(), arguments)
