"""The graph that most tests of nodes use."""

import contextlib
import sys
import types

import pytest
from forked import Beside
from geometry_msgs.msg import TransformStamped
from rclpy.executors import TimeoutException
from rig import EACH_ALONE, STRIPS_ONLY, ByTransforms, Rig

from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.streams import body_process, learning


class Graph:
    """The three nodes and a rig, in one process."""

    def __init__(self, ros, params=None, **kwargs):
        params = params or {}
        self.ros = ros
        tracker = EACH_ALONE | params.get("tracker", {})
        self.tracker = ros.start(ContourTrackerNode, params=tracker, **kwargs)
        self.reconstructor = ros.start(
            ReconstructorNode, params=params.get("reconstructor"), **kwargs
        )
        mesher = STRIPS_ONLY | params.get("mesher", {})
        self.mesher = ros.start(MesherNode, params=mesher, **kwargs)
        self.rig = ros.start(Rig, **kwargs)
        if self.tracker.settings.pose_source == "tf":
            self.rig.pose = ByTransforms(self.tracker)
        ros.spin_until(self.rig.ready, what="the graph")

    def report(self, node, fits=lambda report: True):
        """The next report of a node that fits."""
        name = node.get_fully_qualified_name()
        self.rig.reports.pop(name, None)
        self.ros.spin_until(
            lambda: name in self.rig.reports and fits(self.rig.reports[name]),
            what=f"a report of {name}",
        )
        return self.rig.reports[name]

    def settle(self, cycles=30, wait=0.005):
        """Let everything run that can run now: so many callbacks, or until none is ready for as
        long as so many looks in vain would take; one long look costs as much as a short one."""
        self.work(cycles, cycles * wait)

    def work(self, most, wait=0.0):
        """Do what is ready, no more than so many callbacks, until for so long there is nothing:
        a look in vain takes as long as a callback."""
        with contextlib.suppress(TimeoutException):
            for _ in range(most):
                handler, _, _ = self.ros.executor.wait_for_ready_callbacks(timeout_sec=wait)
                handler()
                handler.result()


@pytest.fixture(autouse=True)
def _files_go_to_the_test(tmp_path, monkeypatch):
    """Whatever a node writes by its defaults."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(autouse=True)
def _long_work_is_forked(request, monkeypatch):
    """What nodes in the test's own process begin beside them; those that are programs of their
    own, and those of a test that asks for it, begin it from nothing."""
    if "begun_from_nothing" not in request.fixturenames:
        for user in (body_process, learning):
            monkeypatch.setattr(user, "begin", Beside)


@pytest.fixture
def begun_from_nothing():
    """Long work is begun as users' nodes begin it."""


@pytest.fixture
def make_graph(ros):
    return lambda params=None, **kwargs: Graph(ros, params, **kwargs)


@pytest.fixture
def graph(ros):
    return Graph(ros)


@pytest.fixture
def transforms(monkeypatch):
    """Something like tf2_msgs, which pip has no wheels of."""
    module = types.ModuleType("tf2_msgs.msg")
    module.TFMessage = TransformStamped  # a type that can be subscribed to
    monkeypatch.setitem(sys.modules, "tf2_msgs", types.ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", module)
