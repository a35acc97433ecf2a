"""Masks, poses and calibration that a step found, in place of those that a bag holds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_adapters import encode_camera_info, encode_image, encode_pose, serialise
from msg_adapters.serialised import header_frame, header_stamp_ns
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.topics import IMAGES, TYPE_NAMES

from .reader import BagMessage

_COVARIANCE = "/camera_pose_cov"


@dataclass(frozen=True)
class Changes:
    """What a first pass over the views of a bag found. Where it says something, the messages of
    the bag of that kind are left out: an image that it says nothing of has none.

    Attributes:
        masks: (h, w) uint8 by the stamp of the image (ns), 0 = background; None: as the bag.
        cameras: calibration and pose in the object frame by stamp; None: as the bag.
    """

    masks: Mapping[int, NDArray[np.uint8]] | None = None
    cameras: Mapping[int, Camera] | None = None

    def then(self, later: Changes) -> Changes:
        """These changes, and on top of them those of a later step."""
        return Changes(
            self.masks if later.masks is None else later.masks,
            self.cameras if later.cameras is None else later.cameras,
        )

    def topics(self) -> tuple[str, ...]:
        """The topics that come from here and not from the bag."""
        masks = () if self.masks is None else ("/mask",)
        return masks if self.cameras is None else (*masks, "/camera_info", "/camera_pose")

    def messages(self, messages: Iterable[BagMessage], object_frame: str) -> Iterator[BagMessage]:
        """The messages of a bag (under the names of our topics), changed.

        Args:
            messages: in order of recording.
            object_frame: of the poses.
        """
        replaced = self.topics()
        for message in messages:
            # A covariance of the bag is not that of another pose.
            topic = message.topic.removesuffix("/compressed")
            if topic in replaced or (self.cameras and topic == _COVARIANCE):
                continue
            if message.topic in IMAGES and replaced:
                yield from self._of_image(message, object_frame)
            yield message

    def _of_image(self, image: BagMessage, object_frame: str) -> Iterator[BagMessage]:
        """What goes before an image."""
        stamp, frame = header_stamp_ns(image.cdr), header_frame(image.cdr)
        found = {}
        if self.cameras is not None and stamp in self.cameras:
            camera = self.cameras[stamp]
            found["/camera_info"] = encode_camera_info(camera, stamp, frame)
            found["/camera_pose"] = encode_pose(camera, stamp, object_frame)
        if self.masks is not None and stamp in self.masks:
            found["/mask"] = encode_image(self.masks[stamp], stamp, frame)
        for topic, message in found.items():
            yield image._replace(topic=topic, msgtype=TYPE_NAMES[topic], cdr=serialise(message))
