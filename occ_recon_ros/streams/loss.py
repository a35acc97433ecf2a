"""What the numbers of a publisher tell: messages that never came, and another publisher."""

from collections import Counter


class LossCount:
    """Follows the numbers that a publisher gives its messages.

    Attributes:
        missed: by topic, how many messages had been sent before the first that came.
        restarts: by topic, how often the numbers began anew: another publisher.
    """

    def __init__(self) -> None:
        self.missed: Counter[str] = Counter()
        self.restarts: Counter[str] = Counter()
        self._last: dict[str, int] = {}
        self._forgiven = False

    def forgive(self) -> None:
        """A new scan begins: what was sent before is none of it."""
        self.missed.clear()
        self._forgiven = True

    def last(self, topic: str) -> int:
        """The number of the latest message, 0 before any."""
        return self._last.get(topic, 0)

    def take(self, topic: str, number: int) -> tuple[int, bool]:
        """Note the number of a message.

        Returns:
            How many are missing before it, and whether it is of another publisher.
        """
        last = self._last.get(topic)
        self._last[topic] = number
        if last is None:
            if not self._forgiven:
                self.missed[topic] = number - 1
            return 0, False
        if number < last:
            self.restarts[topic] += 1
            return 0, True
        return max(number - last - 1, 0), False
