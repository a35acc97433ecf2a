"""The tracker's ~/finish, as the end of a scan waits for it: contours that come again."""

import time

from rclpy.callback_groups import CallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from .guarding import GuardedNode
from .waits import Waits

_MOST_S = 900.0  # a lesson and all frames again, on a slow machine
_QUIET_S = 1.0  # without a rim: the reconstructor has no more contours


class Retaking:
    """Asks the tracker to take again the frames that came before it had learnt how.

    Args:
        node: the mesher.
        waits: of the node.
        group: of the callbacks that go on meanwhile.
    """

    def __init__(self, node: GuardedNode, waits: Waits, group: CallbackGroup) -> None:
        self._waits = waits
        self._client = node.create_client(Trigger, "contour_tracker/finish", callback_group=group)
        self._asked: Future | None = None
        self._quiet: Future | None = None
        self._rim_at = 0.0
        self._expected = False

    async def __call__(self) -> str:
        """Wait until all that comes again is here; what was done, "" for nothing."""
        if not self._client.service_is_ready():
            return ""
        self._expected = True
        self._asked = self._client.call_async(Trigger.Request())
        answer = await self._waits.within(_MOST_S, self._asked)
        self._asked = None
        if answer is None:
            begun = not self._expected
            self._expected = False
            return "contour_tracker ended while frames were taken again" if begun else ""
        if not answer.success:
            self._expected = False
            return ""
        self._rim_at, self._quiet = time.monotonic(), Future()
        await self._waits.within(_MOST_S, self._quiet)
        self._quiet = None
        self._expected = False
        return str(answer.message)

    def begins(self) -> bool:
        """Whether what begins anew now is the same scan, taken again."""
        begins, self._expected = self._expected, False
        return begins

    def rim_came(self) -> None:
        """A rim has come."""
        self._rim_at = time.monotonic()

    def look(self) -> None:
        """To be called from time to time: is who was asked still there, have all rims come?"""
        if self._asked is not None and not self._client.service_is_ready():
            self._asked.cancel()  # who was asked is no more
        quiet = self._quiet
        if quiet is not None and time.monotonic() - self._rim_at > _QUIET_S and not quiet.done():
            quiet.set_result(True)
