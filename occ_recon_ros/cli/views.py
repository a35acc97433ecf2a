"""The views of a bag: image, calibrated camera and mask of each stamp, without any node."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from msg_adapters import (
    decode_camera,
    decode_compressed,
    decode_image,
    decode_mask,
    decode_pose,
    decode_stamp,
)
from occ_recon_ros.geometry import Camera
from occ_recon_ros.nodes.pairing import Frame, Pairing

from .bags import open_bag
from .drive import TYPES
from .errors import UserError
from .topics import choose_topics

_MAX_POSE_GAP_NS = 200_000_000
_MOST_WAITING = 64


@dataclass(frozen=True, eq=False)
class View:
    """One frame of a bag.

    Attributes:
        stamp_ns: nanoseconds.
        camera: as calibrated, in the object frame.
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        mask: (h, w) uint8, 0 = background, or None.
    """

    stamp_ns: int
    camera: Camera
    image: NDArray[Any]
    mask: NDArray[np.uint8] | None


class BagViews:
    """All whole frames of a bag, in the order of recording. May be iterated again.

    Poses of other stamps than the images' are interpolated.

    Raises:
        UserError: not a bag, or one without images, camera_info or poses.
    """

    def __init__(self, path: Path, remaps: dict[str, str] | None = None) -> None:
        self._bag = open_bag(path)
        self._topics = choose_topics(self._bag, remaps or {})

    def __len__(self) -> int:
        """Number of images, whole frames or not."""
        return sum(
            self._bag.counts[source]
            for source, topic in self._topics.items()
            if topic.startswith("/image")
        )

    def __iter__(self) -> Iterator[View]:
        for frame in self._frames():
            try:
                yield _decoded(frame)
            except ValueError as error:
                raise UserError(f"{self._bag.path}: {error}") from None

    def _frames(self) -> Iterator[Frame]:
        pairing = Pairing(
            lambda reason, stamp: None,
            interpolate=True,
            max_pose_gap_ns=_MAX_POSE_GAP_NS,
            depth=_MOST_WAITING,
        )
        pairing.await_mask = "/mask" in self._topics.values()
        for recorded in self._bag.messages(self._topics):
            topic = self._topics[recorded.topic]
            message = deserialize_message(recorded.cdr, TYPES[topic])
            stamp = decode_stamp(message.header.stamp)
            if topic == "/camera_pose":
                yield from pairing.add_pose(stamp, message)
            else:
                part = "image" if topic.startswith("/image") else topic[1:]
                yield from pairing.add(part, stamp, message)


def _decoded(frame: Frame) -> View:
    pose = decode_pose(frame.poses[0])
    if len(frame.poses) == 2:
        pose = pose.towards(decode_pose(frame.poses[1]), frame.fraction)
    camera = decode_camera(frame.parts["camera_info"], pose)
    picture = frame.parts["image"]
    image = decode_compressed(picture) if hasattr(picture, "format") else decode_image(picture)
    mask = decode_mask(frame.parts["mask"]) if "mask" in frame.parts else None
    for name, pixels in (("image", image), ("mask", mask)):
        if pixels is not None and pixels.shape[:2] != (camera.height, camera.width):
            raise ValueError(
                f"the {name} is {pixels.shape[1]}x{pixels.shape[0]}, camera_info says "
                f"{camera.width}x{camera.height}"
            )
    return View(frame.stamp_ns, camera, image, mask)
