"""Shared fixtures. ROS reads these variables when it is imported, so they come first."""

import os

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ.setdefault("HOME", "/tmp")
if "PYTEST_XDIST_WORKER" in os.environ:  # the workers share the cores
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

import gc
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("patient", settings(), deadline=None)  # on a busy machine too
settings.load_profile("patient")

# A shell lets what it starts in the background ignore Ctrl-C, and the programs of the tests too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

CHECKOUT = Path(__file__).resolve().parent.parent
# The folder test/msg_adapters must not be taken for the package of that name.
sys.path[:0] = [str(CHECKOUT), str(CHECKOUT / "test" / "support")]
sys.path.append(str(CHECKOUT / "benchmarks"))  # what they measure with and on, tests do as well
# As our executables do; Fast DDS reads it once a process.
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(CHECKOUT / "config" / "fastdds.xml")

from fixtures import bag, command, compile_loops, expected, folder, made_once, messages, replay  # noqa: E402
from forked import Forked  # noqa: E402
from plaster import coarse, few_heights, plaster, toy  # noqa: E402

from occ_recon_ros.streams import domains  # noqa: E402

__all__ = [
    "bag",
    "coarse",
    "command",
    "expected",
    "few_heights",
    "folder",
    "messages",
    "plaster",
    "replay",
    "toy",
]

# What a test starts without naming a domain meets nobody either, nor the fixture's graph.
os.environ["ROS_DOMAIN_ID"] = str(domains.claim_domain())
_FIXTURE_DOMAIN = domains.claim_domain()


_LONGEST = """
masks_that_came refinement turn_scan turn_steps scan scan_end watching replay hostile joint closed
joint_rules replay_dinosaur odd_ends refine viewer verdict evidence processes batch soak learnt
two_hosts crash sheet_layout segment turns joint_barrier record demo run without_ros board_pose
contours loss tracker_node import_colmap_nerf intrinsics agreement cut_views surfaces recorded
board_node
"""  # the files that take longest, by the time they take


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes long first, so that no worker is left with it at the end."""
    place = {f"test_{name}.py": k for k, name in enumerate(_LONGEST.split())}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def pytest_collection_finish() -> None:
    """No garbage is sought any more in the modules and tests themselves."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _loops_are_compiled_once(tmp_path_factory: pytest.TempPathFactory) -> None:
    """In a fresh checkout by one worker, not by each of them and all the programs they start."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        made_once(tmp_path_factory, "compiled", compile_loops)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real sequences beside the checkout; missing is an error only in CI."""
    folder = CHECKOUT.parent / "shared" / "data"
    if not folder.is_dir():
        message = f"the recorded sequences are not at {folder}"
        if os.environ.get("CI") == "true":
            raise FileNotFoundError(message)
        pytest.skip(message)
    return folder


class Ros:
    """A context with a domain of its own, one executor, and nodes that end with the test."""

    def __init__(self, domain_id: int) -> None:
        import rclpy
        from rclpy.context import Context

        from occ_recon_ros.nodes.executor import NodeExecutor

        self.domain_id = domain_id
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.executor = NodeExecutor(context=self.context)
        self._nodes: list = []
        self._children: list[Forked | subprocess.Popen] = []

    def start(self, kind, *args, params=None, **kwargs):
        """A node of a class, with parameters, in the executor."""
        from rclpy.parameter import Parameter

        if params is not None:
            kwargs["parameter_overrides"] = [Parameter(k, value=v) for k, v in params.items()]
        node = kind(*args, context=self.context, **kwargs)
        self.executor.add_node(node)
        self._nodes.append(node)
        return node

    def end(self, node) -> None:
        """End one node before the test does."""
        self._nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def process(self, node, *ros_args) -> Forked:
        """A node of ours as a process of its own, in the same domain, that ends with the test."""
        arguments = ["--ros-args", *map(str, ros_args)] if ros_args else []
        return self._fork(f"occ_recon_ros.nodes.{node}", arguments, one_pipe=True)

    def command(self, *arguments, one_pipe=False) -> Forked:
        """`occ-recon` likewise."""
        return self._fork("occ_recon_ros.cli", [*map(str, arguments)], one_pipe)

    def _fork(self, module, arguments, one_pipe):
        child = Forked(module, arguments, self._environment, one_pipe, self._claims)
        self._children.append(child)
        return child

    def program(self, *words, **kwargs) -> subprocess.Popen:
        """Python with arguments, likewise, but begun from nothing."""
        child = subprocess.Popen(
            [sys.executable, *map(str, words)],
            env=self._environment,
            pass_fds=self._claims,
            **{"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, **kwargs},
        )
        self._children.append(child)
        return child

    @property
    def _environment(self) -> dict[str, str]:
        return {**os.environ, "ROS_DOMAIN_ID": str(self.domain_id)}

    @property
    def _claims(self) -> list[int]:
        """The domain stays claimed as long as a program lives, even if the test is killed."""
        return [claim.fileno() for claim in domains._claims.values()]

    def spin_until(self, condition, timeout=180.0, what="the condition") -> None:
        """Spin until a condition holds; a test fails in words when it does not in time."""
        import time

        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                raise AssertionError(f"waited {timeout} s in vain for {what}")
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, client, request, timeout=180.0):
        """The answer of a service."""
        self.spin_until(client.service_is_ready, timeout, client.srv_name)
        future = client.call_async(request)
        self.spin_until(future.done, timeout, f"an answer of {client.srv_name}")
        return future.result()

    def close(self) -> None:
        """End all processes and nodes, then the context."""
        # Not killed at once: that would leave their shared memory behind.
        for child in self._children:
            child.terminate()
        for child in self._children:
            try:
                child.communicate(timeout=120)
            except subprocess.TimeoutExpired:
                child.kill()
                child.communicate()
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def ros():
    """A ROS graph of the test's own."""
    graph = Ros(_FIXTURE_DOMAIN)
    yield graph
    graph.close()
