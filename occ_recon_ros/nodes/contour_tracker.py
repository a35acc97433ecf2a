"""contour_tracker: images and poses in, contours out."""

import sys
import time
from collections import Counter, deque
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from msg_adapters import (
    Level,
    View,
    decode_frame,
    decode_stamp,
    decode_status,
    encode_contours,
    encode_jpeg,
)
from msg_adapters.pose import decode_pose_covariance
from msg_adapters.transforms import decode_transforms
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.contours import no_contours
from occ_recon_ros.imaging import (
    ContourError,
    ContourTracker,
    check_background,
    draw_contours,
)
from occ_recon_ros.imaging.warming import warm_up
from occ_recon_ros.poses.transforms import TransformTree
from occ_recon_ros.poses.uncertainty import with_pose_sigma
from occ_recon_ros.streams.camera_watch import CameraWatch
from occ_recon_ros.streams.lost_images import LostImages
from occ_recon_ros.streams.pairing import Frame, Pairing
from occ_recon_ros.streams.scan import ScanState
from occ_recon_ros.streams.scan_order import FAR_AHEAD_NS, PATIENCE, ScanOrder
from occ_recon_ros.streams.stamp_watch import StampWatch
from occ_recon_ros.streams.transform_poses import TransformPoses

from .base import NEXT_SCAN, Dropped, PipelineNode, scan_is_over
from .learning import Learning
from .main import run_node
from .qos import compressed_topic, kept, latched, reliable, sensor, tf_type
from .settings import TrackerSettings
from .tracker_memory import TrackerMemory

_MOST_WAITING_S = 0.05  # of a frame for messages; another node's callback may take a second
_CROWD = 12  # frames with old stamps in a row, where two cameras send and the one is quicker
_COVARIANCES = 300  # kept for frames to come


class ContourTrackerNode(PipelineNode[TrackerSettings]):
    """Pairs image, camera_info, camera_pose and mask by stamp and finds the contours."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("contour_tracker", TrackerSettings, **kwargs)
        try:
            check_background(self.settings)
        except ContourError as error:
            raise SettingsError(str(error)) from None
        self._new_tracker()
        self._pairing = self._new_pairing()
        self._order = ScanOrder[Frame](
            lambda reason, frame: self._drop_frame(reason, frame.stamp_ns), far=FAR_AHEAD_NS
        )
        self._waiting: deque[Frame] = deque()
        self._arrived, self._since, self._paired = False, 0.0, 0
        self._covariances: dict[int, PoseWithCovarianceStamped] = {}
        self._work = self.create_guard_condition(self._on_work)
        self._worked_on: int | None = None
        self._memory = TrackerMemory(self)
        self._recall()
        warm_up()

        contours = self.advertise(PointCloud2, "contours", reliable(10))
        self._learning = Learning(
            self, contours, self._with_covariance, self._begin_anew, lambda: self._scan_angle
        )
        self._drawn_topic = compressed_topic(self, "contour_image")
        self._drawn = self.advertise(CompressedImage, self._drawn_topic, reliable(1))
        self._compressed = self.subscribe_images(partial(self._take, "image"))
        self.subscribe(CameraInfo, "camera_info", partial(self._take, "camera_info"), sensor())
        self.subscribe(Image, "mask", partial(self._take, "mask"), sensor())
        self._compressed_mask = compressed_topic(self, "mask")
        self.subscribe(
            CompressedImage, self._compressed_mask, partial(self._take, "mask"), sensor()
        )
        if self.settings.pose_source == "tf":
            tf_message = tf_type()
            self.subscribe(tf_message, "/tf", self.on_tf, reliable(100))
            self.subscribe(tf_message, "/tf_static", self.on_tf_static, kept(100))
        else:
            self.subscribe(PoseStamped, "camera_pose", self._on_pose, reliable(100))
        self.subscribe(
            PoseWithCovarianceStamped, "camera_pose_cov", self._on_covariance, reliable(100)
        )
        self.subscribe(DiagnosticStatus, "mesher/scan", self._on_scan, latched())
        self._scan_over, self._state, self._scan_angle = False, "", 0.0
        self.offer("~/reset", self._on_reset)
        self.offer_pause("images")
        self.warn_of_unknown_parameters()

    def _new_pairing(self) -> Pairing:
        values = self.settings
        gap = int(values.max_pose_gap * 1e9)
        self._tree = TransformTree()
        by_tf = values.pose_source == "tf"
        return Pairing(
            self._drop_frame,
            interpolate=by_tf or values.pose_sync == "interpolate",
            max_pose_gap_ns=gap,
            depth=values.sync_queue,
            poses=TransformPoses(self._tree, values.object_frame, gap) if by_tf else None,
        )

    # Messages in.

    def on_tf(self, msg: Any) -> None:
        """Take in a tf2_msgs/TFMessage of frames that move."""
        self._take_transforms(msg, static=False)

    def on_tf_static(self, msg: Any) -> None:
        """Take in one of frames that do not."""
        self._take_transforms(msg, static=True)

    def _take_transforms(self, msg: Any, static: bool) -> None:
        try:
            for transform in decode_transforms(msg):
                self._tree.add(transform, static)
        except ValueError as error:
            raise Dropped("bad_tf", str(error)) from error
        self._queue(self._pairing.look_again())

    def _take(self, part: str, msg: Any) -> None:
        self._pairing.await_mask = self._wants_mask()
        stamp = decode_stamp(msg.header.stamp)
        self._stamps.note(part, stamp)
        self._queue(self._pairing.add(part, stamp, msg))

    def _on_pose(self, msg: PoseStamped) -> None:
        stamp = decode_stamp(msg.header.stamp)
        self.refuse_other_frame("pose_frame", "poses are in frame", msg.header.frame_id)
        self._stamps.note("camera_pose", stamp)
        self._queue(self._pairing.add_pose(stamp, msg))

    def _on_covariance(self, msg: PoseWithCovarianceStamped) -> None:
        """Kept for the frame of its stamp, which need not wait for it."""
        self.refuse_other_frame("pose_frame", "poses are in frame", msg.header.frame_id)
        self._covariances[decode_stamp(msg.header.stamp)] = msg
        while len(self._covariances) > _COVARIANCES:
            del self._covariances[next(iter(self._covariances))]

    def _wants_mask(self) -> bool:
        wanted = self.settings.segmentation in ("auto", "mask", "learnt")
        return wanted and any(map(self.publishers_of, ("mask", self._compressed_mask)))

    def use_what_waits(self) -> None:
        """No message comes any more: frames that wait are used as they are, or dropped by name."""
        self._queue(self._pairing.flush())

    def _queue(self, frames: list[Frame]) -> None:
        """Put whole frames in the order of their stamps and in the queue for work."""
        self._arrived = True
        for frame in frames:
            self._paired += 1
            self._order.patience = _CROWD if self._crowded() else PATIENCE
            time_went_back, due = self._order.add(frame.stamp_ns, frame)
            if time_went_back:
                self._pairing.forget_after(due[-1].stamp_ns)
            self._waiting.extend(due)
        while len(self._waiting) > self.settings.work_queue:
            self._drop_frame("overload", self._waiting.popleft().stamp_ns)
        if self._waiting:
            self._work.trigger()

    def _on_work(self) -> None:
        """Work on one frame, once no more messages wait: those that are too many are then
        dropped by us, by name, and not by the transport in silence."""
        if self._arrived and time.monotonic() - self._since < _MOST_WAITING_S:
            self._arrived = False
            self._work.trigger()
            return
        if self._waiting:
            self.guard("image", self._process, self._waiting.popleft())
        self._arrived, self._since = False, time.monotonic()
        if self._waiting:
            self._work.trigger()

    # A frame's way.

    def _on_scan(self, msg: DiagnosticStatus) -> None:
        self._scan_over = scan_is_over(msg)
        values = decode_status(msg).values
        before, self._state = self._state, values.get("state", "")
        self._scan_angle = np.deg2rad(float(values.get("angle deg", 0.0)))
        if self._state == ScanState.SAVED.value != before and self._worked_on is not None:
            self._memory.checkpoint.keep_saved()

    def _process(self, frame: Frame) -> None:
        if self.paused:
            raise Dropped("paused", "an image came while paused")
        if self._worked_on is not None and frame.stamp_ns < self._worked_on:
            self.get_logger().info("time went back: a new scan begins")
            self._new_tracker()
            self._memory.clear()
            self._learning.clear()
            self._begin_anew(frame.stamp_ns)
        self._worked_on = frame.stamp_ns
        with self.stages.timed("decode"):
            try:
                view = decode_frame(frame)
            except ValueError:
                self._images_lost.drop("unusable")
                raise
        self._images_lost.use()
        if words := self._cameras.add(view.camera, view.stamp_ns):
            self.warn("camera_info", words)
        found: Contours | None = None
        try:
            found = self._find(view)
            contours = self._with_covariance(found)
            with self.stages.timed("encode"):
                self._learning.send(contours)
            self.measure_latency(frame.stamp_ns)
        finally:
            self._learning.keep(view, found)
        for event in self._tracker.events():
            self.get_logger().info(event)
        if self._drawn.get_subscription_count():
            self._draw(view.image, contours, frame)

    def _find(self, view: View) -> Contours:
        try:
            mask = self._learning.mask(view)
            with self.stages.timed("contours"):
                return self._tracker.process(
                    view.image, view.camera, view.stamp_ns, self.settings.object_frame, mask
                )
        finally:
            self._memory.keep(self._tracker, view.stamp_ns)

    def _with_covariance(self, contours: Contours) -> Contours:
        """Sigma with that of the pose, where camera_pose_cov told of it."""
        told = self._covariances.get(contours.stamp_ns)
        if told is None:
            return contours
        try:
            return with_pose_sigma(contours, decode_pose_covariance(told))
        except ValueError as error:
            self.drop("bad_camera_pose_cov", f"camera_pose_cov: {error}")
            return contours

    def _draw(self, image: Any, contours: Contours, frame: Frame) -> None:
        with self.stages.timed("draw"):
            picture = draw_contours(image, contours)
            camera_frame = frame.parts["image"].header.frame_id
            self.send(self._drawn_topic, encode_jpeg(picture, frame.stamp_ns, camera_frame))

    def _begin_anew(self, stamp_ns: int) -> None:
        self.send("contours", encode_contours(no_contours(stamp_ns, self.settings.object_frame)))

    # Life.

    def _new_tracker(self) -> None:
        self._tracker = ContourTracker(self.settings)
        self._cameras, self._images_lost, self._stamps = CameraWatch(), LostImages(), StampWatch()

    def _recall(self) -> None:
        """Go on with the scan of the checkpoint."""
        self._worked_on = last = self._memory.recall(self._tracker)
        if last is not None:
            self._order.go_on_from(last)
            self.get_logger().info(f"going on with a scan after its image of {last * 1e-9:.3f} s")

    def _on_reset(self) -> str:
        try:
            check_background(self.settings)
        except ContourError as error:
            raise SettingsError(str(error)) from None
        self._new_tracker()
        self._memory.clear()
        self._learning.clear()
        self._pairing.clear()
        self._order.reset()
        self._covariances.clear()
        self._waiting.clear()
        self._worked_on = self.carrier = None
        return "ready for a new scan"

    def counts_later(self, old: TrackerSettings, new: TrackerSettings) -> str:
        """The contour settings belong to a whole scan."""
        return NEXT_SCAN if new != old else ""

    def _drop_frame(self, reason: str, stamp_ns: int) -> None:
        if self._order.seen(stamp_ns) and reason.startswith("no_"):
            reason = "duplicate"  # what is left of a frame that was whole before
        elif reason == "out_of_order" and self._crowded():
            reason = "second_publisher"
        self._images_lost.drop(reason)
        words = self._pairing.poses.words or _WORDS.get(reason, reason)
        self.drop(reason, f"frame {stamp_ns * 1e-9:.6f} s, {words}")

    def _crowded(self) -> bool:
        """Whether images come from more than one: old stamps need not be a clock set back then."""
        return self.publishers_of(self.carrier or "image") > 1

    def problems(self, counts: Counter[str]) -> Iterator[tuple[Level, str]]:
        """What keeps frames from being whole."""
        if self._memory.checkpoint.trouble:
            yield Level.WARN, self._memory.checkpoint.trouble
        yield from self._learning.problems()
        if leap := self._leap():
            yield Level.WARN, leap
        paired, self._paired = self._paired, 0
        images = counts["image"] + counts[self._compressed]
        if self.paused:
            yield Level.WARN, "paused: call ~/pause with data: false to go on"
            return
        if not images and self._scan_over:
            return
        if not images:
            yield Level.WARN, f"no images on {self.publishers_text('image')}"
            return
        if standing := self._stamps.standing():
            yield Level.WARN, standing
            return
        if paired:
            return
        by_tf = self.settings.pose_source == "tf"
        poses = "/tf" if by_tf else "camera_pose"
        parts = ("camera_info", *(("mask",) if self._wants_mask() else ()), poses)
        for part in parts:
            if not counts[part] + (part == "mask" and counts[self._compressed_mask]):
                yield Level.WARN, f"images arrive but no {part} on {self.publishers_text(part)}"
                return
        values = self.settings
        gap = int(values.max_pose_gap * 1e9) if values.pose_sync == "interpolate" else None
        why = self._images_lost.why = self._stamps.why(parts, values.sync_queue, gap)
        if by_tf and not why:
            why = self._pairing.poses.words or "/tf does not reach their stamps yet"
            yield Level.WARN, f"images have no pose by /tf: {why}"
        elif "pose_frame" not in self._new_drops:  # which says why
            words = (
                f"image, {', '.join(parts[:-1])} and {poses} arrive but their stamps do not meet"
            )
            yield Level.WARN, f"{words}: {why}" if why else words

    def _leap(self) -> str:
        return self._stamps.leap() if self.settings.pose_sync == "interpolate" else ""

    def figures(self) -> dict[str, Any]:
        """Queue lengths, and what is to be said of the scan."""
        lost = self._images_lost.words(self._pairing.waiting())
        doubts = self._cameras.doubt, self._leap(), self._learning.doubt
        doubt = "; ".join(filter(None, doubts))
        return {
            "frames incomplete": len(self._pairing),
            "frames waiting": len(self._waiting),
            **({"images lost": lost} if lost else {}),
            **({"doubt": doubt} if doubt else {}),
            **self._learning.figures(),
            **self._memory.checkpoint.figures(),
        }

    def destroy_node(self) -> None:
        """End; the checkpoint stays."""
        self._learning.process.stop()
        self._memory.checkpoint.close()
        super().destroy_node()


_WORDS = {
    "no_image": "its image never came",
    "no_camera_info": "its camera_info never came",
    "no_camera_pose": "its camera_pose never came",
    "no_mask": "its mask never came",
    "pose_gap": "the poses around it are more than max_pose_gap apart",
    "duplicate": "it has come before",
    "out_of_order": "it came after a later one",
    "far_ahead": "its stamp is more than 10 minutes ahead of those around it",
    "second_publisher": "another camera sends images too, with older stamps",
    "overload": "images come faster than they can be worked on",
}


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(ContourTrackerNode)


if __name__ == "__main__":
    sys.exit(main())
