"""What a callback that is a coroutine waits for: with a deadline, or done in a thread."""

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

from rclpy.task import Future

from .guarding import GuardedNode


class Waits:
    """Futures of one node. ``expire`` is to be called from time to time."""

    def __init__(self, node: GuardedNode) -> None:
        self._news = node.create_guard_condition(self._on_news)
        self._done: SimpleQueue[tuple[Future, Any]] = SimpleQueue()
        self._deadlines: list[tuple[float, Future]] = []

    def within(self, seconds: float, future: Any) -> Any:
        """A future that gives None when it is not done in time."""
        self._deadlines.append((time.monotonic() + seconds, future))
        return future

    def aside(self, act: Callable[[], Any]) -> Any:
        """A future of something slow that is done in a thread; the other callbacks go on."""
        future = Future()

        def work() -> None:
            try:
                result: Any = act()
            except Exception as error:
                result = error
            self._done.put((future, result))
            self._news.trigger()

        Thread(target=work, daemon=True).start()
        return future

    def _on_news(self) -> None:
        while True:
            try:
                future, result = self._done.get_nowait()
            except Empty:
                return
            if isinstance(result, Exception):
                future.set_exception(result)
            else:
                future.set_result(result)

    def expire(self) -> None:
        """Give up what is overdue."""
        now = time.monotonic()
        for deadline in [d for d in self._deadlines if d[1].done() or now > d[0]]:
            self._deadlines.remove(deadline)
            deadline[1].cancel()
