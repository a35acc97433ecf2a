"""A process of its own for long work, so that neither frame nor rim waits for it."""

import os
import pickle
import queue
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

Answer = TypeVar("Answer")

END_S = 5.0  # that a child or its thread may take
GONE = (EOFError, pickle.UnpicklingError)
"""What a child reads when its parent has ended, even in the middle of a message."""
_NICE = 19  # frames and rims go first
_SESSION_NICE = 10  # a tenth of what others get: it must end on a machine that is never idle
_TRIES, _PAUSE_S = 20, 0.13  # one session of a machine may do so in a tenth of a second
_SESSION = Path("/proc/self/autogroup")


class Parent(Generic[Answer]):
    """The parent's end.

    Args:
        ready: called from another thread when there is an answer to ``take``.
    """

    def __init__(self, ready: Callable[[], None]) -> None:
        self._ready = ready
        self._child: subprocess.Popen[bytes] | None = None
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()

    @property
    def pid(self) -> int | None:
        """Of the child, None where there is none."""
        return self._child.pid if self._child else None

    def take(self) -> Answer | None:
        """An answer that is there, None if there is none."""
        try:
            return self._answers.get_nowait()
        except queue.Empty:
            return None

    def _give(self, answer: Answer) -> None:
        self._answers.put(answer)
        self._ready()


def begin(module: str) -> subprocess.Popen[bytes]:
    """Run ``main`` of a module; its pipes carry pickles both ways."""
    # By import, not as __main__: both ends must mean the same classes.
    return subprocess.Popen(
        [sys.executable, "-c", f"from {module} import main; main()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,  # Ctrl-C is for the node, which ends it
    )


def end(child: subprocess.Popen[Any]) -> None:
    """End a child, by force if it takes longer."""
    child.terminate()
    try:
        child.wait(END_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def let_others_go_first() -> None:
    """Leave the processor to whoever wants it.

    Linux shares it among sessions first (sched(7), autogroup): what is nice in a session of its
    own would get half of it all the same, unless the session is nice as well.
    """
    os.nice(_NICE)
    if os.getsid(0) == os.getpid():  # else the session is that of others too
        _make_nice(_SESSION, _SESSION_NICE)


def let_go_first_no_more(pid: int) -> None:
    """Give a child that has left the processor to others its share again: nothing else is left
    to be done."""
    _make_nice(Path(f"/proc/{pid}/autogroup"), 0)


def _make_nice(session: Path, nice: int) -> None:
    for _ in range(_TRIES):
        try:
            session.write_text(str(nice))
        except BlockingIOError:
            time.sleep(_PAUSE_S)
        except OSError:  # no Linux, or one that does not share so
            return
        else:
            return


def answers() -> IO[bytes]:
    """In the child, whose turn comes last: where answers go, and nothing else that is printed."""
    let_others_go_first()
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return pipe


def answer(pipe: IO[bytes], what: Any, unheard: Callable[[], Any] = lambda: None) -> None:
    """In the child: hand an answer to the parent; where that is gone, do what is to be done then,
    and end too."""
    try:
        pickle.dump(what, pipe, protocol=5)
        pipe.flush()
    except BrokenPipeError:
        unheard()
        os._exit(1)  # without a word: what the pipe still holds would be written again
