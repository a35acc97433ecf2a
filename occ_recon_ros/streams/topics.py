"""The topics that a rig publishes: names and message types."""

from __future__ import annotations

from collections.abc import Mapping

IMAGES = ("/image", "/image/compressed")
"""An image comes on one of these."""

_IMAGE = "sensor_msgs/msg/Image"
TYPE_NAMES: Mapping[str, str] = {
    "/image": _IMAGE,
    "/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera_pose": "geometry_msgs/msg/PoseStamped",
    "/mask": _IMAGE,
}
