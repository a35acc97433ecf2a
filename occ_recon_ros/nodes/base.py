"""What all nodes share: parameters, counted topics, services, diagnostics."""

from collections import Counter, deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image
from std_srvs.srv import SetBool, Trigger

from msg_adapters import Level, StatusReport, decode_status, encode_diagnostics
from occ_recon_ros.streams.loss import LossCount
from occ_recon_ros.streams.scan import OVER
from occ_recon_ros.streams.statistics import Rates, Stages, memory_mb, spread_ms

from .guarding import Dropped, GuardedNode, named
from .parameters import Parameters, unknown_names
from .qos import compressed_topic, publishers, sensor
from .settings import all_names

__all__ = ["NEXT_SCAN", "Dropped", "PipelineNode", "named", "scan_is_over"]

Settings = TypeVar("Settings")

NEXT_SCAN = "takes effect in the next scan: call ~/reset"

_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)

_SILENT_LOOKS = 5
_SHARED = ("/diagnostics", "/tf", "/tf_static", "joint_states")
"""Topics that several may publish on, each its own part."""


def scan_is_over(msg: DiagnosticStatus) -> bool:
    """Whether nothing more has to come, as the mesher's ~/scan tells: a finished scan is quiet."""
    return decode_status(msg).values.get("state") in {state.value for state in OVER}


class PipelineNode(GuardedNode, Generic[Settings]):
    """A node with checked parameters that says how it fares.

    Attributes:
        loss: what the numbers of the messages tell of those that never came.
        stages: durations of the steps of each frame, seconds.
        latency: seconds from the image's stamp to what this node made of it.
        loss_matters: whether messages that were lost are a trouble, not only a count.
        carrier: topic of the form that images come in, None before the first.
    """

    loss_matters = True

    def __init__(self, name: str, settings_type: type[Settings], **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._parameters_of_ours = Parameters(self, settings_type)
        self.loss = LossCount()
        self.stages = Stages()
        self.latency: deque[float] = deque(maxlen=1000)
        self._quiet: Counter[str] = Counter()  # looks in a row without a message, by topic
        self._lost: Counter[str] = Counter()  # since the last look, by topic
        self._rates = Rates()
        self._mismatches: dict[str, str] = {}
        self._outputs: dict[str, Publisher] = {}
        self.paused = False
        self.carrier: str | None = None
        self._diagnostics = self.advertise(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self.steady_timer(1.0, self._publish_diagnostics)

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
        newest_only = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL

        def counted(message: Any, info: dict) -> None:
            self._rates.counts[topic] += 1
            if not newest_only:
                self._count_lost(topic, info)
            handle(message)

        mismatch = self.guarded(partial(self._qos_mismatch, name, "publisher"), "mismatch")
        return self.create_subscription(
            kind,
            topic,
            counted,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=mismatch),
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )

    def subscribe_images(self, handle: Callable[[Any], None]) -> str:
        """Subscribe to ``image``, raw and compressed: where a camera offers both, the form that
        came first is used as long as it lives. Returns the topic of the compressed one."""

        def take(topic: str, message: Any) -> None:
            if self.carrier in (None, topic) or not self.publishers_of(self.carrier):
                self.carrier = topic
                handle(message)

        compressed = compressed_topic(self, "image")
        self.subscribe(Image, "image", partial(take, "image"), sensor())
        self.subscribe(CompressedImage, compressed, partial(take, compressed), sensor())
        return compressed

    def refuse_other_frame(self, reason: str, words: str, frame_id: str) -> None:
        """Drop what is not in the object frame of the settings."""
        wanted = self.get_parameter("object_frame").value
        if frame_id != wanted:
            raise Dropped(
                reason,
                f"{words} '{frame_id}', object_frame is '{wanted}': set object_frame",
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

        def matched(event: Any) -> None:
            if on_viewers:
                on_viewers(int(event.current_count))

        mismatch = self.guarded(partial(self._qos_mismatch, name, "subscriber"), "mismatch")
        self._outputs[topic] = self.create_publisher(
            kind,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(
                incompatible_qos=mismatch, matched=self.guarded(matched)
            ),
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

    def offer_pause(self, words: str) -> None:
        """~/pause: what comes is dropped by name until it is called with false.

        Args:
            words: what is dropped meanwhile.
        """

        def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            self.paused = bool(request.data)
            response.success = True
            response.message = f"paused: {words} are dropped" if self.paused else "going on"
            return response

        self.create_service(SetBool, "~/pause", answer)

    def publishers_of(self, topic: str) -> int:
        """How many publish on a topic."""
        return self.count_publishers(self.resolve_topic_name(topic))

    # Words and figures.

    def warn_of_unknown_parameters(self) -> None:
        """To be called when all topics exist, because those declare parameters too."""
        for sentence in unknown_names(self, all_names()):
            self.get_logger().warning(sentence)

    def publishers_text(self, topic: str) -> str:
        """Who publishes on a topic, in words."""
        return f"{self.resolve_topic_name(topic)} (publishers: {publishers(self, topic)})"

    def silent(self, topic: str, counts: Counter[str]) -> bool:
        """Whether nothing has come on a topic of ours for some looks: each begins when the one
        before it has, and a table may rest. To be asked once a look."""
        self._quiet[topic] = 0 if counts[topic] else self._quiet[topic] + 1
        return self._quiet[topic] >= _SILENT_LOOKS

    def measure_latency(self, stamp_ns: int) -> None:
        """Note how long ago the image was taken, if its stamps are of this clock."""
        seconds = (self.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        if 0 <= seconds < 3600:
            self.latency.append(seconds)

    def _count_lost(self, topic: str, info: dict) -> None:
        number = info.get("publication_sequence_number")
        if number is None:
            return
        missing, another = self.loss.take(topic, number)
        if another and topic not in _SHARED:
            self._new_drops[f"restart {topic}"] = (
                Level.WARN,
                f"its publisher was restarted, or there are two: {self.publishers_text(topic)}",
            )
        if missing and self.publishers_of(topic) == 1:
            self.drops[f"lost_{topic.replace('/', '_')}"] += missing
            self._lost[topic] += missing

    def _loss_words(self, topic: str, lost: int) -> str:
        return (
            f"{lost} messages of {self.resolve_topic_name(topic)} were lost: they come faster than "
            "they are worked on, or the transport loses them"
        )

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
        lost, self._lost = self._lost, Counter()
        if self.loss_matters:
            problems += [(Level.WARN, self._loss_words(*item)) for item in lost.items()]
        problems += list(self.problems(counts))
        if self.get_parameter("use_sim_time").value and not self.get_clock().now().nanoseconds:
            words = f"no time has come on {self.publishers_text('/clock')}"
            problems.append((Level.WARN, f"use_sim_time is true, but {words}"))
        for problem_level, text in problems:
            self.say(text, text, problem_level)
        problems += [(level, f"{k}: {text}") for k, (level, text) in self._new_drops.items()]
        self._new_drops = {}
        level = max((level for level, _ in problems), default=Level.OK)
        report = StatusReport(
            self.get_fully_qualified_name(),
            level,
            "; ".join(dict.fromkeys(text for _, text in problems)) or "OK",
            self._values(counts, seconds),
        )
        now = self.get_clock().now().nanoseconds
        self._diagnostics.publish(encode_diagnostics(report, max(now, 0)))

    def _values(self, counts: Counter[str], seconds: float) -> dict[str, Any]:
        """All figures, numbers with the unit in the key, so that they can be plotted."""
        values: dict[str, Any] = {
            f"{topic} rate Hz": round(n / seconds, 2) for topic, n in sorted(counts.items())
        }
        for name, times in [*self.stages.items(), ("latency", self.latency)]:
            values |= spread_ms(name, times)
        values |= {f"dropped {reason}": n for reason, n in sorted(self.drops.items())}
        restarts = sorted(self.loss.restarts.items())
        values |= {f"{topic} publisher restarts": n for topic, n in restarts}
        values |= {
            f"{topic} subscribers": publisher.get_subscription_count()
            for topic, publisher in self._outputs.items()
            if publisher is not self._diagnostics
        }
        values |= self.figures()
        values["memory MB"], values["memory peak MB"] = memory_mb()
        return values
