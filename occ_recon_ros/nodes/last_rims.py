"""The reconstructor's ~/finish, as the end of a scan waits for it: the rims of a closed turn."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import CallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from msg_adapters import decode_status

from .base import PipelineNode
from .qos import latched
from .waits import Waits

_RIMS_S, _ANSWER_S = 10.0, 120.0


class LastRims:
    """Asks the reconstructor for the rims that it owes, and waits until they are here.

    Args:
        node: the mesher.
        waits: of the node.
        group: of the callbacks that go on meanwhile.
    """

    def __init__(self, node: PipelineNode[Any], waits: Waits, group: CallbackGroup) -> None:
        self._node, self._waits = node, waits
        self._turn: Future | None = None
        self._wanted: tuple[int, Future] | None = None
        node.subscribe(DiagnosticStatus, "reconstructor/turn", self._on_turn, latched())
        self._client = node.create_client(Trigger, "reconstructor/finish", callback_group=group)

    async def __call__(self) -> str:
        """Wait until all rims of the turn are here; says what is missing."""
        if not self._client.service_is_ready():
            return "the reconstructor is not there: the last rims are missing"
        self._turn = Future()
        answer = await self._waits.within(_ANSWER_S, self._client.call_async(Trigger.Request()))
        if answer is None or not answer.success:
            return answer.message if answer else "the reconstructor does not answer"
        sent = await self._waits.within(_RIMS_S, self._turn)
        self._turn = None
        if sent is None or self._node.loss.last("rim") >= sent:
            return ""
        self._wanted = (sent, Future())
        came = await self._waits.within(_RIMS_S, self._wanted[1])
        self._wanted = None
        return "" if came else "some of the last rims were lost on the way"

    def _on_turn(self, msg: DiagnosticStatus) -> None:
        if self._turn is not None:
            self._turn.set_result(int(decode_status(msg).values["rims sent"]))

    def rim_came(self) -> None:
        """A message has come on the topic of rims."""
        if self._wanted and self._node.loss.last("rim") >= self._wanted[0]:
            self._wanted[1].set_result(True)
            self._wanted = None
