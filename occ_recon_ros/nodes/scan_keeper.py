"""The mesher's scan as a whole: its state, its files, its closed body, its end."""

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import (
    Level,
    StatusReport,
    decode_contours,
    encode_status,
    encode_strip,
)
from occ_recon_ros.geometry import Contours, Rim, Status
from occ_recon_ros.streams.body_process import Body, BodyProcess
from occ_recon_ros.streams.epochs import Epochs
from occ_recon_ros.streams.scan import Scan, ScanState
from occ_recon_ros.streams.scan_files import ScanFiles
from occ_recon_ros.surface import Surface, exported

from .base import PipelineNode, named
from .checkpoint import Checkpoint
from .qos import latched, reliable
from .settings import MesherSettings
from .upstream import Upstream
from .waits import Waits

_TICK_S = 0.25
_TOLD_S = 1.0  # between two reports of figures
_QUIET_S = 1.0  # without a frame, or three times the usual pause: the table rests
_BODY_S, _ANSWER_S = 120.0, 120.0
_RETRY_S = 5.0
_MOST_OWED = 3  # scans that wait for a disk with room

_Heard = tuple[Contours, PointCloud2]


class ScanKeeper:
    """Owns the scan that a mesher is in.

    Args:
        node: the mesher.
        checkpoint: that keeps what the scan is made of.
        surface: the surface of the scan as it is now.
        reset: begins a new surface.
        keep: puts a message that the scan is made of into the checkpoint.
    """

    def __init__(
        self,
        node: PipelineNode[MesherSettings],
        checkpoint: Checkpoint,
        surface: Callable[[], Surface],
        reset: Callable[[], Any],
        keep: Callable[[PointCloud2], None],
    ) -> None:
        self._node, self._surface, self._reset = node, surface, reset
        self._checkpoint, self._keep = checkpoint, keep
        settings = node.settings
        self.files = ScanFiles(settings.output_dir, f".{settings.output_format}")
        node.advertise(DiagnosticStatus, "~/scan", latched())
        node.advertise(PointCloud2, "closed", latched())
        self._told = 0.0
        self.scan = Scan(self._tell, self.files.taken, lambda: node.settings.scan_name)
        self._waits = Waits(node)
        body_news = node.create_guard_condition(self._on_body)
        self._body = BodyProcess(body_news.trigger) if settings.close_body else None
        self._wanted_body: Future | None = None
        self._closed = b""  # the file of the body as it is now, if it is the whole one
        self._running: Future | None = None
        self._owed: deque[tuple[str, Any]] = deque(maxlen=_MOST_OWED)  # names and meshes
        self._retry_at = self._preview_at = 0.0
        self._arrivals: deque[float] = deque(maxlen=20)
        self._epoch = 0
        self._epochs = Epochs[_Heard]()
        node.subscribe(PointCloud2, "contours", self._on_contours, reliable(100))
        self._group = ReentrantCallbackGroup()  # ~/finish waits while all else goes on
        self._upstream = Upstream(node, self._waits, self._group)
        self._resets = [
            node.create_client(Trigger, f"{name}/reset", callback_group=self._group)
            for name in ("contour_tracker", "reconstructor")
        ]
        node.create_service(Trigger, "~/finish", self._on_finish, callback_group=self._group)
        node.steady_timer(_TICK_S, self._tick)
        self._tell()

    # What comes.

    def add_rim(self, rim: Rim, new: bool) -> None:
        """A rim has become part of the surface, for the first time or again."""
        if new:
            good = int(np.count_nonzero(rim.status == Status.GOOD))
            self.scan.add_frame(len(rim), good)
        self.scan.unsaved = True
        if self._body:
            self._body.add_rim(rim)

    def rim_came(self) -> None:
        """A message has come on the topic of rims."""
        self._upstream.rim_came()

    def add_view(self, image: Any, camera: Any) -> None:
        """An image that colours the surface."""
        if self._body:
            self._body.add_view(image, camera)

    def _on_contours(self, msg: PointCloud2) -> None:
        with named("contours"):
            contours = decode_contours(msg)
        if contours.frame_id != self._node.settings.object_frame:
            return  # the reconstructor says so
        if not len(contours):
            self._epochs.add_end(contours.stamp_ns)
            return
        for heard in self._epochs.add(contours.stamp_ns, (contours, msg)):
            self._add_contours(*heard)

    def recall_contours(self, msg: PointCloud2) -> None:
        """Contours of the scan that goes on."""
        contours = decode_contours(msg)
        for one, _ in self._epochs.add(contours.stamp_ns, (contours, msg)):
            self._use(one)

    def _add_contours(self, contours: Contours, msg: PointCloud2) -> None:
        if not self._node.paused:
            self._arrivals.append(time.monotonic())
            self._use(contours)
            if self._body:
                self._keep(msg)

    def _use(self, contours: Contours) -> None:
        self.scan.add_view(contours.centre)
        if self._body:
            self._body.add_contours(contours)

    # The end of a scan.

    def begin_anew(self, time_went_back: bool) -> None:
        """The scan ends here, whatever it lacks: it is saved, and another may begin. Or all of it
        comes again, taken better, and nothing is saved before."""
        if time_went_back and self._upstream.begins():
            self.scan.again()
        else:
            self._end()
        self._closed = b""
        self._arrivals.clear()
        if self._body:
            self._body.clear()
        self._checkpoint.clear()
        if not time_went_back:
            self._epochs.clear()
            return
        for heard in self._epochs.begin():
            self._add_contours(*heard)

    def _end(self) -> None:
        if self.scan.unsaved and len(self._surface()):
            self._node.guard("save", self._save_before_clearing)
        self._epoch += 1
        self.files.new_scan()
        self.scan.clear()

    def _save_before_clearing(self) -> None:
        name, mesh = self.scan.named(), self._surface().mesh()
        try:
            path = self._write(name, mesh)
        except OSError:
            self._owed.append((name, mesh))
            raise
        self._node.get_logger().info(f"the scan before is saved: {path}")

    def shut_down(self) -> str:
        """Save what is not saved yet; says what, "" for nothing."""
        if self._body:
            self._body.stop()
        if not (
            self.scan.unsaved and len(self._surface()) and self._node.settings.save_on_shutdown
        ):
            return ""
        good, words = self._node.attempt(self.save)
        return words if good else f"error: {words}"

    def save(self) -> str:
        """Write the surface, and the closed body if it is up to date.

        Raises:
            ValueError: there are no triangles.
            OSError: it cannot be written.
        """
        surface = self._surface()
        if not len(surface):
            raise ValueError("the surface has no triangles yet")
        name = self.scan.named()
        path = self._write(name, surface.mesh())
        words = f"{path}: {len(surface)} triangles from {self.scan.report.frames} rims"
        if self._closed:
            words += f"; {self.files.write(name, 'closed', self._closed)}"
        self.scan.unsaved = False
        return words

    def _write(self, name: str, mesh: Any) -> Path:
        return self.files.write(name, "mesh", exported(mesh, self.files.suffix))

    async def _on_finish(self, _: Any, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await self.finish()
        return response

    async def finish(self) -> tuple[bool, str]:
        """The last rims, the closed body and the files; whether it went well, and in words."""
        if self._running is None:
            self._running = Future()
            result = await self._finished()
            running, self._running = self._running, None
            running.set_result(result)
            return result
        return await self._running

    async def _finished(self) -> tuple[bool, str]:
        epoch = self._epoch
        try:
            words = await self._chain(epoch)
        except Exception as error:
            words = self._node.failed("finish", error)
            if epoch == self._epoch and self.scan.state == ScanState.FINISHING:
                self.scan.go(ScanState.FAILED, words)
            return False, words
        self.scan.go(ScanState.SAVED, words)
        self._checkpoint.keep_saved()
        return True, words

    async def _chain(self, epoch: int) -> str:
        if not self.scan.report.scan_id:
            raise ValueError("no frame has come yet: nothing to finish")

        def go_on(reason: str) -> None:
            if epoch != self._epoch:
                raise ValueError("another scan has begun meanwhile")
            self.scan.go(ScanState.FINISHING, reason)

        go_on("the last rims are computed")
        again = await self._upstream.frames_again()
        go_on("the last rims are computed")
        remark = "; ".join(filter(None, (again, await self._upstream.last_rims())))
        surface = self._surface()
        if not len(surface):
            raise ValueError(remark or "no rim has a neighbour to be joined to: turn further")
        go_on("the body is closed")
        body = await self._close_body()
        go_on("the files are written")
        words = await self._waits.aside(self._writer(surface, body))
        go_on("")
        self.scan.unsaved = False
        if body is not None and body.reason:
            words += f"; no closed body: {body.reason}"
        return "; ".join(filter(None, (words, remark)))

    async def _close_body(self) -> Body | None:
        if self._body is None:
            return None
        self._wanted_body = Future()
        self._body.ask(True, self._node.settings.body_cells, self.files.suffix)
        body = await self._waits.within(_BODY_S, self._wanted_body)
        self._wanted_body = None
        return body or Body(True, f"it took longer than {_BODY_S:.0f} s")

    def _writer(self, surface: Surface, body: Body | None) -> Callable[[], str]:
        """What writes the files as they are now."""
        name, mesh = self.scan.named(), surface.mesh()
        triangles, frames = len(surface), self.scan.report.frames

        def write() -> str:
            path = self._write(name, mesh)
            words = f"{path}: {triangles} triangles from {frames} rims"
            if body is not None and body.data:
                closed = self.files.write(name, "closed", body.data)
                words += f"; {closed}: watertight, {body.triangles} triangles"
            return words

        return write

    def _on_body(self) -> None:
        while self._body and (body := self._body.take()) is not None:
            self._take_body(body)

    def _take_body(self, body: Body) -> None:
        if body.full and self._wanted_body is not None:
            self._wanted_body.set_result(body)
        if body.full:
            self._closed = body.data
        if body.strip is not None and self.scan.report.scan_id:
            with self._node.stages.timed("closed"):
                self._node.send("closed", encode_strip(body.strip))
            self._node.stages["closing"].append(body.seconds)

    # From time to time.

    def _tick(self) -> None:
        now = time.monotonic()
        self._waits.expire()
        self._upstream.look()
        for heard in self._epochs.overdue():
            self._add_contours(*heard)
        if self._owed and now >= self._retry_at:
            self._retry_at = now + _RETRY_S
            self._node.guard("save", self._save_owed)
        self._preview(now)
        if self._to_finish(now):
            executor = self._node.executor
            if executor is not None:
                self.scan.go(ScanState.FINISHING, "the turn is closed")
                executor.create_task(self._node.guarded(self._finish_turn))
        if now - self._told >= _TOLD_S and self.scan.report.scan_id:
            self._tell()

    def _save_owed(self) -> None:
        name, mesh = self._owed[0]
        path = self._write(name, mesh)
        self._owed.popleft()
        self._node.get_logger().info(f"saved at last: {path}")

    def _preview(self, now: float) -> None:
        every, state = self._node.settings.closed_preview, self.scan.state
        if not self._body or self._body.busy or not every or now < self._preview_at:
            return
        if state in (ScanState.SCANNING, ScanState.TURN_CLOSED):
            self._preview_at = now + every
            self._body.ask(False, self._node.settings.body_cells)

    def _to_finish(self, now: float) -> bool:
        if self.scan.state != ScanState.TURN_CLOSED or self._running is not None:
            return False
        return self._node.settings.finish_when_closed and (
            self.scan.watch.passed or self.quiet(now)
        )

    def quiet(self, now: float) -> bool:
        """Whether no frame has come for longer than usual."""
        if not self._arrivals:
            return True
        pause = np.median(np.diff(self._arrivals)) if len(self._arrivals) > 1 else 0.0
        return now - self._arrivals[-1] > max(_QUIET_S, 3 * float(pause))

    async def _finish_turn(self) -> None:
        good, words = await self.finish()
        log = self._node.get_logger()
        (log.info if good else log.error)(words)
        if good and self._node.settings.reset_when_saved:
            for client in self._resets:
                if client.service_is_ready():
                    await self._waits.within(_ANSWER_S, client.call_async(Trigger.Request()))
            self._reset()

    def _tell(self) -> None:
        self._told = time.monotonic()
        report = self.scan.report
        level = Level.ERROR if report.state == ScanState.FAILED else Level.OK
        name = f"{self._node.get_fully_qualified_name()}/scan"
        words, values = report.sentence(), report.values()
        self._node.send("~/scan", encode_status(StatusReport(name, level, words, values)))

    def figures(self) -> dict[str, Any]:
        """The scan, for diagnostics."""
        scan, owed = self.scan.report.scan_id or "none yet", len(self._owed)
        return {"scan": scan, "scan state": self.scan.state.value, "scans not saved yet": owed}
