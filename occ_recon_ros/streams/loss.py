"""What the numbers of a publisher tell: messages that never came, and another publisher."""

from collections import Counter

_PUBLISHERS = 4  # of a topic, whose numbers are followed at a time


class LossCount:
    """Follows the numbers that publishers give their messages, each its own from 1 on.

    A message does not tell which publisher it is of: it is taken for one of that whose last
    number is nearest below its own.

    Attributes:
        missed: by topic, how many messages had been sent before the first that came.
        restarts: by topic, how often numbers began that are of none so far: another publisher.
    """

    def __init__(self) -> None:
        self.missed: Counter[str] = Counter()
        self.restarts: Counter[str] = Counter()
        self._last: dict[str, list[int]] = {}  # of each publisher, the latest heard at the end
        self._forgiven = False

    def forgive(self) -> None:
        """A new scan begins: what was sent before is none of it."""
        self.missed.clear()
        self._forgiven = True

    def last(self, topic: str) -> int:
        """The number of the latest message, 0 before any."""
        return self._last.get(topic, [0])[-1]

    def take(self, topic: str, number: int) -> tuple[int, bool]:
        """Note the number of a message.

        Returns:
            How many are missing before it, and whether it is of another publisher than the
            message before.
        """
        if topic not in self._last:
            self._last[topic] = [number]
            if not self._forgiven:
                self.missed[topic] = number - 1
            return 0, False
        numbers = self._last[topic]
        latest = numbers[-1]
        before = max((n for n in numbers if n < number), default=None)
        if before is None:
            self.restarts[topic] += 1
            del numbers[: 1 - _PUBLISHERS]
        else:
            numbers.remove(before)
        numbers.append(number)
        return (0 if before is None else number - before - 1), number <= latest
