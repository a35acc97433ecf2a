"""The executor of the nodes: events of the middleware are told of, but not asked for each time."""

from rclpy.event_handler import EventHandler, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Empty

RELIABLE = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_policies_that_do_not_fit_are_told_of_while_messages_keep_coming(ros):
    node, told, heard = ros.start(Node, "both"), [], []
    callbacks = SubscriptionEventCallbacks(incompatible_qos=told.append)
    node.create_subscription(Empty, "busy", heard.append, BEST_EFFORT)
    node.create_subscription(Empty, "strict", heard.append, RELIABLE, event_callbacks=callbacks)
    busy = node.create_publisher(Empty, "busy", BEST_EFFORT)
    node.create_publisher(Empty, "strict", BEST_EFFORT)

    def go_on():
        busy.publish(Empty())
        return told and len(heard) > 20

    ros.spin_until(go_on, what="both")


def test_a_round_seldom_asks_for_events(ros, monkeypatch):
    node, asked = ros.start(Node, "idle"), []
    node.create_publisher(Empty, "busy", BEST_EFFORT)
    ask = EventHandler.add_to_wait_set
    monkeypatch.setattr(
        EventHandler,
        "add_to_wait_set",
        lambda self, waited: (asked.append(self), ask(self, waited))[1],
    )
    ros.executor._looked = float("inf")  # as if all had just been asked for
    for _ in range(50):
        ros.executor.spin_once(timeout_sec=0)
    assert not asked
    ros.executor._looked = 0.0
    ros.executor.spin_once(timeout_sec=0)
    assert len(asked) == sum(len(list(n.waitables)) for n in ros.executor.get_nodes()) > 0
