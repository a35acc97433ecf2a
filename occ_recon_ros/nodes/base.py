"""What all nodes share: parameters, guarded subscriptions, counted drops, diagnostics."""

from __future__ import annotations

import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from msg_adapters import Level, StatusReport, encode_diagnostics
from occ_recon_ros.streams.memory import memory_text
from occ_recon_ros.streams.statistics import Rates, Stages, median_p95

from .parameters import Parameters, unknown_names
from .qos import publishers
from .settings import all_names

Settings = TypeVar("Settings")

NEXT_SCAN = "takes effect in the next scan: call ~/reset"

_REPEAT_S = 10.0
_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


class Dropped(ValueError):
    """A message that cannot be used.

    Attributes:
        reason: short snake_case name under which the drop is counted.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@contextmanager
def named(part: str) -> Iterator[None]:
    """Whatever is wrong in a block is counted as ``bad_<part>``."""
    try:
        yield
    except ValueError as error:
        raise Dropped(f"bad_{part}", f"{part}: {error}") from error


class PipelineNode(Node, Generic[Settings]):
    """A node that no message can stop and that says how it fares.

    Attributes:
        drops: how many messages were dropped, by reason.
        missed: by topic, how many messages its publisher had sent before this node began.
        restarts: by topic, how often its publisher was another all at once.
        stages: durations of the steps of each frame, seconds.
        latency: seconds from the image's stamp to what this node made of it.
    """

    def __init__(self, name: str, settings_type: type[Settings], **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._parameters_of_ours = Parameters(self, settings_type)
        self.drops: Counter[str] = Counter()
        self.missed: Counter[str] = Counter()
        self.restarts: Counter[str] = Counter()
        self.stages = Stages()
        self.latency: deque[float] = deque(maxlen=1000)
        self._rates = Rates()
        self._told: dict[str, float] = {}
        self._new_drops: dict[str, tuple[Level, str]] = {}
        self._mismatches: dict[str, str] = {}
        self._sequence: dict[str, int] = {}
        self._outputs: dict[str, Publisher] = {}
        self._diagnostics = self.advertise(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        # Wall time: with use_sim_time and no clock, a node must still say that it waits.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)

    @property
    def settings(self) -> Settings:
        """The parameters now in force."""
        return self._parameters_of_ours.values

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As the parameter services call it: the answer says what does not count at once."""
        old = self.settings
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            result.reason = self.counts_later(old, self.settings)
            if result.reason:
                self.get_logger().info(result.reason)
        return result

    # What a node fills in.

    def counts_later(self, old: Settings, new: Settings) -> str:
        """What whoever changes parameters is told if the change does not count at once."""
        return ""

    def problems(self, counts: Counter[str]) -> Iterable[tuple[Level, str]]:
        """What is wrong, in sentences a person can act on.

        Args:
            counts: messages since the last look, by topic.
        """
        return ()

    def figures(self) -> dict[str, Any]:
        """Further figures for diagnostics."""
        return {}

    # Topics.

    def subscribe(
        self, kind: type, topic: str, handle: Callable[[Any], None], qos: QoSProfile
    ) -> Subscription:
        """Subscribe; whatever a message holds, the node goes on."""
        name = self.resolve_topic_name(topic)

        def guarded(message: Any, info: dict) -> None:
            self._rates.counts[topic] += 1
            self._count_lost(topic, info)
            self.guard(topic, handle, message)

        def mismatch(event: Any) -> None:
            self._qos_mismatch(name, "publisher", event)

        return self.create_subscription(
            kind,
            topic,
            guarded,  # type: ignore[arg-type]  # two arguments: rclpy's annotation lacks it
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=mismatch),
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )

    def advertise(
        self,
        kind: type,
        topic: str,
        qos: QoSProfile,
        on_viewers: Callable[[int], None] | None = None,
    ) -> Publisher:
        """Publish; say so when a subscriber asks for what this topic does not offer.

        Args:
            kind: type of the messages.
            topic: name, relative ones in the namespace of the node.
            qos: quality of service, which parameters can override.
            on_viewers: told how many subscribe, whenever that changes.
        """
        name = self.resolve_topic_name(topic)

        def mismatch(event: Any) -> None:
            self._qos_mismatch(name, "subscriber", event)

        def matched(event: Any) -> None:
            if on_viewers:
                on_viewers(int(event.current_count))

        self._outputs[topic] = self.create_publisher(
            kind,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(incompatible_qos=mismatch, matched=matched),
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )
        return self._outputs[topic]

    def send(self, topic: str, message: Any) -> None:
        """Publish on an advertised topic, and count."""
        self._outputs[topic].publish(message)
        self._rates.counts[topic] += 1

    def offer(self, service: str, act: Callable[[], str]) -> None:
        """A Trigger service; it answers with the sentence of ``act``, or why it failed."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = self.attempt(act)
            return response

        self.create_service(Trigger, service, answer)

    def attempt(self, act: Callable[[], str]) -> tuple[bool, str]:
        """Whether an action went well, and its sentence or why it failed."""
        try:
            return True, act()
        except (ValueError, OSError) as error:
            return False, str(error)
        except Exception as error:
            self.get_logger().error(traceback.format_exc(limit=-3))
            return False, f"internal error: {error!r}"

    def publishers_of(self, topic: str) -> int:
        """How many publish on a topic."""
        return self.count_publishers(self.resolve_topic_name(topic))

    def guard(self, topic: str, step: Callable[..., None], *args: Any) -> None:
        """Run a step; an exception becomes a counted drop."""
        try:
            step(*args)
        except ValueError as error:
            reason = getattr(error, "reason", f"bad_{topic.replace('/', '_')}")
            self.drop(reason, str(error))
        except Exception as error:
            where = traceback.format_exc(limit=-3)
            self.drop("internal_error", f"{topic}: {error!r}", Level.ERROR)
            self.get_logger().error(where, throttle_duration_sec=_REPEAT_S)

    # Words and figures.

    def drop(self, reason: str, sentence: str, level: Level = Level.WARN) -> None:
        """Count a message that goes unused, and say why."""
        self.drops[reason] += 1
        self._new_drops[reason] = (level, sentence)
        self.say(reason, f"dropped ({reason}): {sentence}", level)

    def say(self, key: str, sentence: str, level: Level = Level.WARN) -> None:
        """Log a sentence, at most once in 10 s for each key."""
        now = time.monotonic()
        if now - self._told.get(key, -_REPEAT_S) >= _REPEAT_S:
            self._told = {k: t for k, t in self._told.items() if now - t < _REPEAT_S}
            self._told[key] = now
            (self.get_logger().error if level == Level.ERROR else self.get_logger().warning)(
                sentence
            )

    def warn_of_unknown_parameters(self) -> None:
        """To be called when all topics exist, because those declare parameters too."""
        for sentence in unknown_names(self, all_names()):
            self.get_logger().warning(sentence)

    def publishers_text(self, topic: str) -> str:
        """Who publishes on a topic, in words."""
        return f"{self.resolve_topic_name(topic)} (publishers: {publishers(self, topic)})"

    def measure_latency(self, stamp_ns: int) -> None:
        """Note how long ago the image was taken, if its stamps are of this clock."""
        seconds = (self.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        if 0 <= seconds < 3600:
            self.latency.append(seconds)

    def _count_lost(self, topic: str, info: dict) -> None:
        """Gaps in the publisher's numbers are messages that never came; numbers that begin
        anew are another publisher."""
        number = info.get("publication_sequence_number")
        if number is None:
            return
        last = self._sequence.get(topic)
        self._sequence[topic] = number
        if last is None:
            self.missed[topic] = number - 1
        elif number < last:
            self.restarts[topic] += 1
            self._new_drops[f"restart {topic}"] = (
                Level.WARN,
                f"its publisher was restarted, or there are two: {self.publishers_text(topic)}",
            )
        elif number > last + 1 and self.publishers_of(topic) == 1:
            self.drops[f"lost_{topic.replace('/', '_')}"] += number - last - 1

    def _qos_mismatch(self, name: str, peer: str, event: Any) -> None:
        try:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
        except (ValueError, KeyError):
            policy = str(event.last_policy_kind)
        sentence = f"a {peer} of {name} cannot be used: its {policy} does not fit ours"
        self._mismatches[name] = sentence
        self.say(f"qos {name}", sentence)

    def _publish_diagnostics(self) -> None:
        counts, seconds = self._rates.take()
        problems = [(Level.WARN, text) for text in self._mismatches.values()]
        problems += list(self.problems(counts))
        for problem_level, text in problems:
            self.say(text, text, problem_level)
        problems += [(level, f"{k}: {text}") for k, (level, text) in self._new_drops.items()]
        self._new_drops = {}
        level = max((level for level, _ in problems), default=Level.OK)
        values: dict[str, Any] = {
            f"{topic} rate": f"{n / seconds:.1f} Hz" for topic, n in sorted(counts.items())
        }
        values |= {name: median_p95(times) for name, times in self.stages.items()}
        if self.latency:
            values["latency from the image"] = median_p95(self.latency)
        values |= {f"dropped {reason}": n for reason, n in sorted(self.drops.items())}
        values |= {f"{topic} publisher restarts": n for topic, n in sorted(self.restarts.items())}
        values |= {
            f"{topic} subscribers": publisher.get_subscription_count()
            for topic, publisher in self._outputs.items()
            if publisher is not self._diagnostics
        }
        values |= self.figures()
        values["memory"] = memory_text()
        report = StatusReport(
            self.get_fully_qualified_name(),
            level,
            "; ".join(dict.fromkeys(text for _, text in problems)) or "OK",
            values,
        )
        now = self.get_clock().now().nanoseconds
        self._diagnostics.publish(encode_diagnostics(report, max(now, 0)))
