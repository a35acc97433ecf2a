"""The mesher's scan as a whole: its state, its files, its closed body, its end."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import Level, StatusReport, decode_contours, encode_status
from occ_recon_ros.geometry import Contours, Rim, Status
from occ_recon_ros.streams.body_process import Body
from occ_recon_ros.streams.epochs import Epochs
from occ_recon_ros.streams.pace import Pace
from occ_recon_ros.streams.scan import Scan, ScanState
from occ_recon_ros.streams.scan_files import Result, ScanFiles, Strips
from occ_recon_ros.surface import Surface, exported

from .base import PipelineNode, named
from .checkpoint import Checkpoint
from .closed_body import ClosedBody
from .qos import latched, reliable
from .settings import MesherSettings
from .upstream import Upstream
from .waits import Waits

_TICK_S = 0.25
_TOLD_S = 1.0  # between two reports of figures
_RETRY_S = 5.0

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
        self.scan = Scan(self._tell, self.files.taken, lambda: node.settings.scan_name)
        self._waits = Waits(node)
        ready = node.create_guard_condition(self._on_body).trigger
        place = partial(self.files.path, name="closed")
        self._body = ClosedBody(node, ready, place) if settings.close_body else None
        self._result: Result | None = None  # what is written next
        self._running: tuple[int, Future] | None = None  # of a scan, by its number
        self._retry_at = 0.0
        self._pace = Pace()
        self._epoch = 0
        self._epochs = Epochs[_Heard]()
        node.subscribe(PointCloud2, "contours", self._on_contours, reliable(100))
        self._group = ReentrantCallbackGroup()  # ~/finish waits while all else goes on
        self._upstream = Upstream(node, self._waits, self._group)
        node.create_service(Trigger, "~/finish", self._on_finish, callback_group=self._group)
        node.steady_timer(_TICK_S, self._tick)
        self._tell()

    # What comes.

    def add_rim(self, rim: Rim, new: bool) -> None:
        """A rim has become part of the surface, for the first time or again."""
        if self.scan.state == ScanState.SAVED:
            self._result = None  # what was saved is not written over
        self.scan.add_outside(rim.stamp_ns, int(np.count_nonzero(rim.status == Status.OUTSIDE)))
        if new:
            self.scan.add_frame(len(rim), int(np.count_nonzero(rim.status == Status.GOOD)))
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
            self._pace.add(time.monotonic())
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
        before = self.scan.report
        if time_went_back and self._upstream.begins():
            self.scan.again()
        else:
            self._end()
            if time_went_back and before.state == ScanState.SCANNING:
                self.scan.cut_short(before)
        self._pace = Pace()
        if self._body:
            self._body.clear()
        self._checkpoint.clear()
        if not time_went_back:
            self._epochs.clear()
            return
        for heard in self._epochs.begin():
            self._add_contours(*heard)

    def _end(self) -> None:
        self._leave()
        self._epoch += 1
        self._upstream.give_up()
        self._result = None
        self.scan.clear()

    def _leave(self) -> None:
        """Write what is not saved; a body that is still to be made follows."""
        if self.scan.unsaved:
            for name, data in self._there().items():
                self._report(partial(self._write_last, self._target(), name, data))
        self._ask_last_body()

    def _there(self) -> dict[str, Callable[[], bytes]]:
        """The surfaces that can be written now."""
        files: dict[str, Callable[[], bytes]] = {}
        if len(self._surface()):
            files["mesh"] = partial(exported, self._surface().mesh(), self.files.suffix)
        if self._body and self._body.data:
            files["closed"] = partial(bytes, self._body.data)
        return files

    def _ask_last_body(self) -> None:
        """Have the body closed that is still due, of a scan that ends here."""
        only = self.scan.unsaved and not len(self._surface())  # it is all that can be saved
        due = self.scan.to_close or only or (self._body and self._body.outdated)
        if self._body and due and not self._body.made_of_all(self._result):
            self._body.ask(self._target())

    def _target(self) -> Result:
        """Whose files are written: what contradicts a saved scan does not take its place."""
        if self.scan.contradiction():
            self.scan.rename()
            self._result = None
        if self._result is None:
            self._result = Result(self.scan.named())
        return self._result

    def _write_last(self, result: Result, name: str, data: Callable[[], bytes]) -> str:
        return f"the scan before is saved: {self.files.write_or_owe(result, name, data)}"

    def _write_body(self, result: Result, body: Body) -> str:
        """Write a body that nobody waits for."""
        if not body.data:
            return f"no {self.files.path(result.scan_id, 'closed')}: {body.reason}"
        doubt = self._judge(body) if result is self._result else body.doubt
        said = self.files.write_or_owe(result, "closed", partial(bytes, body.data))
        return "; ".join(filter(None, (f"the body is saved: {said}", doubt)))

    def _judge(self, body: Body) -> str:
        """What is in doubt of the scan, in words: by its body or rims, and by what they are of."""
        said = body.doubt or self.scan.refuted(), self._upstream.told("doubt")
        self.scan.judged("; ".join(filter(None, said)))
        return self.scan.report.doubt

    def _report(self, act: Callable[[], str]) -> None:
        good, words = self._node.attempt(act)
        if good:
            self._node.get_logger().info(words)

    def shut_down(self) -> Iterator[str]:
        """Save what is not saved yet; says what, and what is waited for."""
        keeps = self._node.settings.save_on_shutdown
        saves = keeps and self.scan.unsaved and bool(self._there())
        if saves:
            yield self._attempt(self.save)
        if self._body:
            if keeps:
                self._ask_last_body()
                if saves and not self._body.made_of_all(self._result):
                    yield self._not_closed()
            self._body.clear()
            for news in self._body.last() if keeps else ():
                if isinstance(news, str):
                    yield news
                else:
                    saves |= bool(news[1].data)
                    yield self._attempt(partial(self._write_body, *news))
            self._body.stop()
        if keeps and self.scan.unsaved and self.scan.to_close and not saves:
            yield f"error: {self.scan.report.scan_id} is not saved: {self.scan.no_strips()}"
        for _ in range(self.files.waiting if keeps else 0):
            yield self._attempt(self._write_owed)

    def _not_closed(self) -> str:
        """How the body of a scan that ends in mid-turn is got."""
        path = self.files.path(self._target().scan_id, "closed")
        finish = f"{self._node.get_fully_qualified_name()}/finish closes it, before Ctrl-C"
        resumed = f" or after occ-recon run --resume {self._node.settings.checkpoint_path}"
        kept = resumed if self._checkpoint.kept else ""
        return f"no {path}: the turn had not ended; {finish}{kept}"

    def _attempt(self, act: Callable[[], str]) -> str:
        good, words = self._node.attempt(act)
        return words if good else f"error: {words}"

    def save(self) -> str:
        """Write the surface, and the closed body if it is up to date.

        Raises:
            ValueError: there are no triangles.
            OSError: it cannot be written.
        """
        there = self._there()
        if not there:
            raise ValueError("the surface has no triangles yet")
        doubt, result = self.scan.contradiction(), self._target()
        words = [str(self.files.write(result, name, data())) for name, data in there.items()]
        if "mesh" in there:
            words[0] += f": {len(self._surface())} triangles from {self.scan.report.frames} rims"
        if self._body and self._body.outdated:
            self._body.ask(result).cancel()  # nobody waits: it is written when it is made
            words.append("the body is closed anew, and follows")
        self.scan.unsaved = False
        return "; ".join(filter(None, (*words, doubt)))

    async def _on_finish(self, _: Any, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await self.finish()
        return response

    async def finish(self) -> tuple[bool, str]:
        """The last rims, the closed body and the files; whether it went well, and in words."""
        while self._running and self._running[0] != self._epoch:
            await self._running[1]  # of the scan before: it is given up
        if self._running:
            return await self._running[1]
        running = Future()
        self._running = self._epoch, running
        result = await self._finished()
        self._running = None
        running.set_result(result)
        return result

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
        self._result = None if self.scan.unsaved else self._result  # of what has come meanwhile
        self._checkpoint.keep_saved()
        return True, words

    async def _chain(self, epoch: int) -> str:
        scan_id = self.scan.report.scan_id
        if not scan_id:
            raise ValueError(self._upstream.with_drops("no contours have come: nothing to finish"))

        def go_on(reason: str) -> None:
            if epoch != self._epoch:
                where = self.files.folder / scan_id
                raise ValueError(
                    f"another scan has begun meanwhile: what there is of this one goes to {where}"
                )
            self.scan.go(ScanState.FINISHING, reason)

        go_on("the last rims are computed")
        before, missing = self._strips(), await self._upstream.last_rims()
        go_on("what single images say is held against the others")
        if again := await self._upstream.frames_again():
            go_on("the last rims are computed")
            before, missing = self._strips(), await self._upstream.last_rims()
        go_on("the body is closed")
        strips = before.unless_given_up(self._strips())  # more may come while the body is closed
        self.scan.write()
        doubt, result = self.scan.contradiction(), self._target()
        body = await self._body.made(self._waits, result) if self._body else Body()
        go_on("the files are written")
        remark = "; ".join(filter(None, (again, missing, strips.remark)))
        if not len(strips):
            remark = remark or self.scan.no_strips()
            if not body.data:
                raise ValueError(self._upstream.with_drops(remark))
        words = await self._waits.aside(self.files.writer(result, strips, body))
        go_on("")
        lacks = f"no closed body: {body.reason}" if body.reason else ""
        lost = self._upstream.told("images lost")
        said = words, lacks, remark, self.scan.unseen(), lost, doubt, self._judge(body)
        return "; ".join(filter(None, said))

    def _strips(self) -> Strips:
        surface = self._surface()
        return Strips(surface.mesh() if len(surface) else None, self.scan.report.frames)

    def _on_body(self) -> None:
        for result, body in self._body.came() if self._body else ():
            self._report(partial(self._write_body, result, body))

    # From time to time.

    def _tick(self) -> None:
        now = time.monotonic()
        self._waits.expire()
        self._upstream.look()
        for heard in self._epochs.overdue():
            self._add_contours(*heard)
        if self.files.owed and now >= self._retry_at:
            self._retry_at = now + _RETRY_S
            self._report(self._write_owed)
        if self._body and self.scan.state in (ScanState.SCANNING, ScanState.TURN_CLOSED):
            self._body.preview()
        if self._to_finish(now):
            executor = self._node.executor
            if executor is not None:
                self.scan.go(ScanState.FINISHING, "the camera is back where it began")
                executor.create_task(self._node.guarded(self._finish_turn))
        if now - self._told >= _TOLD_S and self.scan.report.scan_id:
            self._tell()

    def _write_owed(self) -> str:
        return f"saved at last: {self.files.write_owed()}"

    def _to_finish(self, now: float) -> bool:
        if not self.scan.turn_ended or self._running is not None:
            return False
        return self._node.settings.finish_when_closed and (
            self.scan.watch.passed or self._pace.quiet(now)
        )

    async def _finish_turn(self) -> None:
        good, words = await self.finish()
        if good:  # rclpy refuses another severity from the same line of code
            self._node.get_logger().info(words)
        else:
            self._node.get_logger().error(words)
        if good and self._node.settings.reset_when_saved:
            await self._upstream.reset()
            self._reset()

    def _tell(self) -> None:
        self._told = time.monotonic()
        report = self.scan.report
        level = Level.WARN if report.doubt or self.scan.trouble() else Level.OK
        level = Level.ERROR if report.state == ScanState.FAILED else level
        name = f"{self._node.get_fully_qualified_name()}/scan"
        words, values = report.sentence(), report.values()
        self._node.send("~/scan", encode_status(StatusReport(name, level, words, values)))

    def figures(self) -> dict[str, Any]:
        """The scan, for diagnostics."""
        scan, owed = self.scan.report.scan_id or "none yet", self.files.owed
        return {"scan": scan, "scan state": self.scan.state.value, "scans not saved yet": owed}
