"""What the rig publishes -> rosbag2."""

import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from msg_adapters import message_type
from occ_recon_ros.bags.views import Progress
from occ_recon_ros.bags.writer import BagWriter, choose_storage, growing_bag
from occ_recon_ros.errors import UserError
from occ_recon_ros.nodes.qos import publishers
from occ_recon_ros.streams.loss import LossCount
from occ_recon_ros.streams.topics import IMAGES, TF, TYPE_NAMES

from .arguments import parse_remaps
from .pipeline import prepare_environment

_DEPTH = 200
_LOOK_S = 0.02  # how often publishers that came since are looked for
_FLUSH_S = 1.0  # what a killed recorder may lose
_SILENCE_S = 5.0
_NEEDED = ("/image", "/camera_info", "/camera_pose")


def record(
    path: Path,
    remaps: Sequence[str],
    storage: str | None,
    overwrite: bool,
    progress: Progress,
) -> Counter[str]:
    """``record``: images, masks, calibration and poses until SIGINT or SIGTERM; ``progress`` is
    told the number of images.

    Returns:
        Number of messages by topic of the bag.

    Raises:
        UserError: bad arguments, the bag cannot be written, or nothing came, or nothing of a topic
            that ``remaps`` names; the bag stays then.
    """
    storage = choose_storage(path, storage)
    rules = parse_remaps(remaps, TYPE_NAMES)
    sources = _sources(rules)
    prepare_environment(local=False)
    context = Context()
    context.init(args=[])  # rcl would take --remap for its own
    try:
        with growing_bag(path, storage, overwrite) as writer, _stop_signal() as stopped:
            recorder = Recorder(sources, writer, context=context)
            print(f"recording to {path}; Ctrl-C ends it", file=sys.stderr, flush=True)
            try:
                _spin(recorder, stopped, progress)
                if not recorder.counts:
                    raise UserError(f"nothing was recorded: {'; '.join(recorder.silent())}")
                missing = recorder.silent(rules.values())
                for sentence in recorder.silent():
                    _warn(sentence)
            finally:
                recorder.destroy_node()
    finally:
        context.try_shutdown()
    for topic, lost in recorder.lost.items():
        _warn(f"{lost} messages of {topic} were lost on the way")
    if missing:
        words = ", ".join(f"{topic} {n}" for topic, n in sorted(recorder.counts.items()))
        raise UserError(f"{path} holds {words}, but {'; '.join(missing)}: check --remap")
    return recorder.counts


def _sources(remaps: Mapping[str, str]) -> dict[str, str]:
    """{name on the rig: name in the bag}; the compressed form follows its image."""
    by_target = {target: source for source, target in remaps.items()}
    if len(by_target) < len(remaps):
        raise UserError("--remap: two topics cannot become one")
    raw, compressed = IMAGES
    if raw in by_target:
        by_target.setdefault(compressed, f"{by_target[raw]}/compressed")
    elif compressed in by_target:
        by_target[raw] = ""  # asked for the compressed form alone
    by_target = {topic: topic for topic in TYPE_NAMES} | by_target
    return {source: target for target, source in by_target.items() if source}


class Recorder(Node):
    """Writes each message as it comes, without decoding it.

    A topic is subscribed to when its publisher is there, with what that offers: nothing
    that is sent reliably or kept for late comers is lost for want of asking.

    Attributes:
        counts: messages written, by topic of the bag.
        lost: messages that never came, by topic, as the gaps in their numbers tell.
    """

    def __init__(self, sources: Mapping[str, str], writer: BagWriter, **kwargs: Any) -> None:
        super().__init__("occ_recon_recorder", **kwargs)
        self._sources = sources
        self._writer = writer
        self._loss = LossCount()
        self._heard: set[str] = set()
        self._refused: dict[str, str] = {}
        self.counts = writer.counts
        self.lost: Counter[str] = Counter()

    def look(self) -> None:
        """Subscribe to what is published by now."""
        for source, target in self._sources.items():
            compressed_too = target == IMAGES[1] and IMAGES[0] in self._heard
            if target in self._heard or compressed_too:
                continue
            infos = self.get_publishers_info_by_topic(source)
            types = {info.topic_type for info in infos}
            if types and types != {TYPE_NAMES[target]}:
                if target not in self._refused:
                    words = f"{source} is {', '.join(sorted(types))}, not {TYPE_NAMES[target]}"
                    self._refused[target] = words
                    _warn(f"{words}: it is not recorded")
            elif infos and target not in self._refused:
                self._subscribe(source, target, [info.qos_profile for info in infos])

    def _subscribe(self, source: str, target: str, offers: Sequence[QoSProfile]) -> None:
        reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
        kept = all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
        qos = QoSProfile(
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        )

        def write(cdr: bytes, info: dict) -> None:
            self._write(target, cdr, info)

        try:
            kind = message_type(TYPE_NAMES[target])
        except ImportError:
            package = TYPE_NAMES[target].split("/")[0]
            words = f"{source} needs {package}, which is not installed (pip has none)"
            self._refused[target] = words
            _warn(f"{words}: it is not recorded")
            return
        self.create_subscription(
            kind,
            source,
            write,  # type: ignore[arg-type]  # raw and two arguments: rclpy's annotation lacks them
            qos,
            raw=True,
        )
        self._heard.add(target)

    def _write(self, target: str, cdr: bytes, info: dict) -> None:
        self._writer.write(target, TYPE_NAMES[target], info["received_timestamp"], cdr)
        number = info.get("publication_sequence_number")
        missing = 0 if number is None else self._loss.take(target, number)[0]
        if missing:
            self.lost[target] += missing

    def images(self) -> int:
        """Number of images so far."""
        return sum(self.counts[topic] for topic in IMAGES)

    def silent(self, wanted: Iterable[str] = _NEEDED) -> list[str]:
        """A sentence for each topic of those wanted, by default that a scan needs, that does not
        come."""
        names = {target: source for source, target in self._sources.items()}
        sentences = []
        for topic in wanted:
            if self.counts[topic] or (topic in IMAGES and self.images()):
                continue
            if topic == "/camera_pose" and self.counts[TF[0]]:
                continue
            name = names.get(topic) or names[IMAGES[1]]
            nothing = f"nothing on {name} (publishers: {publishers(self, name)})"
            sentences.append(self._refused.get(topic, nothing))
        return sentences

    def flush(self) -> None:
        """Let what is written outlast the recorder."""
        self._writer.flush()


def _spin(recorder: Recorder, stopped: Callable[[], bool], progress: Progress) -> None:
    executor = SingleThreadedExecutor(context=recorder.context)
    executor.add_node(recorder)
    begun = flushed = looked = time.monotonic()
    told = False
    recorder.look()
    try:
        while not stopped():
            executor.spin_once(timeout_sec=_LOOK_S)
            now = time.monotonic()
            if now - looked >= _LOOK_S:
                recorder.look()
                looked = now
            if now - flushed >= _FLUSH_S:
                recorder.flush()
                progress(recorder.images(), 0)
                flushed = now
            if not told and now - begun >= _SILENCE_S:
                told = True
                for sentence in recorder.silent():
                    _warn(sentence)
        before = -1
        while before != recorder.counts.total():  # what has come but not been written
            before = recorder.counts.total()
            for _ in range(10):
                executor.spin_once(timeout_sec=0)
    finally:
        executor.shutdown()


def _warn(sentence: str) -> None:
    print(f"warning: {sentence}", file=sys.stderr, flush=True)


@contextmanager
def _stop_signal() -> Iterator[Callable[[], bool]]:
    """SIGINT and SIGTERM raise nothing, in the middle of a write perhaps, but are noted."""
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, frame: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
