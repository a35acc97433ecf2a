"""The images that give the surface its colour, as the mesher hears them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from msg_adapters import decode_stamp, frame_camera, frame_image
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.pairing import Frame, Pairing
from occ_recon_ros.streams.scan_order import ScanOrder
from occ_recon_ros.surface import ViewColours, reduced_camera

from .base import PipelineNode, named
from .checkpoint import Arrays
from .qos import compressed_topic, reliable, sensor

_MOST_PIXELS = 750_000


@dataclass(frozen=True, eq=False)
class ColourView:
    """An image that colours.

    Attributes:
        stamp_ns: of the image, nanoseconds.
        image: (h, w, 3) uint8, red green blue.
        camera: of its size.
    """

    stamp_ns: int
    image: NDArray[np.uint8]
    camera: Camera

    @property
    def name(self) -> str:
        """By which a checkpoint knows it."""
        return f"view {self.stamp_ns}"

    def state(self) -> Arrays:
        """Arrays to be kept on disk."""
        camera = {f.name: np.asarray(getattr(self.camera, f.name)) for f in fields(Camera)}
        return {"stamp": np.array(self.stamp_ns), "image": self.image, **camera}

    @staticmethod
    def of(state: Arrays) -> ColourView:
        """The view of a state."""
        given: dict[str, Any] = {f.name: state[f.name] for f in fields(Camera)}
        for name, kind in (("width", int), ("height", int), ("distortion", str)):
            given[name] = kind(given[name])
        return ColourView(int(state["stamp"]), state["image"], Camera(**given))


class Colouring:
    """Subscribes to images, their calibration and poses, and keeps the views that tell most.

    Whatever lacks here is no drop: contour_tracker hears the same messages and counts them.

    Args:
        node: that hears them.
        object_frame: frame of the poses.

    Attributes:
        views: those of the scan that goes on.
        grey: images without colour that came.
        on_view: told of each view that is kept, and of the stamp of its image.
    """

    def __init__(self, node: PipelineNode[Any], object_frame: str) -> None:
        self._node = node
        self._object_frame = object_frame
        self.on_view: Callable[[ColourView], None] = lambda view: None
        self.clear()
        self._compressed = compressed_topic(node, "image")
        node.subscribe(Image, "image", self._on_image, sensor())
        node.subscribe(CompressedImage, self._compressed, self._on_image, sensor())
        node.subscribe(CameraInfo, "camera_info", self._on_info, sensor())
        node.subscribe(PoseStamped, "camera_pose", self._on_pose, reliable(100))

    def clear(self) -> None:
        """Forget all views: a new scan begins."""
        self.views = ViewColours()
        self.grey = 0
        self._kept: list[ColourView] = []
        self._pairing = Pairing(interpolate=True)
        self._order = ScanOrder[Frame]()

    def kept(self) -> list[ColourView]:
        """The views of the scan that goes on."""
        there = {id(image) for image, _ in self.views.kept()}
        self._kept = [view for view in self._kept if id(view.image) in there]
        return self._kept

    def recall(self, state: Arrays) -> ColourView:
        """Take in again a view that is kept on disk, as ``ColourView.state`` has it."""
        view = ColourView.of(state)
        self._add(view)
        return view

    def _add(self, view: ColourView) -> None:
        self.views.add(view.image, view.camera)
        self._kept.append(view)

    def _on_image(self, msg: Image | CompressedImage) -> None:
        self._take(self._pairing.add("image", decode_stamp(msg.header.stamp), msg))

    def _on_info(self, msg: CameraInfo) -> None:
        self._take(self._pairing.add("camera_info", decode_stamp(msg.header.stamp), msg))

    def _on_pose(self, msg: PoseStamped) -> None:
        if msg.header.frame_id == self._object_frame:
            self._take(self._pairing.add_pose(decode_stamp(msg.header.stamp), msg))

    def _take(self, frames: list[Frame]) -> None:
        for frame in frames:
            time_went_back, due = self._order.add(frame.stamp_ns, frame)
            if time_went_back:
                self._pairing.forget_after(due[-1].stamp_ns)
                self.views, self._kept = ViewColours(), []
            for one in due:
                with self._node.stages.timed("view"):
                    self._keep(one)

    def _keep(self, frame: Frame) -> None:
        camera = frame_camera(frame)
        if not self.views.wants(camera):
            return
        image = frame_image(frame)
        if image.ndim == 2:
            self.grey += 1
            return
        if image.dtype == np.uint16:
            image = (image >> 8).astype(np.uint8)
        smaller = min(1.0, (_MOST_PIXELS / (camera.width * camera.height)) ** 0.5)
        size = max(1, round(camera.width * smaller)), max(1, round(camera.height * smaller))
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        with named("image"):
            if image.shape[1::-1] != (camera.width, camera.height):
                raise ValueError(f"is {image.shape[1]}x{image.shape[0]}, not as camera_info says")
            if size != (camera.width, camera.height):
                image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            smaller_camera = reduced_camera(camera, *size)
            view = ColourView(frame.stamp_ns, np.asarray(image, np.uint8), smaller_camera)
            self._add(view)
            self.on_view(view)
