"""reconstructor: contours in, rims out."""

import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import (
    Level,
    StatusReport,
    decode_contours,
    decode_status,
    encode_rim,
    encode_status,
)
from occ_recon_ros.geometry import Contours, Rim, RimReconstructor
from occ_recon_ros.geometry.contours import no_contours
from occ_recon_ros.geometry.coverage import angle_covered
from occ_recon_ros.geometry.rim import empty_rim
from occ_recon_ros.geometry.shape import Shape, second_order_shape
from occ_recon_ros.geometry.warming import warm_up
from occ_recon_ros.streams.rim_watch import RimWatch
from occ_recon_ros.streams.scan import ScanState
from occ_recon_ros.streams.scan_order import ScanOrder

from .base import NEXT_SCAN, Dropped, PipelineNode, named, scan_is_over
from .checkpoint import Checkpoint
from .main import run_node
from .qos import latched, reliable
from .settings import ReconstructorSettings

_BURST = 5  # half of what the topic's queue holds
_PAUSE_S = 0.01
_PATIENCE_S = 0.1
_SAY_AGAIN_S = 10.0

_Heard = tuple[Contours, PointCloud2]


class ReconstructorNode(PipelineNode[ReconstructorSettings]):
    """Computes the rim of each frame; ~/finish computes those that need the closed turn.

    Attributes:
        on_finishing: told how many rims ~/finish has computed, and of how many frames at most.
    """

    on_finishing: Callable[[int, int], None] = staticmethod(lambda done, most: None)

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("reconstructor", ReconstructorSettings, **kwargs)
        self._order = ScanOrder[_Heard](lambda reason, heard: self._drop_contours(reason, heard[0]))
        self._checkpoint = Checkpoint(self, self.settings, PointCloud2)
        self._rims: deque[Rim] = deque()
        self._burst_since, self._burst_left = 0.0, 0
        self._recalled, self._old = False, 0  # old: rims sent again, which say nothing of latency
        self._forget()
        self._rim = self.advertise(PointCloud2, "rim", reliable(10))
        warm_up()
        self.subscribe(PointCloud2, "contours", self._on_contours, reliable(10))
        self.advertise(DiagnosticStatus, "~/turn", latched())
        self._sent = 0
        self.subscribe(DiagnosticStatus, "mesher/scan", self._on_scan, latched())
        self._scan_over, self._state = False, ""
        self.offer("~/reset", self._on_reset)
        # It answers when all rims are computed; other callbacks have their turn meanwhile.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, "~/finish", self._on_finish, callback_group=group)
        self._step = self.create_guard_condition(self._on_step)
        self._resume = self.steady_timer(_PAUSE_S, self._send_rims)
        self._resume.cancel()
        self._recall()
        self.warn_of_unknown_parameters()

    def _new_scan(self) -> None:
        self._forget()
        self._checkpoint.clear()
        self.loss.forgive()

    def _forget(self) -> None:
        self._reconstructor = RimReconstructor(self.settings)
        self._watch = RimWatch(self._reconstructor, self.settings.baseline)
        self._steps: Iterator[Rim | None] | None = None
        self._held: list[PointCloud2] = []

    def _on_contours(self, msg: PointCloud2) -> None:
        if self._steps is not None:
            self._held.append(msg)
            return
        contours = self._decode(msg)
        self._recalled = False  # no waiting for a mesher any more
        if not len(contours):
            self._on_no_contours(contours)
            return
        time_went_back, due = self._order.add(contours.stamp_ns, (contours, msg))
        if time_went_back:
            self._begin_again(due[0][0].stamp_ns)
        for one, message in due:
            self.guard("contours", self._take, one, message)

    def _take(self, contours: Contours, message: PointCloud2) -> None:
        frames = self._watch.frames
        rims = self._add(contours)
        if self._watch.frames > frames:
            self._checkpoint.keep(message)
            self._checkpoint.compact(
                lambda stamp: self._reconstructor.contours_of(stamp) is not None
            )
        self._queue(rims)

    def _decode(self, msg: PointCloud2) -> Contours:
        with self.stages.timed("decode"), named("contours"):
            contours = decode_contours(msg)
        self.refuse_other_frame("contours_frame", "contours are in frame", contours.frame_id)
        return contours

    def _on_no_contours(self, contours: Contours) -> None:
        """Contours without samples, earlier than the last, say that a new scan begins."""
        if self._order.last is None or contours.stamp_ns > self._order.last:
            raise Dropped("empty_contours", "contours have no samples")
        self._order.reset()
        self._begin_again(contours.stamp_ns)

    def _begin_again(self, stamp_ns: int) -> None:
        self.get_logger().info("time went back: a new scan begins")
        self._new_scan()
        # A rim without samples, stamped earlier than the last, begins a new scan.
        self._queue([empty_rim(no_contours(stamp_ns, self.settings.object_frame))])

    def _add(self, contours: Contours) -> list[Rim]:
        unmoved = self._reconstructor.unmoved
        with self.stages.timed("rim"):
            rims = self._reconstructor.add(contours)
        if self._reconstructor.unmoved > unmoved:
            # A table at rest is no trouble: said and counted, without a warning.
            self._watch.add_unmoved(contours)
            self.drops["camera_unmoved"] += 1
            self.get_logger().info(
                f"no rim of {contours.stamp_ns * 1e-9:.3f} s: the camera is where it was in the "
                "frame before",
                throttle_duration_sec=_SAY_AGAIN_S,
            )
            return rims
        self._watch.add_frame(contours)
        self._watch.add_rims(rims)
        return rims

    def _recall(self) -> None:
        """Go on with the scan of the checkpoint. The last rims are sent again, to a mesher that
        may not have them: it may have ended before they came, or its checkpoint may."""
        rims: deque[Rim] = deque(maxlen=max(_BURST, self.settings.checkpoint_every))

        def take_again(message: PointCloud2) -> None:
            contours = self._decode(message)
            self._order.add(contours.stamp_ns, (contours, message))
            rims.extend(self._add(contours))

        for message in self._checkpoint.recall():
            self.guard("contours", take_again, message)
        if self._watch.frames:
            self.get_logger().info(f"going on with a scan of {self._watch.frames} frames")
            self._recalled = True
            self._old = len(rims)
            self._queue(list(rims))

    def _queue(self, rims: list[Rim]) -> None:
        self._rims.extend(rims)
        self._send_rims()

    def _send_rims(self) -> None:
        """Publish a few rims; ~/finish may bring more at once than queues hold, so the
        rest go when these have been taken.

        Another process says so only when asked, by default every 3 s, and one that has died
        never: a burst goes after a while in any case.
        """
        self._resume.cancel()
        if self._recalled and not self._rim.get_subscription_count():
            self._resume.reset()
            return
        now = time.monotonic()
        taken = self._rim.wait_for_all_acked(Duration(nanoseconds=0))
        if taken or now - self._burst_since >= _PATIENCE_S:
            self._burst_since, self._burst_left = now, _BURST
        while self._rims and self._burst_left:
            self._burst_left -= 1
            rim = self._rims.popleft()
            with self.stages.timed("encode"):
                self.send("rim", encode_rim(rim, self._shape(rim)))
                self._sent += 1
            if self._old:
                self._old -= 1
            else:
                self.measure_latency(rim.stamp_ns)
        if self._rims:
            self._resume.reset()

    def _shape(self, rim: Rim) -> Shape | None:
        """The surface to second order, where that is asked for and the frame still kept."""
        if not self.settings.shape_fields:
            return None
        contours = self._reconstructor.contours_of(rim.stamp_ns)
        if contours is None:
            return Shape(*np.full((5, len(rim)), np.nan))
        return second_order_shape(contours, rim)

    async def _on_finish(self, _: Any, response: Trigger.Response) -> Trigger.Response:
        if self._watch.frames and self._steps is None:
            self._steps, self._owed = self._reconstructor.finishing(), 0
            self._finished = Future()
            self._step.trigger()
        response.success, response.message = False, "no contours have come yet"
        if self._steps is not None:
            response.success, response.message = await self._finished
        return response

    def _on_step(self) -> None:
        """One rim of those that finish; contours that come meanwhile wait."""
        if self._steps is None:
            return
        try:
            with self.stages.timed("finish step"):
                rim = next(self._steps)
        except StopIteration:
            self._on_last_step(*self.attempt(self._words_of_finish))
            return
        except Exception as error:
            self._on_last_step(False, self.failed("finish", error))
            return
        if rim is not None:
            self._owed += 1
            self.on_finishing(self._owed, self._watch.frames)
            self._watch.add_rims([rim])
            self._queue([rim])
        self._step.trigger()

    def _on_last_step(self, good: bool, words: str) -> None:
        # Who waits for the last rim knows it by its number.
        values: dict[str, Any] = {
            "rims sent": self._sent + len(self._rims),
            "frames": self._watch.frames,
        }
        name = f"{self.get_fully_qualified_name()}/turn"
        self.send("~/turn", encode_status(StatusReport(name, Level.OK, words, values)))
        self._steps = None
        self._finished.set_result((good, words))
        held, self._held = self._held, []
        for msg in held:
            self.guard("contours", self._on_contours, msg)

    def _words_of_finish(self) -> str:
        if not self._watch.statuses["good"]:
            raise ValueError(self._watch.no_point())
        if not self._owed:
            return "no rims were owed"
        return f"{self._owed} rims, still owed or with other points than before, are published"

    def _on_scan(self, msg: DiagnosticStatus) -> None:
        self._scan_over = scan_is_over(msg)
        before, self._state = self._state, decode_status(msg).values.get("state", "")
        if self._state == ScanState.SAVED.value != before and self._watch.frames:
            self._checkpoint.keep_saved()

    def _on_reset(self) -> str:
        if self._steps is not None:
            self._steps = None
            self._finished.set_result((False, "the scan was reset"))
        self._order.reset()
        self._rims.clear()
        self._old = 0
        self._new_scan()
        return "ready for a new scan"

    def _drop_contours(self, reason: str, contours: Contours) -> None:
        self.drop(reason, f"contours of {contours.stamp_ns * 1e-9:.3f} s")

    def counts_later(self, old: ReconstructorSettings, new: ReconstructorSettings) -> str:
        """The rim settings belong to a whole scan."""
        return NEXT_SCAN if new != old else ""

    def problems(self, counts: Counter[str]) -> Iterator[tuple[Level, str]]:
        """Whether anything comes, and whether it is kept."""
        if self._checkpoint.trouble:
            yield Level.WARN, self._checkpoint.trouble
        if self.loss.missed["contours"] and not self._checkpoint.recalled:
            yield (
                Level.WARN,
                f"{self.loss.missed['contours']} contours were sent before this node began: their "
                "rims are not joined to what follows; checkpoint_every and resume keep a scan",
            )
        if self.silent("contours", counts) and not self._scan_over:
            yield Level.WARN, f"no contours on {self.publishers_text('contours')}"
        for sentence in self._watch.doubts(self._scan_over):
            yield Level.WARN, sentence

    @property
    def calibration_px(self) -> float:
        """By how much poses or calibration seem to be off, 1 sigma in pixels."""
        return self._reconstructor.calibration.size_px

    def figures(self) -> dict[str, Any]:
        """The scan so far."""
        angle = np.rad2deg(angle_covered(self._reconstructor.centres))
        shares = {f"samples {name}": n for name, n in self._watch.statuses.items()}
        return {
            "frames": self._watch.frames,
            "angle covered deg": round(float(angle)),
            "rims waiting": len(self._rims),
            "calibration error px": round(self._reconstructor.calibration.size_px, 2),
            "pose error px": round(self._reconstructor.pose_error_px, 2),
            **shares,
            **self._checkpoint.figures(),
        }

    def destroy_node(self) -> None:
        """End; the checkpoint stays."""
        self._checkpoint.close()
        super().destroy_node()


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(ReconstructorNode)


if __name__ == "__main__":
    sys.exit(main())
