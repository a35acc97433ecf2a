"""What contour_tracker does where single images are wrong: colours and body are learnt from all
frames of a turn together, and the frames are taken again by these at ``~/finish``; with
``segmentation: learnt`` later ones are taken so from the first turn on."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from msg_adapters import Level, View, encode_contours
from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.coverage import angle_covered
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.streams.kept_frames import KeptFrames, PackedFrame
from occ_recon_ros.streams.learning import LEAST_FRAMES, LearningProcess, Lesson

from .base import PipelineNode
from .settings import TrackerSettings

_ROUNDED = np.deg2rad(0.1)  # as angles are published
_PACE_S = 0.02
_PATIENCE_S = 0.1  # for a subscriber that does not say that it has taken one
_ENOUGH = 0.9  # of the scan's angle, and of the frames: with less nothing is replaced


class Learning:
    """What the tracker learns in a scan, and the frames that it was learnt from.

    Args:
        node: the tracker.
        publisher: of its contours.
        finished: contours as they go out: with what is known of their pose.
        begin_anew: says on the topic that the contours of this scan come again from a stamp on.
        scan_angle: radians that the scan has covered so far, as the mesher has it.

    Attributes:
        process: that learns.
        kept: frames, packed.
    """

    def __init__(
        self,
        node: PipelineNode[TrackerSettings],
        publisher: Publisher,
        finished: Callable[[Contours], Contours],
        begin_anew: Callable[[int], None],
        scan_angle: Callable[[], float],
    ) -> None:
        self._node, self._publisher, self._finished = node, publisher, finished
        self._begin_anew, self._scan_angle = begin_anew, scan_angle
        self.process = LearningProcess(node.create_guard_condition(self._on_lesson).trigger)
        group = ReentrantCallbackGroup()  # it answers when all is done; frames go on meanwhile
        node.create_service(Trigger, "~/finish", self._on_finish, callback_group=group)
        self._step = node.create_guard_condition(self._on_step)
        self._pace = node.steady_timer(_PACE_S, self._send_one)
        self._asked: Future | None = None
        self.clear()

    def clear(self) -> None:
        """A new scan begins."""
        self.process.stop()
        self._pace.cancel()
        settings = self._node.settings
        self.kept = KeptFrames(settings.learn_frames, settings.learn_memory * 2**20)
        self._lesson: Lesson | None = None  # of which there are masks
        empty_rig = bool(settings.background_image or settings.background_frames)
        asked = settings.segmentation == "learnt"
        self._at_end = settings.segmentation == "auto" and not empty_rig  # and not before
        learns = settings.learn_frames > 0 and (asked or self._at_end)
        self._state = "collecting" if learns else "off"
        self._keeps = learns
        self._words = self._said = ""  # of the last lesson
        self.doubt = ""
        self._owed = False  # whether frames of this scan were segmented before
        self._todo: deque[PackedFrame] = deque()  # to be taken again
        self._again: deque[Contours] = deque()  # contours of those that were
        self._coming_again = False
        self._held: list[Contours] = []  # of frames that came meanwhile
        self._answer(False, "another scan has begun")

    # Frames.

    def mask(self, view: View) -> NDArray[np.uint8] | None:
        """The mask by which a frame is segmented: the one that came, or one by what was learnt;
        None where nothing was.

        Raises:
            ContourError: nothing that was learnt fits the frame.
        """
        if self._state in ("off", "failed", "not needed"):
            return view.mask
        if view.mask is not None:
            self.process.stop()
            self._keeps = False
            self._settle("not needed", "masks come with the images")
            return view.mask
        if self._lesson is None or self._lesson.masks is None:
            self._owed = True
            return None
        with self._node.stages.timed("learnt mask"):
            return self._lesson.masks.mask(view.image, view.camera)

    def keep(self, view: View, found: Contours | None) -> None:
        """Keep a frame for the time when all are looked at, and what was found in it; to be called
        when its contours are out."""
        if not self._keeps:
            return
        with self._node.stages.timed("keep"):
            self.kept.add(PackedFrame.of(view.image, view.camera, view.stamp_ns, found))
        early = self._state == "collecting" and not self._at_end
        if early and self._angle >= self._node.settings.learn_after:
            self._learn()

    @property
    def _angle(self) -> float:
        """Degrees over which frames are kept; 0 where they are too few to learn from."""
        few = len(self.kept) < LEAST_FRAMES
        return 0.0 if few else float(np.rad2deg(angle_covered(self.kept.centres)))

    def send(self, contours: Contours) -> None:
        """Publish contours, once those that come again are out."""
        if self._coming_again:
            self._held.append(contours)
        else:
            self._node.send("contours", encode_contours(contours))

    # Learning.

    def _learn(self) -> None:
        self._state = "learning"
        self.process.begin(self.kept.frames, self._node.settings)

    def _on_lesson(self) -> None:
        lesson = self.process.take()
        if lesson is None:
            return
        self._lesson = lesson if lesson.masks else None
        state = "learnt" if lesson.masks else "failed" if lesson.failed else "not needed"
        self._settle(state, lesson.words)

    def _settle(self, state: str, words: str) -> None:
        waited_for = self._state == "learning" and self._asked is not None
        self._state, self._words = state, words
        failed = "images without masks may be segmented wrongly, and all together no better"
        self.doubt = f"{failed}: {words}" if state == "failed" else ""
        self._said = self.words
        self._node.get_logger().info(f"segmentation: {self._said}")
        if state != "learnt":
            self._lesson = None
            if self._keeps and self._at_end and not self._whole:
                self._state = "collecting"  # more of the turn may come
            else:
                self._let_go()
        if waited_for:
            self._begin_again()

    @property
    def _whole(self) -> bool:
        """Whether the scan has been all around."""
        return self._scan_angle() >= 2 * np.pi - _ROUNDED

    def _let_go(self) -> None:
        self._keeps = False
        self.kept.clear()

    # ~/finish.

    async def _on_finish(self, _: Any, response: Trigger.Response) -> Trigger.Response:
        asked = self._asked
        if asked is None:
            asked = self._asked = Future()
            if self._state == "collecting" and self._angle:
                self._learn()
            elif self._state != "learning":
                self._begin_again()
        response.success, response.message = await asked
        return response

    def _begin_again(self) -> None:
        scan = float(np.rad2deg(self._scan_angle()))
        if self._lesson is None or not self._owed:
            self._answer(False, f"no frames are to be taken again ({self._said or self.words})")
        elif self._angle < _ENOUGH * scan:
            lacking = f"those kept cover {self._angle:.0f} of the scan's {scan:.0f} degrees"
            self._answer(False, f"no frames are taken again: {lacking}")
        else:
            strangers = self._lesson.strangers
            self._todo = deque(f for f in self.kept.frames if f.stamp_ns not in strangers)
            self._wanted, self._coming_again = len(self._todo), True
            # Another, so that each loop has one name in all of them.
            self._tracker = ContourTracker(self._node.settings)
            self._step.trigger()

    def _on_step(self) -> None:
        """Take one frame again; what else the node has to do goes between two."""
        if self._todo:
            self._node.guard("frame", self._take_again, self._todo.popleft())
            self._step.trigger()
        elif len(self._again) < _ENOUGH * self._wanted:
            few = f"only {len(self._again)} of {self._wanted} gave contours again"
            self._again.clear()
            self._answer(False, f"the frames stay as they were taken: {few}")
        else:
            self._words_of_again = self._what_was_done()
            self._owed = False
            self._begin_anew(self._again[0].stamp_ns)
            self._sent_at = 0.0
            self._pace.reset()

    def _take_again(self, frame: PackedFrame) -> None:
        lesson = self._lesson
        if lesson is None or lesson.masks is None:
            return
        image = frame.image
        with self._node.stages.timed("taken again"):
            right = frame.stamp_ns in lesson.right
            mask = frame.mask() if right else lesson.masks.mask(image, frame.camera)
            contours = self._tracker.process(
                image, frame.camera, frame.stamp_ns, self._node.settings.object_frame, mask
            )
        self._again.append(self._finished(contours))

    def _send_one(self) -> None:
        """Publish the contours one by one, no faster than they are taken: queues are short."""
        taken = self._publisher.wait_for_all_acked(Duration(nanoseconds=0))
        if not taken and time.monotonic() - self._sent_at < _PATIENCE_S:
            return
        if self._again:
            self._sent_at = time.monotonic()
            self._node.send("contours", encode_contours(self._again.popleft()))
        else:
            self._pace.cancel()
            self._let_go()
            self._answer(True, self._words_of_again)

    def _what_was_done(self) -> str:
        lesson = self._lesson or Lesson(None, "")
        words = f"{len(self._again)} frames were taken again by all of them together"
        if lesson.right:
            words += f", {len(lesson.right)} of them as they were"
        if lesson.strangers:
            words += f", and {len(lesson.strangers)} left out that show something else"
        return f"{words} ({lesson.words})"

    def _answer(self, good: bool, words: str) -> None:
        asked, self._asked, self._coming_again = self._asked, None, False
        held, self._held = self._held, []
        for contours in held:
            self.send(contours)
        if asked is not None:
            asked.set_result((good, words))

    # Words and figures.

    @property
    def words(self) -> str:
        """The state of the learning."""
        if self._state == "collecting":
            wanted = self._node.settings.learn_after
            until = "at ~/finish" if self._at_end else f"of {wanted:.0f} degrees"
            return f"collecting: {self._angle:.0f} {until}"
        return ": ".join(filter(None, (self._state, self._words)))

    def problems(self) -> Iterator[tuple[Level, str]]:
        """Whether it has failed."""
        if self._state == "failed":
            yield (
                Level.WARN,
                f"segmentation could not be learnt, images are segmented one by one: {self._words}",
            )

    def figures(self) -> dict[str, Any]:
        """For diagnostics."""
        if self._state == "off":
            return {}
        return {
            "learning": self.words,
            "frames kept": len(self.kept),
            "frames kept MB": round(self.kept.nbytes / 2**20, 1),
            "frames to take again": len(self._todo) + len(self._again),
        }
