"""The one table of topics: what each is called, holds and promises, who sends and who hears it.

Recording, replaying, the choice of a bag's topics, the launch file, the reference, the layouts for
RViz and Foxglove and what the viewer shows follow from it; a test holds the nodes against it.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """A row of the table.

    Attributes:
        name: relative to the namespace of the nodes, or absolute with a leading slash.
        type_name: package/msg/Type.
        sources: who sends it: nodes of ours, or "rig" for what the camera and the table bring.
        readers: the nodes of ours that hear it, some of them only where parameters ask for it.
        doc: what it is for.
        depth: messages that may wait; a reader may ask for more.
        reliable: sent again until it arrives.
        latched: the newest ones are kept for who comes late (transient local).
        recorded: part of a recording; ``/NAME`` in a bag.
    """

    name: str
    type_name: str
    sources: tuple[str, ...]
    readers: tuple[str, ...]
    doc: str
    depth: int = 10
    reliable: bool = True
    latched: bool = False
    recorded: bool = False


_IMAGE, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_INFO, _CLOUD = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
_RIG, _CAMERA = ("rig",), ("rig", "virtual_turntable")
_SEERS = ("contour_tracker", "mesher", "viewer")
_SEERS_TOO = (*_SEERS, "board_pose")


def _seen(name: str, type_name: str, sources: tuple, readers: tuple, doc: str) -> Topic:
    """A topic with a message an image: a late one is of no use, so none is sent twice."""
    return Topic(name, type_name, sources, readers, doc, depth=5, reliable=False, recorded=True)


TOPICS = (
    _seen(
        "image",
        _IMAGE,
        _CAMERA,
        _SEERS_TOO,
        "Images: mono8, mono16, bgr8, rgb8, bgra8, rgba8, 8UC1, 16UC1, bayer_*, yuyv, uyvy, yuv422 "
        "or yuv422_yuy2.",
    ),
    _seen(
        "image/compressed",
        _COMPRESSED,
        _RIG,
        _SEERS_TOO,
        "The same as JPEG or PNG; follows the remapping of `image`.",
    ),
    _seen(
        "camera_info",
        _INFO,
        _CAMERA,
        _SEERS_TOO,
        "Calibration, stamp of its image. Distortion (plumb_bob, rational_polynomial, "
        "equidistant), binning and ROI are honoured; K[0] = 0 is an error.",
    ),
    Topic(
        "camera_pose",
        "geometry_msgs/msg/PoseStamped",
        (*_CAMERA, "board_pose", "turntable_pose"),
        ("contour_tracker", "mesher"),
        "Pose of the camera optical frame in the object frame.",
        depth=100,
        recorded=True,
    ),
    Topic(
        "camera_pose_cov",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        ("rig", "board_pose"),
        ("contour_tracker",),
        "Optional: the same with its covariance, which sigma of the contours then holds.",
        depth=100,
        recorded=True,
    ),
    Topic(
        "/tf",
        "tf2_msgs/msg/TFMessage",
        _RIG,
        (),
        "Instead of camera_pose, with `pose_source: tf`: what joins the image's frame with the "
        "object frame.",
        depth=100,
        recorded=True,
    ),
    Topic(
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        _RIG,
        (),
        "What of it does not move.",
        depth=100,
        latched=True,
        recorded=True,
    ),
    Topic(
        "joint_states",
        "sensor_msgs/msg/JointState",
        _RIG,
        ("turntable_pose",),
        "Angle of the turntable's joint.",
        depth=100,
        reliable=False,
        recorded=True,
    ),
    Topic(
        "board_camera_pose",
        "geometry_msgs/msg/PoseStamped",
        (),
        ("turntable_pose",),
        "Optional: what board_pose says of the camera, against which the joint is checked; remap "
        "its `camera_pose`.",
        depth=100,
        reliable=False,
    ),
    _seen(
        "mask",
        _IMAGE,
        (*_RIG, "board_pose"),
        ("contour_tracker",),
        "Optional segmentation, mono8, 0 is background; where a mask holds 255, levels between are "
        "coverage and give sub-pixel outlines. Stamp of its image.",
    ),
    _seen(
        "mask/compressed",
        _COMPRESSED,
        _RIG,
        ("contour_tracker",),
        "The same as PNG; follows the remapping of `mask`.",
    ),
    Topic(
        "contours",
        _CLOUD,
        ("contour_tracker",),
        ("reconstructor", "mesher", "viewer"),
        "Contours of one image, one row a sample; fields below.",
    ),
    Topic(
        "contour_image/compressed",
        _COMPRESSED,
        ("contour_tracker",),
        (),
        "The contours drawn over the image; made only for subscribers.",
        depth=1,
    ),
    Topic(
        "rim",
        _CLOUD,
        ("reconstructor",),
        ("mesher", "viewer"),
        "Rim points, one row for each row of the `contours` of the same stamp; fields below.",
    ),
    Topic(
        "strip",
        _CLOUD,
        ("mesher",),
        ("viewer",),
        "The triangles that one rim added; fields below.",
        depth=100,
    ),
    Topic(
        "mesh",
        _CLOUD,
        ("mesher",),
        ("viewer",),
        "The whole surface, at most `mesh_rate` times a second and when the turn is closed; "
        "fields as `strip`.",
        depth=1,
        latched=True,
    ),
    Topic(
        "closed",
        _CLOUD,
        ("mesher",),
        ("viewer",),
        "The watertight body, coarse while the turn goes on, full when it is closed; fields as "
        "`strip`.",
        depth=1,
        latched=True,
    ),
    Topic(
        "mesh_marker",
        "visualization_msgs/msg/Marker",
        ("mesher",),
        (),
        "The surface for RViz, TRIANGLE_LIST, thinned to `marker_triangles`; made only for "
        "subscribers.",
        depth=1,
        latched=True,
    ),
    Topic(
        "mesher/scan",
        "diagnostic_msgs/msg/DiagnosticStatus",
        ("mesher",),
        ("contour_tracker", "reconstructor", "viewer"),
        "State of the scan: waiting, scanning, turn_closed, finishing, saved or failed, and why; "
        "angle covered, frames, good share, what speaks against the closed body.",
        depth=1,
        latched=True,
    ),
    Topic(
        "reconstructor/turn",
        "diagnostic_msgs/msg/DiagnosticStatus",
        ("reconstructor",),
        ("mesher",),
        "A turn is finished: how many messages of `rim` there are in all with its last.",
        depth=1,
        latched=True,
    ),
    Topic(
        "/diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        (
            "contour_tracker",
            "reconstructor",
            "mesher",
            "viewer",
            "virtual_turntable",
            "board_pose",
            "turntable_pose",
        ),
        ("mesher", "viewer"),
        "Each second: rates, latency, queues, drops by reason, restarts of publishers, angle "
        "covered, samples by status, checkpoint, memory; what is missing, in words.",
    ),
)

IMAGES = ("/image", "/image/compressed")
"""An image comes on one of these."""

TYPE_NAMES: Mapping[str, str] = {
    f"/{row.name.lstrip('/')}": row.type_name for row in TOPICS if row.recorded
}
"""{topic of a recording: type of its messages}, what a rig publishes."""
TF = ("/tf", "/tf_static")
"""Transforms; a recording that holds no poses has them from these."""

PLAYED_NAMES: Mapping[str, str] = {
    name: kind for name, kind in TYPE_NAMES.items() if name not in ("/joint_states", *TF)
}
"""Those of them that the nodes of a scan hear."""


def topic(name: str) -> Topic:
    """The row of a topic."""
    return next(row for row in TOPICS if row.name == name)
