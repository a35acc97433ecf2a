"""Two topics whose scans begin anew, each in its own time: which item is of which scan."""

import time
from collections.abc import Callable
from typing import Generic, TypeVar

from .scan_order import ScanOrder

Item = TypeVar("Item")

_PATIENCE_S = 5.0


class Epochs(Generic[Item]):
    """Items of a topic, held against the new scans of another that is made from it.

    Contours of the next scan come before its first rim, or after: until both have begun anew as
    often, those that are ahead wait, and those that are behind are of the scan that is over.

    Args:
        now: seconds of a clock that never goes back.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self.clear()

    def clear(self) -> None:
        """Both begin anew."""
        self._order = ScanOrder[Item]()
        self._ahead, self._marked_at = 0, 0.0
        self._waiting: list[Item] = []

    def add(self, stamp_ns: int, item: Item) -> list[Item]:
        """Take an item in; those that are due, of the scan that goes on."""
        time_went_back, due = self._order.add(stamp_ns, item)
        if time_went_back:
            self._mark(1)
        if self._ahead > 0:
            self._waiting += due
            return []
        return due if self._ahead == 0 else []

    def add_end(self, stamp_ns: int) -> None:
        """An item without content: one with an old stamp begins a new scan."""
        if self._order.last is not None and stamp_ns <= self._order.last:
            self._order.reset()
            self._mark(1)

    def begin(self) -> list[Item]:
        """The other topic begins a new scan; the items of it that have come before."""
        self._mark(-1)
        due, self._waiting = self._waiting, []
        return due

    def overdue(self) -> list[Item]:
        """What has waited too long: the other topic did not begin anew, or not this one."""
        if not self._ahead or self._now() - self._marked_at < _PATIENCE_S:
            return []
        self._ahead = 0
        due, self._waiting = self._waiting, []
        return due

    def _mark(self, step: int) -> None:
        self._ahead += step
        self._marked_at = self._now()
