"""The camera_info of each image of a bag: that of its stamp, else the last one before it."""

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator

from msg_adapters import decode_camera, deserialise
from msg_adapters.serialised import header_frame, header_stamp_ns, with_stamp
from occ_recon_ros.streams.camera_watch import CameraWatch
from occ_recon_ros.streams.topics import IMAGES, TYPE_NAMES

from .reader import Bag, BagMessage

_INFO = "/camera_info"
_FEW = 0.1  # of the images, at which it changes: else each has its own, as of photographs


class BagCalibrations:
    """All camera_info of a bag, known before its first image is played.

    What a camera is like does not pass with the moment: many drivers say it once, or at another
    rate, and recordings begin after. Where others publish on the topic, those of the frame_id of
    the images count.

    Args:
        bag: that holds them.
        source: their topic in the bag.
        sources: topics of images.
        images: stamps of the images, ns, increasing.
    """

    def __init__(
        self, bag: Bag, source: str, sources: Collection[str], images: Iterable[int]
    ) -> None:
        found: dict[str, dict[int, bytes]] = {}
        once: dict[bytes, bytes] = {}  # most differ by their stamps alone
        for message in bag.messages([source]):
            try:
                frame, stamp = header_frame(message.cdr), header_stamp_ns(message.cdr)
            except ValueError:
                continue
            body = with_stamp(message.cdr, 0)
            found.setdefault(frame, {})[stamp] = once.setdefault(body, body)
        first = next(iter(bag.messages(sources)), None)
        self._frame = header_frame(first.cdr) if first is not None else ""
        if self._frame in found:
            found = {self._frame: found[self._frame]}
        else:
            self._frame = ""
        self._found = {stamp: body for part in found.values() for stamp, body in part.items()}
        self._stamps = sorted(self._found)
        self._images = list(images)

    def placed(self, messages: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """The messages (under the names of our topics) with a camera_info for each image: as it
        was recorded where it has the stamp of the image, else before the image."""
        stamps = set(self._images)
        for message in messages:
            if message.topic == _INFO and not self._is_used(message.cdr, stamps):
                continue
            if message.topic in IMAGES and self._stamps:
                stamp = header_stamp_ns(message.cdr)
                if stamp not in self._found:
                    cdr = with_stamp(self._at(stamp), stamp)
                    yield message._replace(topic=_INFO, msgtype=TYPE_NAMES[_INFO], cdr=cdr)
            yield message

    def remarks(self) -> list[str]:
        """Sentences on images that have none of their stamp, and on one that changes midway."""
        words = []
        lacking = sum(stamp not in self._found for stamp in self._images)
        if lacking:
            words.append(
                f"{lacking} of {len(self._images)} images have no camera_info of their stamp: the "
                "last one before each is taken, or the first"
            )
        return [*words, *self._change()]

    def _change(self) -> list[str]:
        watch, changes, before = CameraWatch(), 0, b""
        for stamp in self._images if self._stamps else ():
            body = self._at(stamp)
            if body == before:
                continue
            changes, before = changes + bool(before), body
            try:
                watch.add(decode_camera(deserialise(body, TYPE_NAMES[_INFO])), stamp)
            except Exception:  # of many kinds; whoever uses it says what is wrong
                continue
        few = changes <= 1 + _FEW * len(self._images)
        return [watch.doubt] if watch.doubt and few else []

    def _at(self, stamp: int) -> bytes:
        """That which holds at a time, its own stamp 0."""
        return self._found[self._stamps[max(bisect_right(self._stamps, stamp) - 1, 0)]]

    def _is_used(self, cdr: bytes, stamps: set[int]) -> bool:
        try:
            of_camera = not self._frame or header_frame(cdr) == self._frame
            return of_camera and header_stamp_ns(cdr) in stamps
        except ValueError:
            return True  # too short: whoever uses it says so
