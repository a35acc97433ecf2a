"""A rig for tests: publishes frames, collects what the nodes make of them."""

from collections import defaultdict
from types import SimpleNamespace

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, Vector3
from geometry_msgs.msg import Transform as TransformMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import SetBool, Trigger

from msg_adapters import (
    decode_diagnostics,
    decode_stamp,
    decode_strip,
    encode_camera_info,
    encode_image,
    encode_pose,
)
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras

SECOND = 1_000_000_000
SMALL = TurntableSettings(frames=18, step=2 * np.pi / 18, width=320, height=240, focal_px=400.0)

STRIPS_ONLY = {"finish_when_closed": False, "close_body": False, "save_on_shutdown": False}
"""Parameters of a mesher in tests of anything but the end of a scan."""
EACH_ALONE = {"learn_frames": 0}
"""Parameters of a tracker in tests of anything but images that are looked at together."""
STRIPS = [a for k, v in STRIPS_ONLY.items() for a in ("-p", f"{k}:={str(v).lower()}")]
"""The same for a process."""

NODES = {
    "contour_tracker": ContourTrackerNode,
    "reconstructor": ReconstructorNode,
    "mesher": MesherNode,
}
PARAMS = {"mesher": STRIPS_ONLY}

_images: dict = {}


def views(settings=SMALL, name="vase"):
    """Cameras and images of a run, rendered once a session."""
    key = (settings, name)
    if key not in _images:
        cameras = turntable_cameras(settings)
        thing = make_object(name)
        _images[key] = [(camera, render(thing, camera)) for camera in cameras]
    return _images[key]


def handed_over(tracker, transform):
    """As if a message of /tf with this transform had come."""
    tracker.guard("/tf", tracker.on_tf, SimpleNamespace(transforms=[transform]))


class ByTransforms:
    """Stands for the publisher of camera_pose: what it publishes goes to the tracker by /tf."""

    def __init__(self, tracker):
        self.tracker = tracker

    def get_subscription_count(self):
        return 1

    def publish(self, msg):
        p, q = msg.pose.position, msg.pose.orientation
        place = TransformMessage(
            translation=Vector3(x=p.x, y=p.y, z=p.z),
            rotation=Quaternion(x=q.x, y=q.y, z=q.z, w=q.w),
        )
        child = TransformStamped(header=msg.header, child_frame_id="camera", transform=place)
        handed_over(self.tracker, child)


class Rig(Node):
    """Publisher of images and collector of everything that comes back."""

    def __init__(self, **kwargs):
        super().__init__("rig", start_parameter_services=False, **kwargs)
        best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.image = self.create_publisher(Image, "image", best_effort)
        self.mask = None
        self.info = self.create_publisher(CameraInfo, "camera_info", best_effort)
        self.pose = self.create_publisher(PoseStamped, "camera_pose", 100)
        self.collect()

    def collect(self):
        """Subscribe to all that the nodes make."""
        self.got = defaultdict(list)
        self.reports = {}
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        for topic in ("contours", "rim", "strip"):
            self.create_subscription(PointCloud2, topic, self.got[topic].append, 100)

    def _on_diagnostics(self, msg):
        self.reports |= {report.name: report for report in decode_diagnostics(msg)}

    def joined(self):
        """Whether each node in another process has found the next, and this one."""
        wanted = {"contour_tracker": "contours", "reconstructor": "rim", "mesher": "strip"}
        found = {
            topic: int(self.reports[f"/{node}"].values[f"{topic} subscribers"])
            for node, topic in wanted.items()
            if f"/{node}" in self.reports
        }
        return found == {"contours": 3, "rim": 2, "strip": 1}

    def ready(self):
        """Whether every topic has found its other end."""
        publishers = (self.image, self.info, self.pose)
        return all(p.get_subscription_count() for p in publishers) and all(
            self.count_publishers(topic) for topic in ("contours", "rim", "strip")
        )

    def send(self, view, stamp_ns, frame_id="turntable", parts=("info", "pose", "image")):
        """Publish one frame, the image last."""
        camera, pixels = view
        if "info" in parts:
            self.info.publish(encode_camera_info(camera, stamp_ns, "camera"))
        if "pose" in parts:
            self.pose.publish(encode_pose(camera, stamp_ns, frame_id))
        if "image" in parts:
            self.image.publish(encode_image(pixels, stamp_ns, "camera"))

    def publish_mask(self, mask, stamp_ns):
        self.mask = self.mask or self.create_publisher(Image, "mask", self.image.qos_profile)
        self.mask.publish(encode_image(mask, stamp_ns, "camera"))

    def trigger(self, name):
        return self.create_client(Trigger, name), Trigger.Request()

    def set_bool(self, name, value):
        return self.create_client(SetBool, name), SetBool.Request(data=value)

    def stamps(self, topic):
        return {decode_stamp(msg.header.stamp) for msg in self.got[topic]}

    def triangles(self, start_s=0):
        """(m, 3, 3) corners of all strips that came, or of those near a time, in their order."""
        strips = [decode_strip(msg) for msg in self.got["strip"]]
        near = [
            s for s in strips if not start_s or abs(s.stamp_ns - start_s * SECOND) < 60 * SECOND
        ]
        return np.concatenate([np.zeros((0, 3, 3), np.float32), *(s.corners for s in near)])


def told(ros, rig, node, words):
    """The diagnostics of a node, once these words are in them."""
    name = node.get_fully_qualified_name()
    ros.spin_until(
        lambda: name in rig.reports and words in rig.reports[name].message,
        timeout=20,
        what=f"'{words}'",
    )
    return rig.reports[name]


def send_until_seen(ros, rig, view, stamp_ns):
    """Send a frame until its contours come: best effort may lose one, above all the first,
    when the other end has not found this one yet."""
    for _ in range(40):
        rig.send(view, stamp_ns)
        try:
            ros.spin_until(lambda: stamp_ns in rig.stamps("contours"), timeout=3)
        except AssertionError:
            continue
        return
    raise AssertionError(f"no contours of {stamp_ns} ns")


def scan(ros, rig, frames, start_s=100, step_ns=SECOND // 10, finish=True, first=0):
    """Send views one by one, each when the last has become contours; close the turn."""
    ros.spin_until(rig.ready, what="the graph")
    for k, view in enumerate(frames, first):
        send_until_seen(ros, rig, view, start_s * SECOND + k * step_ns)
    if finish:
        # The last contours must have come to the reconstructor before it is told to finish:
        # all rims but those of the first and the last frame tell so.
        stamps = [start_s * SECOND + k * step_ns for k in range(len(frames))]
        ros.spin_until(lambda: set(stamps[1:-1]) <= rig.stamps("rim"), what="the rims on the way")
        answer = ros.call(*rig.trigger("reconstructor/finish"))
        assert answer.success, answer.message
        ros.spin_until(lambda: set(stamps) <= rig.stamps("strip"), what="all strips")
