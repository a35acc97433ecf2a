"""The views of a bag: image, calibrated camera and mask of each stamp, without any node."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from msg_adapters import View, decode_frame, decode_stamp, deserialise
from occ_recon_ros.errors import UserError
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS, Frame, Pairing
from occ_recon_ros.streams.topics import TYPE_NAMES

from .changes import Changes
from .choice import choose_topics
from .reader import BagMessage, header_frame, open_bag

Progress = Callable[[int, int], None]
"""Told how many views are done, of how many (0: nobody knows)."""

_MOST_WAITING = 64


class BagViews:
    """All whole frames of a bag, in the order of recording. May be iterated again.

    Poses of other stamps than the images' are interpolated.

    Args:
        path: of the bag.
        remaps: {topic of the bag: name it shall have}.
        changes: what is to be taken in place of what the bag holds.

    Attributes:
        bag: as it is.
        topics: {topic of the bag: topic of the nodes} that are read.
        changes: as given; may be set before the next pass.

    Raises:
        UserError: not a bag, or one without images, camera_info or poses.
    """

    def __init__(
        self,
        path: Path,
        remaps: Mapping[str, str] | None = None,
        changes: Changes | None = None,
    ) -> None:
        self.bag = open_bag(path)
        self.topics = choose_topics(self.bag, remaps or {})
        self.changes = changes or Changes()

    def __len__(self) -> int:
        """Number of images, whole frames or not."""
        return sum(
            self.bag.counts[source]
            for source, topic in self.topics.items()
            if topic.startswith("/image")
        )

    def __iter__(self) -> Iterator[View]:
        for frame in self._frames():
            try:
                yield _decoded(frame)
            except ValueError as error:
                raise UserError(f"{self.bag.path}: {error}") from None

    def played(self) -> tuple[str, ...]:
        """The topics of the nodes that there are messages for."""
        return tuple(dict.fromkeys((*self.topics.values(), *self.changes.topics())))

    def messages(self) -> Iterator[BagMessage]:
        """The messages under the names of the nodes' topics, changed as ``changes`` say."""
        recorded = self.bag.messages(self.topics)
        named = (message._replace(topic=self.topics[message.topic]) for message in recorded)
        return self.changes.messages(named, self.object_frame())

    def object_frame(self) -> str:
        """The frame that the poses of the bag are in, "" where they do not say."""
        source = next(source for source, topic in self.topics.items() if topic == "/camera_pose")
        first = next(iter(self.bag.messages([source])), None)
        return header_frame(first.cdr) if first is not None else ""

    def _frames(self) -> Iterator[Frame]:
        pairing = Pairing(
            lambda reason, stamp: None,
            interpolate=True,
            max_pose_gap_ns=MAX_POSE_GAP_NS,
            depth=_MOST_WAITING,
        )
        pairing.await_mask = "/mask" in self.played()
        for recorded in self.messages():
            topic = recorded.topic
            message = deserialise(recorded.cdr, TYPE_NAMES[topic])
            stamp = decode_stamp(message.header.stamp)
            if topic == "/camera_pose_cov":
                continue
            if topic == "/camera_pose":
                yield from pairing.add_pose(stamp, message)
            else:
                part = "image" if topic.startswith("/image") else topic[1:]
                yield from pairing.add(part, stamp, message)


def _decoded(frame: Frame) -> View:
    view = decode_frame(frame)
    for name, pixels in (("image", view.image), ("mask", view.mask)):
        if pixels is not None and pixels.shape[:2] != (view.camera.height, view.camera.width):
            raise ValueError(
                f"the {name} is {pixels.shape[1]}x{pixels.shape[0]}, camera_info says "
                f"{view.camera.width}x{view.camera.height}"
            )
    return view
