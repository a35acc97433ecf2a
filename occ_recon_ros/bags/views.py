"""The views of a bag: image, calibrated camera and mask of each stamp, without any node."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from msg_adapters import View, decode_frame, decode_stamp, deserialise, frame_camera
from msg_adapters.serialised import header_frame
from occ_recon_ros.errors import wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS, Frame, Pairing
from occ_recon_ros.streams.topics import IMAGES, TF, TYPE_NAMES

from .changes import Changes
from .choice import choose_topics
from .order import PlayingOrder
from .reader import BagMessage, open_bag
from .transforms import BagTransforms
from .writer import choose_storage, new_bag

Progress = Callable[[int, int], None]
"""Told how many views are done, of how many (0: nobody knows)."""

OBJECT_FRAME = "turntable"
"""Of the poses, where nothing else is said."""

_MOST_WAITING = 64


def doing(progress: Progress, what: str) -> None:
    """Say what is done now in a part of the work, of which counts begin anew, to whoever shows it:
    one with a method ``doing``. A plain function is not told."""
    if (told := getattr(progress, "doing", None)) is not None:
        told(what)


class BagViews:
    """All whole frames of a bag, as ``PlayingOrder`` puts them. May be iterated again.

    Poses of other stamps than the images' are interpolated.

    Args:
        path: of the bag.
        remaps: {topic of the bag: name it shall have}.
        changes: what is to be taken in place of what the bag holds.
        object_frame: that poses are taken in from /tf, where the bag holds no camera_pose.

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
        object_frame: str = OBJECT_FRAME,
    ) -> None:
        self.bag = open_bag(path)
        self.topics = choose_topics(self.bag, remaps or {})
        self.changes = changes or Changes()
        by_tf = {source: name for source, name in self.topics.items() if name in TF}
        self._wanted_frame = object_frame
        self._transforms = BagTransforms(self.bag, by_tf) if by_tf else None
        if self._transforms is not None:
            self.topics = {s: name for s, name in self.topics.items() if name not in TF}
            images = [s for s, name in self.topics.items() if name in IMAGES]
            self._transforms.check(self.bag, images, object_frame)

    def __len__(self) -> int:
        """Number of images, whole frames or not."""
        return self._order.images

    def __iter__(self) -> Iterator[View]:
        for frame in self._frames():
            with wrong_in(self.bag.path):
                view = _decoded(frame)
            yield view

    def some(self, numbers: Collection[int]) -> Iterator[View]:
        """The views of these numbers; others are not decoded."""
        for k, frame in enumerate(self._frames()):
            if k in numbers:
                with wrong_in(self.bag.path):
                    view = _decoded(frame)
                yield view

    def cameras(self) -> dict[int, Camera]:
        """Calibration and pose of each whole frame by the stamp of its image (ns).

        Raises:
            UserError: camera_info or a pose that cannot be used.
        """
        with wrong_in(self.bag.path):
            return {frame.stamp_ns: frame_camera(frame) for frame in self._frames()}

    def played(self) -> tuple[str, ...]:
        """The topics of the nodes that there are messages for."""
        by_tf = ("/camera_pose",) if self._transforms is not None else ()
        return tuple(dict.fromkeys((*self.topics.values(), *by_tf, *self.changes.topics())))

    def masked(self) -> bool:
        """Whether masks come with the images."""
        return any(topic.startswith("/mask") for topic in self.played())

    def images(self) -> list[dict[str, Any]]:
        """Of the image of each whole frame, in their order, ``stamp_ns`` and the ``name`` of the
        file that it came from, "" where it has none; an empty list where the bag tells of none."""
        names = self.bag.names
        stamps = self._stamps if names else ()
        return [{"stamp_ns": stamp, "name": names.get(stamp, "")} for stamp in stamps]

    def remarks(self) -> list[str]:
        """Sentences on what is not played as it was recorded."""
        return self._order.remarks()

    def messages(self) -> Iterator[BagMessage]:
        """The messages under the names of the nodes' topics, changed as ``changes`` say."""
        recorded = self._order.messages(self.bag.messages(self.topics))
        named: Iterable[BagMessage] = (
            message._replace(topic=self.topics[message.topic]) for message in recorded
        )
        if self._transforms is not None:
            named = self._transforms.poses(named, self._wanted_frame)
        return self.changes.messages(named, self.object_frame())

    def write(self, path: Path, storage: str | None = None, overwrite: bool = False) -> None:
        """Write these messages as a bag.

        Raises:
            UserError: it cannot be written.
        """
        with new_bag(path, choose_storage(path, storage), overwrite) as writer:
            for message in self.messages():
                writer.write(message.topic, TYPE_NAMES[message.topic], message.time_ns, message.cdr)
            writer.name_images(self.bag.names)

    def object_frame(self) -> str:
        """The frame that the poses of the bag are in, "" where they do not say."""
        if self._transforms is not None:
            return self._wanted_frame
        source = next(source for source, topic in self.topics.items() if topic == "/camera_pose")
        first = next(iter(self.bag.messages([source])), None)
        return header_frame(first.cdr) if first is not None else ""

    @cached_property
    def _order(self) -> PlayingOrder:
        images = [source for source, name in self.topics.items() if name in IMAGES]
        return PlayingOrder(self.bag.messages(self.topics), images)

    @cached_property
    def _stamps(self) -> list[int]:
        """Of the images of the whole frames, ns."""
        return [frame.stamp_ns for frame in self._frames()]

    def _frames(self) -> Iterator[Frame]:
        pairing = Pairing(
            lambda reason, stamp: None,
            interpolate=True,
            max_pose_gap_ns=MAX_POSE_GAP_NS,
            depth=_MOST_WAITING,
        )
        pairing.await_mask = self.masked()
        pairing.spare_mask = True  # some images may have come without
        for recorded in self.messages():
            topic = recorded.topic
            message = deserialise(recorded.cdr, TYPE_NAMES[topic])
            stamp = decode_stamp(message.header.stamp)
            if topic == "/camera_pose_cov":
                continue
            if topic == "/camera_pose":
                yield from pairing.add_pose(stamp, message)
            else:
                part = topic[1:].removesuffix("/compressed")
                yield from pairing.add(part, stamp, message)
        yield from pairing.flush()


def _decoded(frame: Frame) -> View:
    view = decode_frame(frame)
    for name, pixels in (("image", view.image), ("mask", view.mask)):
        if pixels is not None and pixels.shape[:2] != (view.camera.height, view.camera.width):
            raise ValueError(
                f"the {name} is {pixels.shape[1]}x{pixels.shape[0]}, camera_info says "
                f"{view.camera.width}x{view.camera.height}"
            )
    return view
