"""The quality of service of each kind of topic."""

import importlib

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.streams.topics import Topic

_ONCE = ReliabilityPolicy.BEST_EFFORT


def sensor() -> QoSProfile:
    """Images: the newest few, none sent twice."""
    return QoSProfile(depth=5, reliability=_ONCE)


def reliable(depth: int) -> QoSProfile:
    """Every message, as long as no more than ``depth`` wait."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """The newest message, also for who comes late."""
    return kept(1)


def kept(depth: int) -> QoSProfile:
    """Every message, also those that were sent before."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def tf_type() -> type:
    """tf2_msgs/TFMessage, which pip has no wheels of.

    Raises:
        SettingsError: it is not installed.
    """
    try:
        module = importlib.import_module("tf2_msgs.msg")
    except ImportError:
        raise SettingsError(
            "poses from /tf need tf2_msgs, which is not installed (pip has none): use a ROS 2 "
            "installation, or 'occ-recon replay' on a recording of /tf"
        ) from None
    found: type = module.TFMessage
    return found


def promised(topic: Topic, depth: int = 0) -> QoSProfile:
    """What the table says of a topic; a reader may want to keep more messages waiting."""
    if topic.latched and topic.depth == 1:
        return latched()
    depth = max(depth, topic.depth)
    if topic.latched:
        return kept(depth)
    return reliable(depth) if topic.reliable else QoSProfile(depth=depth, reliability=_ONCE)


def publishers(node: Node, topic: str) -> str:
    """Who publishes on a topic, in words."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    names = sorted({f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in infos})
    # A publisher is known a moment before the name of its node.
    return ", ".join("unknown" if "_UNKNOWN_" in name else name for name in names) or "none"


def compressed_topic(node: Node, base: str) -> str:
    """Name of the compressed form of an image topic: it follows the remapping of ``base``
    unless it is remapped itself."""
    name = f"{base}/compressed"
    if node.resolve_topic_name(name) != node.resolve_topic_name(name, only_expand=True):
        return name
    return f"{node.resolve_topic_name(base)}/compressed"
