"""Programs of ours as processes of their own, without the seconds that each spends on imports.

One process a worker imports what they need, and forks for each of them: a process with its own
arguments, environment, pipes, signals and exit code. That a program also starts from nothing is
for the tests that run it by its name.
"""

import atexit
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from threading import Lock, Thread
from typing import IO, Any

NODES = ("contour_tracker", "reconstructor", "mesher", "viewer", "board_pose", "turntable_pose")
COMMAND = "occ_recon_ros.cli"
MODULES = (COMMAND, *(f"occ_recon_ros.cli.{name}" for name in ("live", "record", "scan")))
MODULES += tuple(f"occ_recon_ros.nodes.{name}" for name in NODES)
_LONGEST = 1 << 16  # bytes of a request or an answer
_LOOK_S = 0.02
_LINE = Lock()  # one question at a time


class _Process:
    """A process that was forked.

    Attributes:
        pid: of it.
        returncode: None as long as it is not known to have ended; a signal's number below zero.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        pipes: Mapping[int, int],
        pass_fds: Sequence[int] = (),
        session: bool = False,
    ) -> None:
        """Start ``module.main()``, where ``pipes`` are what its descriptors 0 to 2 are of ours,
        which end here; ``pass_fds`` stay open; ``session``: in one of its own."""
        request = {"module": module, "arguments": [*arguments], "environment": {**environment}}
        request |= {"folder": os.getcwd(), "onto": [*pipes], "session": session}
        self.returncode: int | None = None
        self._asking = Lock()
        self.pid: int = _ask(request, [*pipes.values(), *pass_fds])
        for end in {*pipes.values()}:
            os.close(end)

    def poll(self) -> int | None:
        """The exit code, if it has ended."""
        with self._asking:
            if self.returncode is None:
                self.returncode = _ask({"poll": self.pid})
            return self.returncode

    def wait(self, timeout: float = 300.0) -> int:
        """The exit code, once it has ended."""
        late = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > late:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(_LOOK_S)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class Forked(_Process):
    """A running program, as ``subprocess.Popen`` with pipes of text.

    Attributes:
        stdout, stderr: to read from; None where both go to stdout.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        one_pipe: bool = False,
        pass_fds: Sequence[int] = (),
    ) -> None:
        """Start ``module.main()``; ``one_pipe``: stderr goes to stdout; ``pass_fds`` stay open."""
        out, their_out = os.pipe()
        err, their_err = (None, their_out) if one_pipe else os.pipe()
        pipes = {1: their_out, 2: their_err}
        super().__init__(module, arguments, environment, pipes, pass_fds)
        self.stdout: IO[str] = os.fdopen(out)
        self.stderr: IO[str] | None = None if err is None else os.fdopen(err)

    def communicate(self, timeout: float = 300.0) -> tuple[str, str]:
        """All that it still writes to stdout and to stderr, once it has ended."""
        late, texts = time.monotonic() + timeout, {}

        def read(pipe: IO[str]) -> None:
            with pipe:
                texts[pipe] = pipe.read()

        pipes = [pipe for pipe in (self.stdout, self.stderr) if pipe and not pipe.closed]
        readers = [Thread(target=read, args=(pipe,), daemon=True) for pipe in pipes]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join(max(0.0, late - time.monotonic()))
        if any(reader.is_alive() for reader in readers):
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        self.wait(max(0.0, late - time.monotonic()))
        return texts.get(self.stdout, ""), texts.get(self.stderr, "")


class Beside(_Process):
    """What ``streams.child.begin`` begins, which takes it more than a second.

    Attributes:
        stdin, stdout: of bytes, to write to and to read from.
    """

    def __init__(self, module: str) -> None:
        theirs_in, ours_in = os.pipe()
        ours_out, theirs_out = os.pipe()
        pipes = {0: theirs_in, 1: theirs_out, 2: os.dup(2)}
        super().__init__(module, (), os.environ, pipes, session=True)
        self.stdin, self.stdout = os.fdopen(ours_in, "wb"), os.fdopen(ours_out, "rb")

    def communicate(self, said: bytes) -> tuple[bytes, None]:
        """All that it answers, once it has ended."""
        with suppress(BrokenPipeError), self.stdin:
            self.stdin.write(said)
        with self.stdout:
            answer = self.stdout.read()
        self.wait()
        return answer, None


def wait_until_ready() -> None:
    """Wait for the process that forks, which imports for seconds before it answers at all."""
    _ask({})


def _ask(request: dict[str, Any], files: Sequence[int] = ()) -> Any:
    """What the process that forks answers."""
    with _LINE:
        connection = _forking()
        socket.send_fds(connection, [json.dumps(request).encode()], list(files))
        return json.loads(connection.recv(_LONGEST))


@cache
def _forking() -> socket.socket:
    """A line to the process that forks, which ends with this one."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        program = subprocess.Popen(
            [sys.executable, __file__, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
    atexit.register(lambda: (ours.close(), program.wait()))
    return ours


def _serve(connection: socket.socket) -> int:
    """Fork and answer until nobody asks any more; in a fork, be the program."""
    from occ_recon_ros.geometry.warming import warm_up

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # is for the tests and their programs
    for module in (*MODULES, "rosidl_generator_py"):  # what the first node would import
        importlib.import_module(module)
    warm_up()
    gc.freeze()  # else each fork looks through all of this when it ends: half a second
    alive: set[int] = set()
    while True:
        data, files, _, _ = socket.recv_fds(connection, _LONGEST, 16)
        if not data:
            for pid in alive:
                os.kill(pid, signal.SIGKILL)
            return 0
        request = json.loads(data)
        if not request:
            answer = None
        elif "poll" in request:
            pid, status = os.waitpid(request["poll"], os.WNOHANG)
            alive.discard(pid)
            answer = os.waitstatus_to_exitcode(status) if pid else None
        elif answer := os.fork():
            alive.add(answer)
            for file in files:
                os.close(file)
        else:
            connection.close()
            return _become(request, files)
        connection.send(json.dumps(answer).encode())


def _become(request: dict[str, Any], files: Sequence[int]) -> int:
    """Be the program that was asked for; its exit code."""
    ours = files[: len(request["onto"])]
    for number, file in zip(request["onto"], ours, strict=True):
        os.dup2(file, number)
    for file in {*ours}:
        os.close(file)
    if request["session"]:
        os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = [request["module"], *request["arguments"]]
    return importlib.import_module(request["module"]).main()


if __name__ == "__main__":
    sys.exit(_serve(socket.socket(fileno=int(sys.argv[1]))))
