"""board_pose: images of a printed board in, poses of the camera out."""

import sys
from collections import Counter, deque
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image

from msg_adapters import (
    Level,
    decode_camera,
    decode_picture,
    decode_stamp,
    encode_image,
    encode_pose,
)
from msg_adapters.pose import encode_pose_covariance
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.board import read_board
from occ_recon_ros.poses.board_mask import object_mask
from occ_recon_ros.poses.live import LiveBoard, LivePose
from occ_recon_ros.streams.pairing import Frame, Pairing
from occ_recon_ros.streams.stamp_watch import StampWatch

from .base import PipelineNode, named
from .main import run_node
from .qos import reliable, sensor
from .settings import BoardPoseSettings

_REMEMBERED = 100
_STRAY_NS = 1_000_000_000  # an image that is older by more tells that time went back
_HELD = 8  # images that wait with their poses for the neighbour that tells between two
_MOST_WAITING = 3  # images; they must be younger than those for which the tracker awaits a pose
_OTHERS_FIRST = 5  # rounds of the executor between two images: those who share it take what came


class BoardPoseNode(PipelineNode[BoardPoseSettings]):
    """Finds the board in each image, and from it the pose of the camera in the board's frame.

    Raises:
        SettingsError: the file of the board is not there, or is none.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("board_pose", BoardPoseSettings, **kwargs)
        try:
            self.board = read_board(Path(self.settings.board).expanduser())
        except ValueError as error:
            raise SettingsError(f"board: {error}") from None
        self._live = LiveBoard(self.board)
        self._images: deque[tuple[Frame, Any, Camera]] = deque(maxlen=_HELD)
        self._waiting: deque[Frame] = deque()
        self._posed_ones: deque[tuple[LivePose, Frame, Any, Camera]] = deque()
        self._rounds = 0
        self._work = self.create_guard_condition(self._on_work)
        self._worked_on: int | None = None
        self._pairing = Pairing(self._drop_frame, depth=self.settings.sync_queue, with_pose=False)
        self._stamps = StampWatch()
        self._paired = self._posed = 0
        self._errors: deque[float] = deque(maxlen=_REMEMBERED)
        self._last: LivePose | None = None
        self._why: Counter[str] = Counter()

        self.advertise(PoseWithCovarianceStamped, "camera_pose_cov", reliable(100))
        self.advertise(PoseStamped, "camera_pose", reliable(100))
        if self.settings.publish_mask:
            self.advertise(Image, "mask", sensor())
        self._compressed = self.subscribe_images(partial(self._take, "image"))
        self.subscribe(CameraInfo, "camera_info", partial(self._take, "camera_info"), sensor())
        self.offer("~/reset", self._on_reset)
        self.warn_of_unknown_parameters()

    # Messages in.

    def _take(self, part: str, msg: Any) -> None:
        stamp = decode_stamp(msg.header.stamp)
        self._stamps.note(part, stamp)
        for frame in self._pairing.add(part, stamp, msg):
            self._paired += 1
            self._waiting.append(frame)
        while len(self._waiting) > _MOST_WAITING:
            self._drop_frame("overload", self._waiting.popleft().stamp_ns)
        if self._waiting:
            self._work.trigger()

    def _on_work(self) -> None:
        """Look for the board in one image, or cut the object out of one, when others have had
        their turn."""
        self._rounds += 1
        if self._rounds > _OTHERS_FIRST:
            self._rounds = 0
            if self._posed_ones:
                self.guard("image", self._publish, *self._posed_ones.popleft())
            elif self._waiting:
                self.guard("image", self._process, self._waiting.popleft())
        if self._posed_ones or self._waiting:
            self._work.trigger()

    # A frame's way.

    def _process(self, frame: Frame) -> None:
        if self._worked_on is not None and frame.stamp_ns < self._worked_on - _STRAY_NS:
            self.get_logger().info("time went back: a new scan begins")
            self._live.reset()
            self._images.clear()
        self._worked_on = frame.stamp_ns
        with self.stages.timed("decode"):
            with named("image"):
                image = decode_picture(frame.parts["image"])
            with named("camera_info"):
                camera = decode_camera(frame.parts["camera_info"])
        self._images.append((frame, image, camera))
        try:
            with self.stages.timed("board"):
                found = self._live.look(image, camera, frame.stamp_ns)
        except ValueError as error:
            self._images.pop()
            self._why[str(error)] += 1
            raise
        images = {f.stamp_ns: (f, pixels, c) for f, pixels, c in self._images}
        for pose in found:
            if pose.stamp_ns in images:
                self._posed_ones.append((pose, *images[pose.stamp_ns]))
        if found:
            self._images.clear()

    def _publish(self, live: LivePose, frame: Frame, image: Any, camera: Camera) -> None:
        stamp, name, pose = live.stamp_ns, self.settings.object_frame, live.pose
        here = camera.at(pose.pose)
        covariance = encode_pose_covariance(pose.pose, pose.covariance, stamp, name)
        self.send("camera_pose_cov", covariance)
        self.send("camera_pose", encode_pose(here, stamp, name))
        if self.settings.publish_mask:
            with self.stages.timed("mask"):
                mask = object_mask(image, here, self.board)
            self.send("mask", encode_image(mask, stamp, frame.parts["image"].header.frame_id))
        self._posed += 1
        self._errors.append(pose.rms_px)
        self._last = live
        self.measure_latency(stamp)

    # Life.

    def _on_reset(self) -> str:
        self._live.reset()
        self._images.clear()
        self._waiting.clear()
        self._posed_ones.clear()
        self._pairing.clear()
        self._stamps = StampWatch()
        self._worked_on = self.carrier = None
        return "ready for a new scan"

    def _drop_frame(self, reason: str, stamp_ns: int) -> None:
        words = {"no_camera_info": "its camera_info never came", "no_image": "its image never came"}
        words["overload"] = f"images come faster than {self._pace()}"
        self.drop(reason, f"frame {stamp_ns * 1e-9:.6f} s, {words.get(reason, reason)}")

    def _pace(self) -> str:
        """What an image costs, and what is faster."""
        board, mask = (np.median(self.stages[name] or [0.0]) for name in ("board", "mask"))
        if not self.settings.publish_mask:
            return f"the board is found in them ({board:.2g} s each)"
        return (
            f"the board is found in them and the object cut out ({board:.2g} + {mask:.2g} s each): "
            "masks of your own with publish_mask: false take less"
        )

    def problems(self, counts: Counter[str]) -> Iterator[tuple[Level, str]]:
        """What keeps images from having poses."""
        paired, posed, why = self._paired, self._posed, self._why
        self._paired, self._posed, self._why = 0, 0, Counter()
        if not counts["image"] + counts[self._compressed]:
            yield Level.WARN, f"no images on {self.publishers_text('image')}"
        elif not counts["camera_info"]:
            text = self.publishers_text("camera_info")
            yield Level.WARN, f"images arrive but no camera_info on {text}"
        elif standing := self._stamps.standing():
            yield Level.WARN, standing
        elif not paired:
            apart = self._stamps.why(["camera_info"], self.settings.sync_queue)
            words = "image and camera_info arrive but their stamps do not meet"
            yield Level.WARN, f"{words}: {apart}" if apart else words
        elif not posed and why:
            yield Level.ERROR, f"no image has a pose: {why.most_common(1)[0][0]}"

    def figures(self) -> dict[str, Any]:
        """How well the corners fit, and how well the camera is known."""
        values: dict[str, Any] = {"board": self.board.words}
        if self._last is not None:
            pose = self._last.pose
            sigma_mm = 1e3 * np.sqrt(np.trace(pose.covariance[:3, :3]))
            values |= {
                "reprojection error px": round(pose.rms_px, 3),
                "reprojection error median px": round(float(np.median(self._errors)), 3),
                "corners found": len(pose.used),
                "corners used": int(pose.used.sum()),
                "camera known to mm": round(float(sigma_mm), 2),
                "blur px": round(self._last.blur_px, 2),
            }
        return values


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(BoardPoseNode)


if __name__ == "__main__":
    sys.exit(main())
