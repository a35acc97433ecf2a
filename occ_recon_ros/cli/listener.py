"""What goes into the pipeline and what comes out, as heard on its topics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from msg_adapters import (
    decode_camera,
    decode_compressed,
    decode_contours,
    decode_image,
    decode_pose,
    decode_rim,
    decode_stamp,
)
from occ_recon_ros.geometry import Camera, Contours, Rim
from occ_recon_ros.nodes.qos import reliable

_DEPTH = 1000
_INFOS_KEPT = 50


@dataclass
class View:
    """One frame that is kept to be shown."""

    image: Image | CompressedImage
    parts: dict[str, Any] = field(default_factory=dict)

    def pixels(self) -> NDArray[Any]:
        """(h, w) or (h, w, 3) BGR."""
        compressed = isinstance(self.image, CompressedImage)
        return decode_compressed(self.image) if compressed else decode_image(self.image)

    def camera(self) -> Camera | None:
        """The calibrated view; None where info or pose of this stamp did not come."""
        if not {"camera_info", "camera_pose"} <= self.parts.keys():
            return None
        return decode_camera(self.parts["camera_info"], decode_pose(self.parts["camera_pose"]))


class Listener(Node):
    """Keeps all rims, a summary of all contours, and a few whole frames for pictures.

    Attributes:
        samples: number of contour samples by stamp (ns).
        loops: number of loops by stamp.
        centres: (3,) camera centre by stamp, metres, object frame.
        contours: by stamp, where ``keep_contours`` says so and of the kept views.
        rims: by stamp; a later one of the same stamp replaces the earlier.
        views: kept frames by stamp.
        images: images heard.
        strips: strip messages heard.
        triangles: triangles in them.
    """

    def __init__(
        self, keep_view: Callable[[int], bool], keep_contours: bool = False, **kwargs: Any
    ) -> None:
        """Args: keep_view: says of the n-th image whether it is kept."""
        super().__init__("occ_recon", **kwargs)
        self._keep_view = keep_view
        self._keep_contours = keep_contours
        self._waiting: dict[int, dict[str, Any]] = {}
        self.samples: dict[int, int] = {}
        self.loops: dict[int, int] = {}
        self.centres: dict[int, NDArray[np.float64]] = {}
        self.contours: dict[int, Contours] = {}
        self.rims: dict[int, Rim] = {}
        self.views: dict[int, View] = {}
        self.images = 0
        self.strips = 0
        self.triangles = 0
        for topic, kind, handle in (
            ("image", Image, self._on_image),
            ("image/compressed", CompressedImage, self._on_image),
            ("camera_info", CameraInfo, lambda msg: self._on_part("camera_info", msg)),
            ("camera_pose", PoseStamped, lambda msg: self._on_part("camera_pose", msg)),
            ("contours", PointCloud2, self._on_contours),
            ("rim", PointCloud2, self._on_rim),
            ("strip", PointCloud2, self._on_strip),
        ):
            qos: QoSProfile = reliable(_DEPTH if kind is PointCloud2 else 20)
            self.create_subscription(kind, topic, handle, qos)

    def _on_image(self, msg: Any) -> None:
        if self._keep_view(self.images):
            stamp = decode_stamp(msg.header.stamp)
            self.views[stamp] = View(msg, self._waiting.get(stamp, {}))
        self.images += 1

    def _on_part(self, part: str, msg: Any) -> None:
        stamp = decode_stamp(msg.header.stamp)
        if stamp in self.views:
            self.views[stamp].parts[part] = msg
            return
        self._waiting.setdefault(stamp, {})[part] = msg
        if len(self._waiting) > _INFOS_KEPT:
            del self._waiting[next(iter(self._waiting))]

    def _on_contours(self, msg: PointCloud2) -> None:
        contours = decode_contours(msg)
        stamp = contours.stamp_ns
        if not len(contours):  # a new scan begins
            return
        self.samples[stamp] = len(contours)
        self.loops[stamp] = len(contours.loop_starts) - 1
        self.centres[stamp] = contours.centre
        if self._keep_contours or stamp in self.views:
            self.contours[stamp] = contours

    def _on_rim(self, msg: PointCloud2) -> None:
        rim = decode_rim(msg)
        if len(rim):
            self.rims[rim.stamp_ns] = rim
        else:  # time went back: the rims of the scan before are no longer part of the surface
            self.rims.clear()

    def _on_strip(self, msg: PointCloud2) -> None:
        self.strips += 1
        self.triangles += int(msg.height)
