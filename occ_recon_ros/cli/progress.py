"""The progress bar, on stderr so that results can be piped."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


class ProgressBar:
    """One bar for each part of the work, one below the other, with the time gone and left."""

    def __init__(self, bars: Progress, what: str, pause_s: float = 0.0) -> None:
        self._bars = bars
        self._pause_s = pause_s
        self._begun = False
        self._task = bars.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """So much of the present part is done."""
        self._begun = True
        self._bars.update(self._task, completed=done, total=total)
        time.sleep(self._pause_s)

    def stage(self, what: str) -> None:
        """The present part is done, the next begins; the first, if none has begun."""
        if not self._begun:
            self._begun = True
            self._bars.update(self._task, description=what)
            return
        self._pause_s = 0.0
        for task in self._bars.tasks:
            if task.id == self._task:
                total = task.total or 1
                self._bars.update(self._task, total=total, completed=total)
                self._bars.stop_task(self._task)
        self._task = self._bars.add_task(what, total=None)

    def part(self, what: str) -> Callable[[int, int], None]:
        """A part that begins when something is said of it, and may never."""
        begun = False

        def say(done: int, total: int) -> None:
            nonlocal begun
            if not begun:
                begun = True
                self.stage(what)
            self(done, total)

        return say


SILENT = ProgressBar(Progress(disable=True), "")
"""Says nothing."""


@contextmanager
def progress_bar(what: str, quiet: bool = False, pause_s: float = 0.0) -> Iterator[ProgressBar]:
    """A bar while the block lasts, where there is a terminal and nobody wants quiet.

    Args:
        what: the first part of the work.
        quiet: show none.
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
        yield ProgressBar(bars, what, pause_s)
