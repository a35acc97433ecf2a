"""Nothing that goes wrong in a callback ends a node or its scan: it is counted and named."""

import errno

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rig import SECOND, SMALL, scan, send_until_seen, views
from std_srvs.srv import Trigger

from msg_adapters import Level, decode_stamp
from occ_recon_ros.nodes.guarding import GuardedNode

FAILURES = [
    (ValueError("no good"), "bad_", "no good"),
    (KeyError("x"), "internal_error", "KeyError('x')"),
    (MemoryError(), "out_of_memory", "out of memory"),
    (OSError(errno.ENOSPC, "No space left on device", "/scan"), "disk_full", "/scan"),
    (FileNotFoundError(errno.ENOENT, "No such file", "/gone"), "os_error", "/gone"),
]


class Failing(GuardedNode):
    """Each of its callbacks raises."""

    def __init__(self, error, **kwargs):
        super().__init__("failing", **kwargs)
        self.error, self.calls = error, 0
        self.create_service(Trigger, "~/now", self.fail)
        self.create_service(Trigger, "~/later", self.fail_later)
        self.timer = self.create_timer(0.001, self.fail)
        self.condition = self.create_guard_condition(self.fail)
        self.create_subscription(Trigger.Request, "empty", self.fail, 1)
        self.publisher = self.create_publisher(Trigger.Request, "empty", 1)

    def fail(self, *args):
        self.calls += 1
        raise self.error

    async def fail_later(self, *args):
        self.fail()


@pytest.mark.parametrize(("error", "reason", "words"), FAILURES)
def test_every_kind_of_callback_is_guarded(ros, error, reason, words):
    node = ros.start(Failing, error)
    ros.spin_until(lambda: node.calls > 2, what="the timer, more than once")
    node.timer.cancel()
    node.calls = 0
    node.condition.trigger()
    ros.spin_until(lambda: node.calls == 1, what="the guard condition")
    ros.spin_until(lambda: node.publisher.get_subscription_count())
    node.publisher.publish(Trigger.Request())
    ros.spin_until(lambda: node.calls == 2, what="the subscription")
    for name in ("now", "later"):
        answer = ros.call(node.create_client(Trigger, f"~/{name}"), Trigger.Request())
        assert not answer.success
        assert words in answer.message
    assert sum(node.drops.values()) > 6
    assert all(name.startswith(reason) for name in node.drops)


@pytest.mark.parametrize(
    ("node", "error"),
    [
        ("tracker", MemoryError()),
        ("reconstructor", RuntimeError("bad luck")),
        ("reconstructor", OSError(5, "I/O")),
        ("mesher", MemoryError()),
        ("mesher", OSError(5, "I/O")),
    ],
)
def test_a_frame_that_cannot_be_worked_on_is_lost_and_not_the_scan(graph, monkeypatch, node, error):
    """The step of each node fails for one frame in the middle of the turn."""
    victims = {
        "tracker": (graph.tracker._tracker, "process"),
        "reconstructor": (graph.reconstructor._reconstructor, "_rim"),
        "mesher": (graph.mesher._surface, "add"),
    }
    frames = views()
    scan(graph.ros, graph.rig, frames[:8], finish=False)
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == 6)
    triangles = len(graph.rig.triangles())

    def fail(*args):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(*victims[node], fail)
        graph.rig.send(frames[8], 100 * SECOND + 8 * SECOND // 10)
        graph.ros.spin_until(lambda: getattr(graph, node).drops, what="the drop")
    for k in range(9, len(frames)):
        send_until_seen(graph.ros, graph.rig, frames[k], 100 * SECOND + k * SECOND // 10)
    answer = graph.ros.call(*graph.rig.trigger("reconstructor/finish"))
    assert answer.success, answer.message
    graph.ros.spin_until(
        lambda: len(graph.rig.stamps("strip")) == SMALL.frames - 1, what="a strip of every frame"
    )
    reason = {RuntimeError: "internal_error", MemoryError: "out_of_memory", OSError: "os_error"}
    reason = reason[type(error)]
    assert getattr(graph, node).drops[reason] == 1
    strips = {decode_stamp(m.header.stamp): m.height for m in graph.rig.got["strip"]}
    assert len(strips) == SMALL.frames - 1
    # The turn is closed around the frame that is gone: all but the first strip have triangles,
    # but for a rim that nobody could be joined to.
    assert sum(not height for height in strips.values()) <= (2 if node == "mesher" else 1)
    assert len(graph.rig.triangles()) > triangles * 2
    assert graph.report(getattr(graph, node)).values[f"dropped {reason}"] == "1"


def test_memory_that_does_not_suffice_to_publish_the_mesh_costs_no_strip(graph, monkeypatch):
    def fail(*args):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(graph.mesher, "_whole", fail)
        scan(graph.ros, graph.rig, views())
        graph.ros.spin_until(lambda: graph.mesher.drops["out_of_memory"])
        report = graph.report(graph.mesher, lambda r: "dropped out_of_memory" in r.values)
    assert report.level in (Level.OK, Level.ERROR)
    assert len(graph.rig.triangles()) == len(graph.mesher._surface)


def test_a_parameter_service_that_fails_ends_nothing(graph, monkeypatch):
    def fail(*args):
        raise RuntimeError("no")

    monkeypatch.setattr(graph.mesher, "counts_later", fail)
    client = graph.rig.create_client(SetParameters, "mesher/set_parameters")
    parameter = Parameter("mesh_rate", value=2.0).to_parameter_msg()
    graph.ros.call(client, SetParameters.Request(parameters=[parameter]))
    assert graph.mesher.drops == {"internal_error": 1}
    assert graph.mesher.settings.mesh_rate == 2.0
    scan(graph.ros, graph.rig, views()[:4], finish=False)
