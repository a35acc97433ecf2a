"""One guard for every callback: what goes wrong in it is counted and named, no more."""

import errno
import functools
import inspect
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from msg_adapters import Level
from occ_recon_ros.geometry.refusal import Refusal

_REPEAT_S = 10.0
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Dropped(Refusal):
    """A message that cannot be used."""


@contextmanager
def named(part: str) -> Iterator[None]:
    """Whatever is wrong in a block is counted as ``bad_<part>``."""
    try:
        yield
    except ValueError as error:
        raise Dropped(f"bad_{part}", f"{part}: {error}") from error


def failure(error: Exception) -> tuple[str, str]:
    """The name under which an exception is counted, and it in words."""
    if isinstance(error, MemoryError):
        return "out_of_memory", "out of memory: " + (str(error) or "fewer or smaller images help")
    if isinstance(error, OSError):
        words = error.strerror or str(error) or repr(error)
        place = f" ({error.filename})" if error.filename else ""
        return ("disk_full" if error.errno in _NO_ROOM else "os_error"), f"{words}{place}"
    return "internal_error", f"internal error: {error!r}"


class _WholeOrNone(type):
    """Of a node whose start fails nothing stays in the graph: it would count as a listener."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        node: Any = object.__new__(cls)  # type: ignore[arg-type]
        try:
            node.__init__(*args, **kwargs)
        except BaseException:
            with suppress(AttributeError):  # Node's own start failed: there is none
                Node.destroy_node(node)
            raise
        return node


class GuardedNode(Node, metaclass=_WholeOrNone):
    """A node that nothing in its callbacks can end: timers, subscriptions, services, guard
    conditions, and whatever is handed to ``guard``.

    Attributes:
        drops: how often something went unused or failed, by reason.
        last_drops: the sentence on the last of them, by reason.
        lost: whether something could not be saved as the node ended.
    """

    lost = False

    def __init__(self, name: str, **kwargs: Any) -> None:
        # Before Node makes its own services, which are guarded like all others.
        self.drops: Counter[str] = Counter()
        self.last_drops: dict[str, str] = {}
        self._new_drops: dict[str, tuple[Level, str]] = {}
        self._said: dict[str, float] = {}
        super().__init__(name, **kwargs)

    def create_timer(  # type: ignore[override]
        self, period: float, callback: Any, *args: Any, **kwargs: Any
    ) -> Timer:
        """As of Node, guarded."""
        return super().create_timer(period, self.guarded(callback), *args, **kwargs)

    def steady_timer(self, period_s: float, callback: Callable[[], Any]) -> Timer:
        """A timer of a clock that goes on where use_sim_time is true and no time comes."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        return self.create_timer(period_s, callback, clock=steady)

    def create_guard_condition(self, callback: Any, *args: Any, **kwargs: Any) -> GuardCondition:
        """As of Node, guarded."""
        return super().create_guard_condition(self.guarded(callback), *args, **kwargs)

    def create_subscription(  # type: ignore[override]
        self, kind: Any, topic: str, callback: Any, *args: Any, **kwargs: Any
    ) -> Subscription:
        """As of Node, guarded."""
        guarded = self.guarded(callback, topic)
        return super().create_subscription(kind, topic, guarded, *args, **kwargs)

    def create_service(  # type: ignore[override]
        self, kind: Any, service: str, callback: Any, *args: Any, **kwargs: Any
    ) -> Service:
        """As of Node, guarded: one that fails answers that it did."""
        return super().create_service(kind, service, self.guarded(callback), *args, **kwargs)

    def ask(self, client: Client, request: Any, take: Callable[[Any], None]) -> None:
        """Call a service; its answer is taken under guard."""
        future = client.call_async(request)
        future.add_done_callback(lambda done: self.guard(client.srv_name, take, done.result()))

    def guarded(self, callback: Callable[..., Any], what: str = "") -> Callable[..., Any]:
        """A callback after which the node goes on, whatever it raises."""
        what = what or getattr(callback, "__name__", "callback").strip("_")

        def failed(error: Exception, args: tuple[Any, ...]) -> Any:
            self._failed(what, error)
            response: Any = args[1] if len(args) == 2 else None
            if hasattr(response, "success") and hasattr(response, "message"):
                response.success, response.message = False, failure(error)[1]
            return response

        if inspect.iscoroutinefunction(callback):

            @functools.wraps(callback)
            async def later(*args: Any) -> Any:
                try:
                    return await callback(*args)
                except Exception as error:
                    return failed(error, args)

            return later

        @functools.wraps(callback)
        def now(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception as error:
                return failed(error, args)

        return now

    def guard(self, what: str, step: Callable[..., None], *args: Any) -> None:
        """Run a step; an exception becomes a counted drop."""
        try:
            step(*args)
        except Exception as error:
            self._failed(what, error)

    def attempt(self, act: Callable[[], str]) -> tuple[bool, str]:
        """Whether an action went well, and its sentence or why it failed."""
        try:
            return True, act()
        except Exception as error:
            return False, self.failed("service", error)

    def failed(self, what: str, error: Exception) -> str:
        """Why an action failed that somebody has asked for. A ValueError is an answer; all else
        is counted too."""
        if isinstance(error, ValueError):
            return str(error)
        self._failed(what, error)
        return failure(error)[1]

    def _failed(self, what: str, error: Exception) -> None:
        """Count and name what went wrong; even where there is no memory left to say it in."""
        try:
            if isinstance(error, ValueError):
                reason = getattr(error, "reason", f"bad_{what.replace('/', '_')}")
                self.drop(reason, str(error))
                return
            reason, words = failure(error)
            if reason == "internal_error":
                where = "".join(traceback.format_exception(error, limit=-3))
                self.say(where, where, Level.ERROR)
            self.drop(reason, f"{what}: {words}", Level.ERROR)
        except Exception:  # the count is all that can be kept
            self.drops["internal_error"] += 1

    def drop(self, reason: str, sentence: str, level: Level = Level.WARN) -> None:
        """Count a message that goes unused, and say why."""
        self.drops[reason] += 1
        self.last_drops[reason] = sentence
        self._new_drops[reason] = (level, sentence)
        self.say(reason, f"dropped ({reason}): {sentence}", level)

    def warn(self, what: str, sentence: str) -> None:
        """Say something once that is no drop."""
        self._new_drops[what] = (Level.WARN, sentence)
        self.say(what, sentence)

    def say(self, key: str, sentence: str, level: Level = Level.WARN) -> None:
        """Log a sentence, at most once in 10 s for each key."""
        now = time.monotonic()
        if now - self._said.get(key, -_REPEAT_S) < _REPEAT_S:
            return
        self._said = {k: t for k, t in self._said.items() if now - t < _REPEAT_S}
        self._said[key] = now
        # rclpy refuses another severity from the same line of code.
        if level == Level.ERROR:
            self.get_logger().error(sentence)
        else:
            self.get_logger().warning(sentence)
