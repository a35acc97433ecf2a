"""What the end of a scan asks of the nodes before the mesher, and waits for: contours that come
again, and the rims of a closed turn."""

import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.callback_groups import CallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from msg_adapters import decode_diagnostics, decode_status

from .base import PipelineNode
from .qos import latched, reliable
from .waits import Waits

_BEFORE_CONTOURS = ("contour_tracker", "board_pose", "turntable_pose")
_AGAIN_S = 900.0  # a lesson and all frames again, on a slow machine
_QUIET_S = 1.0  # without a rim: the reconstructor has no more contours
_RIMS_S, _ANSWER_S = 10.0, 120.0


class Upstream:
    """The ~/finish of contour_tracker and of reconstructor.

    Args:
        node: the mesher.
        waits: of the node.
        group: of the callbacks that go on meanwhile.
    """

    def __init__(self, node: PipelineNode[Any], waits: Waits, group: CallbackGroup) -> None:
        self._node, self._waits = node, waits
        self._tracker, self._reconstructor = (
            node.create_client(Trigger, f"{name}/finish", callback_group=group)
            for name in ("contour_tracker", "reconstructor")
        )
        self._resets = [
            node.create_client(Trigger, f"{name}/reset", callback_group=group)
            for name in ("contour_tracker", "reconstructor")
        ]
        node.subscribe(DiagnosticStatus, "reconstructor/turn", self._on_turn, latched())
        node.subscribe(DiagnosticArray, "/diagnostics", self._on_diagnostics, reliable(10))
        self._drops: dict[str, Counter[str]] = {}  # as last told, by node
        self._before: dict[str, Counter[str]] = {}  # those of earlier scans
        self._said: dict[str, str] = {}  # with the last of them
        self._told: dict[str, Mapping[str, str]] = {}  # of the scan, by node
        self._awaited = Future()  # what is waited for now
        self._asked: Future | None = None  # the tracker's answer
        self._quiet: Future | None = None
        self._rim_at = 0.0
        self._expected = False
        self._turn: Future | None = None  # the number of rims that the reconstructor has sent
        self._wanted: tuple[int, Future] | None = None

    async def frames_again(self) -> str:
        """Let the tracker take again the frames that came before it had learnt how, until all of
        their rims are here; what was done, "" for nothing."""
        if not self._tracker.service_is_ready():
            return ""
        self._expected = True
        self._asked = self._tracker.call_async(Trigger.Request())
        answer = await self._within(_AGAIN_S, self._asked)
        self._asked = None
        if answer is None:
            return "" if self.begins() else "contour_tracker ended while frames were taken again"
        if answer.success:
            self._rim_at, self._quiet = time.monotonic(), Future()
            await self._within(_AGAIN_S, self._quiet)
            self._quiet = None
        self._expected = False
        return str(answer.message) if answer.success else ""

    def _within(self, seconds: float, future: Any) -> Any:
        self._awaited = future
        return self._waits.within(seconds, future)

    def give_up(self) -> None:
        """Another scan has begun: nothing of this one is waited for any more."""
        self._expected = False
        self._awaited.cancel()
        self._before = dict(self._drops)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for report in decode_diagnostics(msg):
            name = report.name.removeprefix(self._node.get_namespace().rstrip("/") + "/")
            if name not in _BEFORE_CONTOURS:
                continue
            self._told[name] = report.values
            values = {k.removeprefix("dropped "): v for k, v in report.values.items()}
            drops = Counter({k: int(values[k]) for k in values.keys() - report.values.keys()})
            if drops.total() > self._drops.get(name, Counter()).total():
                self._said[name] = report.message
            self._drops[name] = drops

    def with_drops(self, lacks: str) -> str:
        """What the scan lacks, behind what kept images of it from having contours, in words."""
        words = []
        for name, drops in self._drops.items():
            new = drops - self._before.get(name, Counter())
            if new:
                counts = ", ".join(f"{n} {reason}" for reason, n in new.most_common())
                words.append(f"{name} has dropped {counts}, and says: {self._said[name]}")
        return "; ".join((*words, lacks))

    def told(self, key: str) -> str:
        """What the nodes before contours last told of the scan under a key, in words."""
        return "; ".join(filter(None, (values.get(key) for values in self._told.values())))

    def begins(self) -> bool:
        """Whether what begins anew now is the same scan, taken again."""
        begins, self._expected = self._expected, False
        return begins

    async def last_rims(self) -> str:
        """Let the reconstructor send the rims that it owes, until all of the turn are here; what
        is missing, "" for nothing."""
        if not self._reconstructor.service_is_ready():
            return "the reconstructor is not there: the last rims are missing"
        self._turn = Future()
        asked = self._reconstructor.call_async(Trigger.Request())
        answer = await self._within(_ANSWER_S, asked)
        if answer is None or not answer.success:
            return answer.message if answer else "the reconstructor does not answer"
        sent = await self._within(_RIMS_S, self._turn)
        self._turn = None
        if sent is None or self._node.loss.last("rim") >= sent:
            return ""
        self._wanted = (sent, Future())
        came = await self._within(_RIMS_S, self._wanted[1])
        self._wanted = None
        return "" if came else "some of the last rims were lost on the way"

    async def reset(self) -> None:
        """Have those that are there begin the next scan."""
        for client in self._resets:
            if client.service_is_ready():
                await self._waits.within(_ANSWER_S, client.call_async(Trigger.Request()))

    def _on_turn(self, msg: DiagnosticStatus) -> None:
        if self._turn is not None:
            self._turn.set_result(int(decode_status(msg).values["rims sent"]))

    def rim_came(self) -> None:
        """A message has come on the topic of rims."""
        self._rim_at = time.monotonic()
        if self._wanted and self._node.loss.last("rim") >= self._wanted[0]:
            self._wanted[1].set_result(True)
            self._wanted = None

    def look(self) -> None:
        """To be called from time to time: is who was asked still there, have all rims come?"""
        if self._asked is not None and not self._tracker.service_is_ready():
            self._asked.cancel()  # who was asked is no more
        quiet = self._quiet
        if quiet is not None and time.monotonic() - self._rim_at > _QUIET_S and not quiet.done():
            quiet.set_result(True)
