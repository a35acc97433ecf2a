"""virtual_turntable: a rig that is not there, whose object is known exactly."""

import sys
from dataclasses import fields
from typing import Any, TypeVar

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import CameraInfo, Image

from msg_adapters import encode_camera_info, encode_image, encode_pose
from msg_adapters.transforms import encode_transform
from occ_recon_ros.scene import (
    RenderSettings,
    TurntableSettings,
    make_object,
    render,
    turntable_cameras,
)

from .base import PipelineNode
from .main import run_node
from .qos import reliable, sensor, tf_type
from .settings import VirtualTurntableSettings

Group = TypeVar("Group")


class VirtualTurntableNode(PipelineNode[VirtualTurntableSettings]):
    """Publishes image, camera_info and camera_pose of an object on a turntable.

    It begins when someone listens to the images, and ends after one run.

    Attributes:
        object: the scene object, which knows its true surface.
        cameras: the views, one a frame.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("virtual_turntable", VirtualTurntableSettings, **kwargs)
        self.object = make_object(self.settings.object)
        self.cameras = turntable_cameras(_group(self.settings, TurntableSettings))
        self._next = 0
        self.advertise(CameraInfo, "camera_info", sensor())
        self._pose = self.advertise(PoseStamped, "camera_pose", reliable(100))
        self._image = self.advertise(Image, "image", sensor())
        self._tf_message = tf_type() if self.settings.broadcast_tf else None
        if self._tf_message is not None:
            self.advertise(self._tf_message, "/tf", reliable(100))
        if self.settings.frame_rate > 0:
            self.create_timer(1 / self.settings.frame_rate, self._tick)
        self.warn_of_unknown_parameters()

    def counts_later(self, old: VirtualTurntableSettings, new: VirtualTurntableSettings) -> str:
        """The cameras are placed and the timer is made at the start."""
        table = _group(new, TurntableSettings) != _group(old, TurntableSettings)
        again = table or new.frame_rate != old.frame_rate
        return "takes effect when the node is started again" if again else ""

    def publish_frame(self, index: int, stamp_ns: int) -> None:
        """Publish one view: camera_info and camera_pose, then the image that completes them."""
        camera, own, world = self.cameras[index], self.settings.camera_frame, self.settings
        with self.stages.timed("render"):
            rendering = _group(world, RenderSettings)
            pixels = render(self.object, camera, rendering, seed=world.seed + index)
        self.send("camera_info", encode_camera_info(camera, stamp_ns, own))
        pose = encode_pose(camera, stamp_ns, world.object_frame)
        self.send("camera_pose", pose)
        if self._tf_message is not None:
            transform = encode_transform(camera.pose, stamp_ns, world.object_frame, own)
            self.send("/tf", self._tf_message(transforms=[transform]))
        self.send("image", encode_image(pixels, stamp_ns, own))

    def _tick(self) -> None:
        listened = self._image.get_subscription_count() and self._pose.get_subscription_count()
        if self._next < len(self.cameras) and listened:
            self.publish_frame(self._next, self.get_clock().now().nanoseconds)
            self._next += 1
            if self._next == len(self.cameras):
                self.get_logger().info(f"the run of {self._next} frames is over")

    def figures(self) -> dict[str, Any]:
        """How far the run is."""
        return {"frames published": self._next, "frames": len(self.cameras)}


def _group(settings: VirtualTurntableSettings, kind: type[Group]) -> Group:
    """The settings of one part."""
    return kind(**{item.name: getattr(settings, item.name) for item in fields(kind)})  # type: ignore[arg-type]


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(VirtualTurntableNode)


if __name__ == "__main__":
    sys.exit(main())
