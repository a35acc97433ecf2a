"""Stamps in order: strays told from time that jumped back."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

_REMEMBERED = 1000


class ScanOrder(Generic[Item]):
    """Lets items through in the order of their stamps.

    One item with an old stamp is a stray (late, or sent twice). Several in a row, each
    later than the one before, mean that time jumped back: a bag that loops, a
    simulation that was started anew. They are kept aside until that is clear, so that
    the new scan loses none of them.

    Args:
        drop: called with a reason ("duplicate" or "out_of_order") and the item.
        patience: how many old stamps in a row make a new scan; may be changed later.
    """

    def __init__(self, drop: Callable[[str, Item], None], patience: int = 3) -> None:
        self._drop = drop
        self.patience = patience
        self.reset()

    def reset(self) -> None:
        """Forget all stamps; the next item begins a new scan."""
        self.last: int | None = None
        self._seen: deque[int] = deque(maxlen=_REMEMBERED)
        self._aside: list[tuple[int, Item]] = []

    def go_on_from(self, stamp_ns: int) -> None:
        """As if an item of this stamp had been let through."""
        self._pass(stamp_ns)

    def seen(self, stamp_ns: int) -> bool:
        """Whether an item of this stamp was let through in this scan, not long ago."""
        return stamp_ns in self._seen

    def add(self, stamp_ns: int, item: Item) -> tuple[bool, list[Item]]:
        """Take an item in.

        Returns:
            Whether a new scan begins because time jumped back, and the items that are due.
        """
        if self.last is None or stamp_ns > self.last:
            self._give_up_aside()
            self._pass(stamp_ns)
            return False, [item]
        if self._aside and stamp_ns <= self._aside[-1][0]:
            self._give_up_aside()
        self._aside.append((stamp_ns, item))
        if len(self._aside) < self.patience:
            return False, []
        due, self._aside = self._aside, []
        self._seen.clear()
        for stamp, _ in due:
            self._pass(stamp)
        return True, [item for _, item in due]

    def _pass(self, stamp_ns: int) -> None:
        self.last = stamp_ns
        self._seen.append(stamp_ns)

    def _give_up_aside(self) -> None:
        for stamp, item in self._aside:
            self._drop("duplicate" if self.seen(stamp) else "out_of_order", item)
        self._aside = []
