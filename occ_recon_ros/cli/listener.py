"""What goes into the pipeline and what comes out, as heard on its topics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from msg_adapters import decode_contours, decode_rim, decode_stamp, serialise
from occ_recon_ros.nodes.qos import reliable
from occ_recon_ros.report.heard import Heard, KeptView
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS, Frame, Pairing

_DEPTH = 1000
_INFOS_KEPT = 50


class Listener(Node):
    """Keeps all contours and rims, and a few whole frames for pictures.

    Attributes:
        heard: what was kept.
    """

    def __init__(
        self,
        keep_view: Callable[[int], bool],
        max_pose_gap_ns: int = MAX_POSE_GAP_NS,
        folder: Path | None = None,
        **kwargs: Any,
    ) -> None:
        """Args:
        keep_view: says of the n-th image whether it is kept.
        max_pose_gap_ns: as that of contour_tracker: a kept image gets the pose that it had there.
        folder: for what is too much for memory.
        """
        super().__init__("occ_recon", **kwargs)
        self._keep_view = keep_view
        self._pairing = Pairing(
            interpolate=True, max_pose_gap_ns=max_pose_gap_ns, depth=_INFOS_KEPT
        )
        self.heard = Heard(folder)
        for topic, kind, handle in (
            ("image", Image, self._on_image),
            ("image/compressed", CompressedImage, self._on_image),
            ("camera_info", CameraInfo, self._on_info),
            ("camera_pose", PoseStamped, self._on_pose),
            ("contours", PointCloud2, self._on_contours),
            ("rim", PointCloud2, self._on_rim),
        ):
            qos: QoSProfile = reliable(_DEPTH if kind is PointCloud2 else 20)
            self.create_subscription(kind, topic, handle, qos)

    def _on_image(self, msg: Any) -> None:
        if self._keep_view(self.heard.images):
            stamp = decode_stamp(msg.header.stamp)
            self.heard.views[stamp] = KeptView(msg)
            self._note(self._pairing.add("image", stamp, msg))
        self.heard.images += 1

    def _on_info(self, msg: CameraInfo) -> None:
        stamp = decode_stamp(msg.header.stamp)
        self.heard.sizes[stamp] = int(msg.width), int(msg.height)
        self._note(self._pairing.add("camera_info", stamp, msg))

    def _on_pose(self, msg: PoseStamped) -> None:
        self._note(self._pairing.add_pose(decode_stamp(msg.header.stamp), msg))

    def _note(self, whole: list[Frame]) -> None:
        for frame in whole:
            self.heard.views[frame.stamp_ns].frame = frame

    def _on_contours(self, msg: PointCloud2) -> None:
        contours = decode_contours(msg)
        if len(contours):  # none: a new scan begins
            self.heard.add_contours(contours, serialise(msg))

    def _on_rim(self, msg: PointCloud2) -> None:
        self.heard.add_rim(decode_rim(msg), serialise(msg))
