"""Which messages of a bag are played: as recorded, but each frame once."""

from array import array
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_adapters.serialised import header_stamp_ns

from .reader import BagMessage


@dataclass(frozen=True)
class PlayingOrder:
    """What one pass over the headers of a bag tells.

    Attributes:
        images: number of images, those that come again not counted.
        again: number of images of a stamp that another had before.
        played: (n,) bool, for each message in order of recording: whether it is played.
    """

    images: int
    again: int
    played: NDArray[np.bool_]

    @staticmethod
    def of(messages: Iterable[BagMessage], images: Collection[str]) -> "PlayingOrder":
        """
        Args:
            messages: in order of recording.
            images: the topics among them that are of images.
        """
        stamps, topics = array("q"), array("q")
        numbers: dict[str, int] = {}
        for message in messages:
            stamps.append(_stamp(message.cdr, stamps[-1] if stamps else 0))
            topics.append(numbers.setdefault(message.topic, len(numbers)))
        stamp, topic = np.array(stamps, np.int64), np.array(topics, np.int64)
        of_images = np.isin(topic, [numbers[name] for name in images if name in numbers])
        taken, times = np.unique(stamp[of_images], return_counts=True)
        again = taken[times > 1]
        return PlayingOrder(len(taken), int((times - 1).sum()), _first(stamp, topic, again))

    def messages(self, recorded: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """The messages that are played."""
        pairs = zip(recorded, self.played, strict=False)
        return (message for message, played in pairs if played)

    def remarks(self) -> list[str]:
        """Sentences on what is not played as it was recorded."""
        if not self.again:
            return []
        return [f"{self.again} images come again under the same stamp: the first is taken"]


def _first(
    stamp: NDArray[np.int64], topic: NDArray[np.int64], again: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(n,) whether a message is the first of its topic and stamp, where images come again."""
    first = ~np.isin(stamp, again)
    repeated = np.flatnonzero(~first)
    both = np.column_stack([topic[repeated], stamp[repeated]])
    first[repeated[np.unique(both, axis=0, return_index=True)[1]]] = True
    return first


def _stamp(cdr: bytes, before: int) -> int:
    """Stamp of a message, or of the one before it where it is too short to have one."""
    try:
        return header_stamp_ns(cdr)
    except ValueError:
        return before
