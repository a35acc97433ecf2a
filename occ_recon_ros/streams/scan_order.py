"""Stamps in order: strays told from time that jumped back."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

_REMEMBERED = 1000
PATIENCE = 3  # usual
FAR_AHEAD_NS = 600_000_000_000  # from where on the stamp of an image, alone there, is wrong


class ScanOrder(Generic[Item]):
    """Lets items through in the order of their stamps.

    One item with an old stamp is a stray (late, or sent twice). Several in a row, each
    later than the one before, mean that time jumped back: a bag that loops, a
    simulation that was started anew. They are kept aside until that is clear, so that
    the new scan loses none of them.

    One item far ahead of the others is a stray too: it waits for the next, which goes on from
    there or from where the others are.

    Args:
        drop: called with a reason ("duplicate", "out_of_order" or "far_ahead") and the item.
        far: from where on a stamp is far ahead of the last, in its units; None: none is.

    Attributes:
        patience: how many old stamps in a row make a new scan; may be changed.
    """

    def __init__(
        self,
        drop: Callable[[str, Item], None] = lambda reason, item: None,
        far: int | None = None,
    ) -> None:
        self._drop = drop
        self.patience = PATIENCE
        self._far = far
        self.reset()

    def reset(self) -> None:
        """Forget all stamps; the next item begins a new scan."""
        self.last: int | None = None
        self._seen: deque[int] = deque(maxlen=_REMEMBERED)
        self._aside: list[tuple[int, Item]] = []
        self._ahead: tuple[int, Item] | None = None

    def go_on_from(self, stamp_ns: int) -> None:
        """An item of this stamp is let through."""
        self.last = stamp_ns
        self._seen.append(stamp_ns)

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
            return False, self._go_on(stamp_ns, item)
        if self._aside and stamp_ns <= self._aside[-1][0]:
            self._give_up_aside()
        self._aside.append((stamp_ns, item))
        if len(self._aside) < self.patience:
            return False, []
        self._give_up_ahead()
        due, self._aside = self._aside, []
        self._seen.clear()
        for stamp, _ in due:
            self.go_on_from(stamp)
        return True, [item for _, item in due]

    def _go_on(self, stamp_ns: int, item: Item) -> list[Item]:
        """Take in what is later than the last; the items that are due."""
        due = []
        if self._ahead is not None and self._ahead[0] < stamp_ns:
            self.go_on_from(self._ahead[0])
            due, self._ahead = [self._ahead[1]], None
        else:
            self._give_up_ahead()
            if self.last is not None and self._far and stamp_ns > self.last + self._far:
                self._ahead = stamp_ns, item
                return []
        self.go_on_from(stamp_ns)
        return [*due, item]

    def _give_up_ahead(self) -> None:
        if self._ahead is not None:
            self._drop("far_ahead", self._ahead[1])
        self._ahead = None

    def _give_up_aside(self) -> None:
        for stamp, item in self._aside:
            self._drop("duplicate" if self.seen(stamp) else "out_of_order", item)
        self._aside = []
