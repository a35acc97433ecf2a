"""Feeding the pipeline: a recording at full rate or in time, or the virtual turntable."""

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from msg_adapters import encode_clock, message_type
from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.reader import BagMessage
from occ_recon_ros.bags.views import Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.nodes.qos import reliable
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.report.heard import Sent
from occ_recon_ros.streams.scan_order import FAR_AHEAD_NS
from occ_recon_ros.streams.topics import IMAGES, TYPE_NAMES

from .listener import Listener
from .pipeline import Pipeline

_OURS = (*TYPE_NAMES, "/contours", "/rim")
_FOR_THE_TRACKER = ("/mask", "/mask/compressed", "/camera_pose_cov")
_START_TIMEOUT_S = 20.0
_ANSWER_TIMEOUT_S = 30.0
_UNPAIRED_TIMEOUT_S = 0.5
_UNPAIRED_LIMIT = 3
_MOST_HELD = 8  # images; the tracker waits for no more of their stamps than sync_queue
_STAMPS_KEPT = 256
_TICK_S = 0.025


class Player:
    """Publishes serialised messages as they are, and on request the time that they tell."""

    def __init__(
        self, pipeline: Pipeline, node: Node, topics: Collection[str], clock: bool
    ) -> None:
        self.publishers: dict[str, Publisher] = {
            topic: node.create_publisher(message_type(TYPE_NAMES[topic]), topic, reliable(100))
            for topic in topics
        }
        self.masked = any(topic.startswith("/mask") for topic in topics)
        self._clock = node.create_publisher(Clock, "/clock", reliable(10)) if clock else None
        self._time = 0
        # The tracker, and but for masks our listener.
        _wait_for_nodes(
            pipeline,
            lambda: all(
                publisher.get_subscription_count() >= (1 if topic in _FOR_THE_TRACKER else 2)
                for topic, publisher in self.publishers.items()
            ),
        )

    def send(self, message: BagMessage) -> None:
        """Publish one message, at the time it was recorded."""
        self.tell_time(message.time_ns)
        self.publishers[message.topic].publish(message.cdr)

    def tell_time(self, time_ns: int) -> None:
        """Set the clock of the nodes, if there is one, but never back."""
        if self._clock is not None:
            self._time = max(self._time, time_ns)
            self._clock.publish(encode_clock(self._time))


class Feed:
    """Knows of each image that goes in whether something came of it: contours, or a counted drop.

    Args:
        pipeline: the nodes.
        listener: hears them.
        progress: told the images so far, and all of them.
        total: images there will be.

    Attributes:
        sent: what went in.
    """

    def __init__(
        self, pipeline: Pipeline, listener: Listener, progress: Progress, total: int
    ) -> None:
        self.pipeline, self._listener = pipeline, listener
        self._progress, self._total = progress, total
        self.sent = Sent()
        self._open: set[int] = set()
        self._drops = self._dropped()

    def count(self) -> None:
        """An image has gone in.

        Raises:
            UserError: frames or contours of somebody else would become part of this surface.
        """
        self.sent.images += 1
        for topic in _OURS:
            if self._listener.count_publishers(topic) > 1:
                domain = self._listener.context.get_domain_id()
                raise UserError(
                    f"another node publishes on {topic} in ROS domain {domain}: stop it, or set "
                    "ROS_DOMAIN_ID to a number that is free"
                )
        self._progress(self.sent.images, self._total)

    def done(self) -> Sent:
        """What went in, when nothing more does and all of it has been worked on."""
        self.pipeline.nodes["contour_tracker"].use_what_waits()
        self.pipeline.settle()
        left = self._still_open()
        came = self._listener.heard.samples
        self.sent.unanswered = [s for s in (*self.sent.unanswered, *left) if s not in came]
        return self.sent

    def _dropped(self) -> int:
        return int(self.pipeline.nodes["contour_tracker"].drops.total())

    def wait(self, stamp_ns: int, whole: bool) -> None:
        """Wait for what comes of an image just sent, and count it.

        Args:
            stamp_ns: of the image.
            whole: all that the tracker needs for it has been sent. If not, it is waited for
                only when too many such images are open.
        """
        self._open.add(stamp_ns)
        if whole:
            answered = self.pipeline.spin_until(
                lambda: stamp_ns not in self._still_open(), _ANSWER_TIMEOUT_S
            )
        else:
            answered = self.pipeline.spin_until(
                lambda: len(self._still_open()) <= _UNPAIRED_LIMIT, _UNPAIRED_TIMEOUT_S
            )
        if not answered:
            self._open.discard(stamp_ns)
            self.sent.unanswered.append(stamp_ns)
        self.count()

    def _still_open(self) -> set[int]:
        self._open -= self._listener.heard.samples.keys()
        # A drop does not say of which frame: the oldest open one is the likeliest, or where none
        # is, one that is waited for no more.
        drops = self._dropped()
        for _ in range(drops - self._drops):
            if self._open:
                self._open.remove(min(self._open))
            elif self.sent.unanswered:
                self.sent.unanswered.pop(0)
        self._drops = drops
        return self._open


def play_at_full_rate(messages: Iterable[BagMessage], player: Player, feed: Feed) -> Sent:
    """Send each image when something has come of the one before; of one whose stamp is far ahead
    nothing does before the next."""
    newest = -1
    for message, whole in companions_first(messages, player.masked):
        player.send(message)
        if message.topic not in IMAGES:
            feed.pipeline.executor.spin_once(timeout_sec=0)
            continue
        stamp = header_stamp_ns(message.cdr)
        feed.wait(stamp, whole and (newest < 0 or newest < stamp <= newest + FAR_AHEAD_NS))
        newest = max(newest, stamp)
    return feed.done()


def play_in_time(messages: Iterable[BagMessage], player: Player, feed: Feed, rate: float) -> Sent:
    """Send each message when it is due, ready or not."""
    begun, first = time.monotonic(), None
    for message in messages:
        first = message.time_ns if first is None else first
        due = begun + (message.time_ns - first) * 1e-9 / rate
        while (left := due - time.monotonic()) > 0:
            player.tell_time(message.time_ns - int(left * rate * 1e9))
            feed.pipeline.spin_until(lambda: False, min(left, _TICK_S))
        player.send(message)
        if message.topic in IMAGES:
            feed.count()
    return feed.done()


def run_turntable(turntable: VirtualTurntableNode, feed: Feed) -> Sent:
    """Let the virtual turntable show its views one after the other."""
    topics = ("image", "camera_info", "camera_pose")
    _wait_for_nodes(feed.pipeline, lambda: min(map(turntable.count_subscribers, topics)) >= 2)
    start = turntable.get_clock().now().nanoseconds
    for index in range(len(turntable.cameras)):
        stamp = start + index * 100_000_000
        turntable.publish_frame(index, stamp)
        feed.wait(stamp, whole=True)
    return feed.done()


def _wait_for_nodes(pipeline: Pipeline, heard: Callable[[], bool]) -> None:
    if not pipeline.spin_until(heard, _START_TIMEOUT_S):
        raise RuntimeError("the nodes did not come up")


def companions_first(
    messages: Iterable[BagMessage], masks: bool
) -> Iterator[tuple[BagMessage, bool]]:
    """The messages, each image held back until pose, info and mask of its stamp are out.

    It is held back until a later image has its companions, and behind no more than 8 images:
    some may have none.

    Yields:
        Each message, and whether it is an image of which all companions are out.
    """
    needed = {"/camera_info", "/camera_pose"} | ({"/mask"} if masks else set())
    seen: dict[int, set[str]] = {}
    held: deque[tuple[BagMessage, int]] = deque()

    def whole(stamp: int) -> bool:
        return needed <= seen.get(stamp, set())

    for message in messages:
        stamp = header_stamp_ns(message.cdr)
        if message.topic in IMAGES:
            held.append((message, stamp))
        else:
            seen.setdefault(stamp, set()).add(message.topic.removesuffix("/compressed"))
            yield message, False
        while len(held) > _MOST_HELD or any(whole(stamp) for _, stamp in held):
            image, stamp = held.popleft()
            yield image, whole(stamp)
        if len(seen) > _STAMPS_KEPT:
            del seen[next(iter(seen))]
    for image, stamp in held:
        yield image, whole(stamp)
