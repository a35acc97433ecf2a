"""The order in which the messages of a bag are played: as recorded, or by their stamps."""

import tempfile
import weakref
from array import array
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.errors import writing

from .reader import BagMessage

_LATE = 8  # frames; no rig is later, and not many more wait for their parts in the tracker
_CLOCK_SET = 2  # times that the clock may be set back; more is disorder
_IN_MEMORY = 1 << 26  # bytes of messages; the rest is in a file


class PlayingOrder:
    """What is played of a bag: each frame once, and in the order of the header stamps where images
    are not in it, or other messages are far from it, such as poses written after all images.

    Args:
        messages: in order of recording.
        images: the topics among them that are of images.

    Attributes:
        images: number of images, those that come again not counted.
        stamps: {topic: (n,) int64 stamps of its messages, ns, each once, increasing}.
        again: number of images of a stamp that another had before.
        scattered: whether messages are put in the order of their stamps.
    """

    def __init__(self, messages: Iterable[BagMessage], images: Collection[str]) -> None:
        stamps, topics = array("q"), array("q")
        numbers: dict[str, int] = {}
        for message in messages:
            stamps.append(_stamp(message.cdr, stamps[-1] if stamps else 0))
            topics.append(numbers.setdefault(message.topic, len(numbers)))
        stamp, topic = np.array(stamps, np.int64), np.array(topics, np.int64)
        of_images = np.isin(topic, [numbers[name] for name in images if name in numbers])
        taken, times = np.unique(stamp[of_images], return_counts=True)
        self.images, self.again = len(taken), int((times - 1).sum())
        self._played = _first(stamp, topic, taken[times > 1])
        self.stamps = {name: np.unique(stamp[topic == k]) for name, k in numbers.items()}
        frame = np.searchsorted(taken, stamp[self._played])
        self.scattered = _scattered(frame, of_images[self._played])
        self._sorted: _Sorted | None = None

    def messages(self, recorded: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """The messages that are played; those put in order have their stamps as their times.

        Raises:
            UserError: no room to put them in order.
        """
        pairs = zip(recorded, self._played, strict=False)
        chosen = (message for message, played in pairs if played)
        if not self.scattered:
            return chosen
        if self._sorted is None:
            self._sorted = _Sorted(chosen)
        return iter(self._sorted)

    def remarks(self) -> list[str]:
        """Sentences on what is not played as it was recorded."""
        words = []
        if self.again:
            words.append(f"of images of one stamp the first is taken, {self.again} are left out")
        if self.scattered:
            words.append("messages are not in the order of their stamps: they are played in it")
        return words


class _Sorted:
    """Messages in the order of their stamps, from a file that is gone with this object."""

    def __init__(self, messages: Iterable[BagMessage]) -> None:
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._ends, self._stamps, self._kinds = array("q", [0]), array("q"), array("q")
        numbers: dict[tuple[str, str], int] = {}
        for message in messages:
            with writing(Path(tempfile.gettempdir())):
                self._file.write(message.cdr)
            self._ends.append(self._ends[-1] + len(message.cdr))
            self._stamps.append(_stamp(message.cdr, self._stamps[-1] if self._stamps else 0))
            kind = message.topic, message.msgtype
            self._kinds.append(numbers.setdefault(kind, len(numbers)))
        self._names = list(numbers)

    def __iter__(self) -> Iterator[BagMessage]:
        for k in np.argsort(np.array(self._stamps, np.int64), kind="stable").tolist():
            self._file.seek(self._ends[k])
            cdr = self._file.read(self._ends[k + 1] - self._ends[k])
            topic, msgtype = self._names[self._kinds[k]]
            yield BagMessage(topic, msgtype, max(self._stamps[k], 0), cdr)


def _scattered(frame: NDArray[np.intp], image: NDArray[np.bool_]) -> bool:
    """Whether messages are far from the order of their stamps. Where the clock was set back once or
    twice, they are in it before and after: what follows is another scan.

    Args:
        frame: (n,) the rank of each message's stamp among those of images, as recorded.
        image: (n,) whether it is an image.
    """
    at = np.flatnonzero(image)
    steps = np.diff(frame[at])
    back = at[1:][steps < 0]
    if len(back) > _CLOCK_SET or (steps[steps < 0] >= -_LATE).any():
        return True
    # The pose and calibration of the first image after come before it, as those of any.
    ends = [at[at < k][-1] + 1 for k in back]
    for first, end in zip([0, *ends], [*ends, len(frame)], strict=True):
        late = np.maximum.accumulate(frame[first:end]) - frame[first:end]
        if (late > _LATE).any():
            return True
    return False


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
