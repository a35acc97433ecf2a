"""The views of a bag: image, calibrated camera and mask of each stamp, without any node."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import View, decode_frame, decode_stamp, deserialise, frame_camera
from msg_adapters.serialised import header_stamp_ns, with_stamp
from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.pairing import Frame, Pairing
from occ_recon_ros.streams.stamp_watch import StampWatch
from occ_recon_ros.streams.topics import IMAGES, TF, TYPE_NAMES

from .calibrations import BagCalibrations
from .changes import Changes
from .choice import choose_topics
from .order import PlayingOrder
from .poses import AS_USUAL, BagPoses, PoseReading
from .reader import BagMessage, open_bag
from .transforms import BagTransforms
from .writer import choose_storage, new_bag

Progress = Callable[[int, int], None]
"""Told how many views are done, of how many (0: nobody knows)."""

_MOST_WAITING = 64


def doing(progress: Progress, what: str) -> None:
    """Say what is done now in a part of the work, of which counts begin anew, to whoever shows it:
    one with a method ``doing``. A plain function is not told."""
    if (told := getattr(progress, "doing", None)) is not None:
        told(what)


class BagViews:
    """All whole frames of a bag, as ``PlayingOrder`` puts them. May be iterated again.

    An image of whose stamp there is no pose has that between the poses around it, one without
    camera_info the last before it.

    Args:
        path: of the bag.
        remaps: {topic of the bag: name it shall have}.
        reading: how images get their poses.

    Attributes:
        bag: as it is.
        topics: {topic of the bag: topic of the nodes} that are read.
        changes: what is taken in place of what the bag holds; may be set before the next pass.
        meant: what the bag should hold, where its poses are those of other images: all changes are
            on top of it; may be set before the first pass that finds any.
        left_out: stamps of images (ns) that are as if they were not in the bag; may grow before the
            next pass, and views are then numbered without them.

    Raises:
        UserError: not a bag, or one without images, camera_info or poses.
    """

    def __init__(
        self,
        path: Path,
        remaps: Mapping[str, str] | None = None,
        reading: PoseReading = AS_USUAL,
    ) -> None:
        self.bag = open_bag(path)
        self.topics = choose_topics(self.bag, remaps or {})
        self.changes = self.meant = Changes()
        self.left_out: frozenset[int] = frozenset()
        self._reading = reading
        self._remaps = dict(remaps or {})
        by_tf = {source: name for source, name in self.topics.items() if name in TF}
        self._transforms = BagTransforms(self.bag, by_tf, reading) if by_tf else None
        if self._transforms is not None:
            self.topics = {s: name for s, name in self.topics.items() if name not in TF}
            images = [s for s, name in self.topics.items() if name in IMAGES]
            _ = self._order  # which finds out whether they have stamps
            self._transforms.check(self.bag, images)

    def __len__(self) -> int:
        """Number of images, whole frames or not."""
        return self._order.images - len(self.left_out)

    def __iter__(self) -> Iterator[View]:
        return map(self._decoded, self._frames())

    def some(self, numbers: Collection[int]) -> Iterator[View]:
        """The views of these numbers; others are not decoded."""
        return (self._decoded(frame) for k, frame in enumerate(self._frames()) if k in numbers)

    def cameras(self) -> dict[int, Camera]:
        """Calibration and pose of each whole frame by the stamp of its image (ns).

        Raises:
            UserError: camera_info or a pose that cannot be used.
        """
        with wrong_in(self.bag.path):
            return {frame.stamp_ns: frame_camera(frame) for frame in self._frames()}

    @cached_property
    def recorded_cameras(self) -> dict[int, Camera]:
        """The same as the bag holds them, whatever is taken in their place."""
        known = self.changes, self.meant
        self.changes = self.meant = Changes()
        try:
            return self.cameras()
        finally:
            self.changes, self.meant = known

    def played(self) -> tuple[str, ...]:
        """The topics of the nodes that there are messages for."""
        by_tf = ("/camera_pose",) if self._transforms is not None else ()
        return tuple(dict.fromkeys((*self.topics.values(), *by_tf, *self._taken.topics())))

    def masked(self) -> bool:
        """Whether masks come with the images."""
        return any(topic.startswith("/mask") for topic in self.played())

    def images(self) -> list[dict[str, Any]]:
        """Of the image of each whole frame, in their order, ``stamp_ns`` and the ``name`` of the
        file that it came from, "" where it has none; an empty list where the bag tells of none."""
        names = self.bag.names
        stamps = self._stamps if names else ()
        return [
            {"stamp_ns": stamp, "name": names.get(stamp, "")}
            for stamp in stamps
            if stamp not in self.left_out
        ]

    def told_of_masks(self) -> dict[str, Any]:
        """What whoever found the masks of the bag thinks of them, as ``read_told``; nothing where
        nobody said, or others are taken in their place."""
        return {} if self._taken.masks is not None else self.bag.told_of_masks

    def remarks(self) -> list[str]:
        """Sentences on what is not played as it was recorded.

        Raises:
            UserError: no image has a pose, or none a mask though masks came.
        """
        self._refuse_apart()
        chosen = [
            f"{source} is taken for {name}"
            for source, name in self.topics.items()
            if source != name and source not in self._remaps
        ]
        named = [", ".join(chosen)] if chosen else []
        ordered = self._order.remarks()
        if unstamped := ", ".join(sorted(self._unstamped)):
            named.append(f"all stamps of {unstamped} are 0: the times of recording are taken")
        with_poses = self._poses.remarks() if self._transforms is None else []
        with_infos = self._calibrations.remarks()
        return [*named, *ordered, *with_infos, *with_poses]

    def messages(self) -> Iterator[BagMessage]:
        """The messages under the names of the nodes' topics, changed as ``changes`` say."""
        recorded = self._order.messages(self.bag.messages(self.topics))
        named: Iterable[BagMessage] = (
            message._replace(topic=self.topics[message.topic]) for message in recorded
        )
        named = self._calibrations.placed(named)
        if self._transforms is not None:
            named = self._transforms.placed(named)
        else:
            named = self._poses.placed(named)
        if self.left_out:
            named = (m for m in named if header_stamp_ns(m.cdr) not in self.left_out)
        return self._taken.messages(named, self.object_frame())

    def write(
        self,
        path: Path,
        storage: str | None = None,
        overwrite: bool = False,
        told: Mapping[str, Any] | None = None,
    ) -> None:
        """Write these messages as a bag.

        Args:
            path: of the bag.
            storage: as ``choose_storage``.
            overwrite: whether a bag that is there may be replaced.
            told: what is to be thought of its masks, as ``read_told``; None: as this bag says of
                its own.

        Raises:
            UserError: it cannot be written.
        """
        with new_bag(path, choose_storage(path, storage), overwrite) as writer:
            for message in self.messages():
                writer.write(message.topic, TYPE_NAMES[message.topic], message.time_ns, message.cdr)
            writer.name_images(self.bag.names)
            writer.tell_of_masks(self.told_of_masks() if told is None else told)

    def object_frame(self) -> str:
        """The frame that the poses of the bag are in, "" where they do not say."""
        return self._reading.object_frame if self._transforms else self._poses.frame

    @property
    def _taken(self) -> Changes:
        return self.meant.then(self.changes)

    @cached_property
    def _order(self) -> PlayingOrder:
        images = [source for source, name in self.topics.items() if name in IMAGES]
        order = PlayingOrder(self.bag.messages(self.topics), images)
        standing = {s for s, found in order.stamps.items() if not found.any()}
        # One message alone of stamp 0 holds for all times, as a camera_info does.
        self._unstamped = {s for s in standing if self.bag.counts[s] > 1}
        if not self._unstamped:
            return order
        self.bag.change = self._timed
        return PlayingOrder(self.bag.messages(self.topics), images)

    def _timed(self, message: BagMessage) -> BagMessage:
        """With the time of recording as the stamp, where a topic has none."""
        if message.topic not in self._unstamped:
            return message
        try:
            return message._replace(cdr=with_stamp(message.cdr, message.time_ns))
        except ValueError:  # too short to have one, which whoever uses it says
            return message

    @cached_property
    def _stamps(self) -> list[int]:
        """Of the images of the whole frames, ns."""
        return [frame.stamp_ns for frame in self._frames()]

    @cached_property
    def _calibrations(self) -> BagCalibrations:
        images = [source for source, name in self.topics.items() if name in IMAGES]
        source = self._source("/camera_info")
        return BagCalibrations(self.bag, source, images, self._image_stamps().tolist())

    @cached_property
    def _poses(self) -> BagPoses:
        source = self._source("/camera_pose")
        return BagPoses(self.bag, source, self._image_stamps(), self._reading)

    def _source(self, topic: str) -> str:
        """The topic of the bag that serves as one of the nodes'."""
        return next(source for source, name in self.topics.items() if name == topic)

    def _image_stamps(self) -> NDArray[np.int64]:
        """Of all images, whole frames or not, ns, increasing."""
        found = [self._order.stamps.get(s, ()) for s, name in self.topics.items() if name in IMAGES]
        return np.unique(np.concatenate([np.array(part, np.int64) for part in found]))

    def _refuse_apart(self) -> None:
        """
        Raises:
            UserError: masks came, and none has the stamp of an image.
        """
        images = self._image_stamps()
        for source, name in self.topics.items():
            stamps = self._order.stamps.get(source, np.zeros(0, np.int64))
            if not name.startswith("/mask") or np.isin(images, stamps).any():
                continue
            watch = StampWatch()
            for topic, found in (("image", images), ("mask", stamps)):
                for stamp in found.tolist():
                    watch.note(topic, stamp)
            raise UserError(f"{self.bag.path}: {watch.why(('mask',), _MOST_WAITING)}")

    def _frames(self) -> Iterator[Frame]:
        pairing = Pairing(depth=_MOST_WAITING)
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

    def _decoded(self, frame: Frame) -> View:
        with wrong_in(self.bag.path):
            view = decode_frame(frame)
            size = view.camera.width, view.camera.height
            for name, pixels in (("image", view.image), ("mask", view.mask)):
                if pixels is not None and pixels.shape[1::-1] != size:
                    raise ValueError(
                        f"the {name} is {pixels.shape[1]}x{pixels.shape[0]}, camera_info says "
                        f"{size[0]}x{size[1]}"
                    )
        return view
