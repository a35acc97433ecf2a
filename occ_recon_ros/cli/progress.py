"""The progress bar, or lines where there is no terminal; on stderr so that results can be piped."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from threading import Event, Thread

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

FIRST_S = 10.0
"""What is done by then needs no lines."""
_EVERY_S = 30.0  # from line to line of one part
_LOOKS_S = 0.25  # for parts that begin


class ProgressBar:
    """One bar for each part of the work, one below the other, with the time gone and left."""

    def __init__(self, bars: Progress, what: str, pause_s: float = 0.0) -> None:
        self._bars = bars
        self._pause_s = pause_s
        self._begun = False
        self._what = what
        self._task = bars.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """So much of the present part is done."""
        self._begun = True
        self._bars.update(self._task, completed=done, total=total)
        time.sleep(self._pause_s)

    def doing(self, what: str) -> None:
        """Name what is done now in the present part, of which nothing is counted yet."""
        self._begun = True
        self._bars.update(self._task, description=f"{self._what}: {what}", completed=0)
        task = self._present()
        task.total = task.finished_time = None

    def stage(self, what: str) -> None:
        """The present part is done, the next begins; the first, if none has begun."""
        self._what = what
        if not self._begun:
            self._begun = True
            self._bars.update(self._task, description=what)
            return
        self._pause_s = 0.0
        total = self._present().total or 1
        self._bars.update(self._task, total=total, completed=total)
        self._bars.stop_task(self._task)
        self._task = self._bars.add_task(what, total=None)

    def _present(self) -> Task:
        return next(task for task in self._bars.tasks if task.id == self._task)

    def part(self, what: str) -> "LaterPart":
        """A part that begins when something is said of it, and may never."""
        return LaterPart(self, what)


class LaterPart:
    """A part of the work that may never begin; made by ``ProgressBar.part``."""

    def __init__(self, bar: ProgressBar, what: str) -> None:
        self._bar, self._what = bar, what
        self._begun = False

    def __call__(self, done: int, total: int) -> None:
        """So much of it is done."""
        self._begin()
        self._bar(done, total)

    def doing(self, what: str) -> None:
        """Name what is done in it now."""
        self._begin()
        self._bar.doing(what)

    def _begin(self) -> None:
        if not self._begun:
            self._begun = True
            self._bar.stage(self._what)


class Lines:
    """What is said of the work where no bar can be drawn: each part of it, and how far it is.

    Args:
        begun_s: when the work began, seconds of any clock.
    """

    def __init__(self, begun_s: float) -> None:
        self._begun_s, self._said_s = begun_s, begun_s
        self._part: tuple[int, str] | None = None

    def due(self, now_s: float, task: Task) -> str:
        """The line that is due now, empty if none is.

        Args:
            now_s: of the same clock.
            task: the present part.
        """
        gone_s, part = now_s - self._begun_s, (task.id, task.description)
        same = part == self._part
        if gone_s < FIRST_S or (same and now_s - self._said_s < _EVERY_S):
            return ""
        self._part, self._said_s = part, now_s
        counts = f", {task.completed:.0f} of {task.total:.0f}" if task.total else ""
        return f"{task.description}{counts}, after {gone_s:.0f} s"


@contextmanager
def _lines(bars: Progress) -> Iterator[None]:
    """Say them while the block lasts."""
    over, lines = Event(), Lines(time.monotonic())

    def say() -> None:
        while not over.wait(_LOOKS_S):
            if line := lines.due(time.monotonic(), bars.tasks[-1]):
                print(line, file=sys.stderr, flush=True)

    thread = Thread(target=say, name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


SILENT = ProgressBar(Progress(disable=True), "")
"""Says nothing."""


@contextmanager
def progress_bar(what: str, quiet: bool = False, pause_s: float = 0.0) -> Iterator[ProgressBar]:
    """A bar while the block lasts; where there is no terminal, some lines if it lasts long.

    Args:
        what: the first part of the work.
        quiet: neither.
        pause_s: waited after each step of the first part, for those who watch.
    """
    columns = (
        TextColumn("{task.description:<20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as bars:
        bar = ProgressBar(bars, what, pause_s)
        with nullcontext() if quiet or console.is_terminal else _lines(bars):
            yield bar
