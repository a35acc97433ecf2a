"""An executor that does not look at the policies of every topic before each message."""

import time
from typing import Any

from rclpy.event_handler import EventHandler
from rclpy.executors import SingleThreadedExecutor

_EVENTS_S = 0.1
"""How late an event of the middleware may be told of."""


class NodeExecutor(SingleThreadedExecutor):
    """A ``SingleThreadedExecutor`` that waits for messages, timers and services at once as ever,
    but looks at the middleware's events (somebody's policies or type do not fit) ten times a
    second.

    Every publisher and subscription has two or three of those events, three quarters of what
    rclpy collects anew before each callback: for a node that has nothing to do that is most
    of the time it takes.
    """

    _looked = _look = 0.0  # the time of the last look at events; that of this round

    def can_execute(self, entity: Any) -> bool:
        """Whether to wait for an entity in this round."""
        if isinstance(entity, EventHandler) and self._looked != self._look:
            return False
        return super().can_execute(entity)

    def _wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """One round: all that is ready after one wait."""
        self._look = time.monotonic()
        if self._look - self._looked >= _EVENTS_S:
            self._looked = self._look
        return super()._wait_for_ready_callbacks(*args, **kwargs)
