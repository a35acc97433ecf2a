"""A recorded sequence through the real topics."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message

from .bags import Bag, BagMessage, open_bag
from .drive import IMAGES, Player, Progress, play_at_full_rate, play_in_time
from .errors import UserError
from .given import Values, override, parse_remaps, parse_settings, ros_arguments
from .listener import Listener
from .pipeline import NODES, pipeline, prepare_environment, private_domain
from .report import Report
from .results import results_folder
from .session import VIEWS, finish, lossless, write_results
from .topics import choose_topics


def replay(
    path: Path,
    out: Path,
    rate: str,
    clock: bool,
    remaps: Sequence[str],
    params: Path | None,
    assignments: Sequence[str],
    overwrite: bool,
    log_level: str,
    progress: Progress,
) -> Report:
    """Play a bag through the nodes and write the results.

    Args:
        path: the bag.
        out: folder for the results.
        rate: "max", or how many times as fast as it was recorded.
        clock: the nodes live by the time of the bag, which is published on /clock.
        remaps: FROM:=TO, topics of the bag to be renamed.
        params: YAML file of parameters, or None.
        assignments: NODE.PARAM=VALUE.
        overwrite: replace results that are there.
        log_level: what the nodes log.
        progress: told the images so far, and all of them.

    Raises:
        UserError: bad arguments, a bag that cannot be used, or one that gives no surface.
    """
    started = time.monotonic()
    speed = _speed(rate)
    values = parse_settings(assignments)
    arguments = ros_arguments(params, log_level)
    bag = open_bag(path)
    topics = choose_topics(bag, parse_remaps(remaps))
    if bag.lost:
        print(f"warning: {path}: {bag.lost}", file=sys.stderr)
    if params is None and "object_frame" not in values.get("contour_tracker", {}):
        _take_object_frame(values, bag, topics)
    images = sum(bag.counts[source] for source, topic in topics.items() if topic in IMAGES)
    kept = {images * k // VIEWS for k in range(VIEWS)}
    for node in ("contour_tracker", "mesher"):
        lossless(values, node, "subscription", *topics.values())
    if clock:
        for node in NODES:
            override(values, node, use_sim_time=True)
    prepare_environment(local=True)
    with results_folder(out, "replay", overwrite) as folder:
        override(values, "mesher", output_path=str(folder / "mesh.ply"), overwrite=True)
        with pipeline(arguments, values, private_domain()) as nodes:
            listener = nodes.add(
                Listener(lambda n: n in kept, keep_contours=True, context=nodes.context)
            )
            player = Player(nodes, listener, topics.values(), clock)
            messages = _renamed(bag.messages(topics), topics)
            if speed is None:
                sent = play_at_full_rate(messages, nodes, listener, player, progress, images)
            else:
                sent = play_in_time(messages, nodes, listener, player, progress, images, speed)
            finish(nodes, listener)
            source = {
                "name": path.name,
                "topics": topics,
                "messages": dict(bag.counts),
                "lost": bag.lost,
                "rate": rate,
            }
            return write_results(folder, "replay", source, nodes, listener, sent, {}, started)


def _speed(rate: str) -> float | None:
    """None for "max"."""
    if rate == "max":
        return None
    try:
        speed = float(rate)
    except ValueError:
        speed = 0.0
    if not 0 < speed < 1e6:
        raise UserError(f"--rate {rate}: must be a number above 0, or max")
    return speed


def _take_object_frame(values: Values, bag: Bag, topics: Mapping[str, str]) -> None:
    """The object frame is the one that the poses of the bag are in."""
    source = next(source for source, topic in topics.items() if topic == "/camera_pose")
    message = next(iter(bag.messages([source])), None)
    if message is None:
        return
    frame = deserialize_message(message.cdr, PoseStamped).header.frame_id
    for node in NODES:
        if frame:
            override(values, node, object_frame=frame)


def _renamed(messages: Iterable[BagMessage], topics: Mapping[str, str]) -> Iterator[BagMessage]:
    return (message._replace(topic=topics[message.topic]) for message in messages)
