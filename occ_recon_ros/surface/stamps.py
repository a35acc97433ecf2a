"""Stamps that are over, kept as few intervals."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable


class StampRuns:
    """Stamps of rims that are no longer part of the surface.

    Between two stamps that are still there all those that are over make one interval, so
    that there are at most one more of them than there are rims, however long a scan is. A
    stamp inside an interval that never came (a rim that was lost) is over as well.
    """

    def __init__(self) -> None:
        self._first: list[int] = []
        self._last: list[int] = []

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self._first)

    def __contains__(self, stamp_ns: int) -> bool:
        k = bisect_right(self._first, stamp_ns) - 1
        return k >= 0 and stamp_ns <= self._last[k]

    def add(self, stamp_ns: int, there: Iterable[int]) -> None:
        """A stamp is over.

        Args:
            stamp_ns: nanoseconds.
            there: the stamps that are not.
        """
        if stamp_ns in self:
            return
        k = bisect_left(self._first, stamp_ns)
        low = self._last[k - 1] if k else None
        high = self._first[k] if k < len(self._first) else None
        first = last = stamp_ns
        begin, end = k, k
        if low is not None and not any(low <= s < stamp_ns for s in there):
            begin, first = k - 1, self._first[k - 1]
        if high is not None and not any(stamp_ns < s <= high for s in there):
            end, last = k + 1, self._last[k]
        self._first[begin:end], self._last[begin:end] = [first], [last]
