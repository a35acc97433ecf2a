"""The three nodes, composed in this process on their real topics."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import TimeoutException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from occ_recon_ros.errors import SettingsError, UserError
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.executor import NodeExecutor
from occ_recon_ros.nodes.main import use_large_image_profile
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.streams.domains import claim_domain

from .arguments import Values

Kinds = Mapping[str, Callable[..., Any]]
NODES: Kinds = {
    "contour_tracker": ContourTrackerNode,
    "reconstructor": ReconstructorNode,
    "mesher": MesherNode,
}
_SERVICE_TIMEOUT_S = 120.0
_QUIET_S = 0.15
_IDLE_S = 0.05  # waited at once
_SHOWN = ("contours", "rim", "strip", "mesh")
_VIEWER_TIMEOUT_S = 10.0


def prepare_environment(local: bool) -> None:
    """What the middleware reads from the environment, where the user has not set it.

    Args:
        local: keep discovery on this host.
    """
    use_large_image_profile()
    if local:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if not (os.environ.get("HOME") or os.environ.get("ROS_HOME")):
        os.environ.setdefault("ROS_LOG_DIR", tempfile.gettempdir())


def private_domain() -> int | None:
    """A ROS domain for a run that nobody has asked to be seen by others, as ROS_DOMAIN_ID does.

    A recording must not be taken for a camera by a scan that is live on this host, nor one
    recording for another that is replayed beside it.
    """
    return None if os.environ.get("ROS_DOMAIN_ID") else _claimed()


_claimed = cache(claim_domain)


class Pipeline:
    """Nodes in one executor that is turned by hand, so that nothing runs beside it.

    Attributes:
        context: to make further nodes in; hand them to ``add``.
        nodes: the three nodes, and those asked for beside them, by name.
    """

    def __init__(self, context: Context, values: Values, further: Kinds) -> None:
        self.context = context
        self.executor = NodeExecutor(context=context)
        self.nodes: dict[str, Any] = {}
        self._added: list[Node] = []
        try:
            for name, kind in {**NODES, **further}.items():
                overrides = [Parameter(k, value=v) for k, v in values.get(name, {}).items()]
                self.nodes[name] = self.add(kind(context=context, parameter_overrides=overrides))
        except (SettingsError, rclpy.exceptions.InvalidParameterValueException) as error:
            self.close()
            raise UserError(f"{name}: {error}") from None

    def add(self, node: Any) -> Any:
        """Let another node take part."""
        self.executor.add_node(node)
        self._added.append(node)
        return node

    def spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Work until the condition holds; False when it does not in time.

        Time counts while there is nothing to do: a callback may take as long as it needs.
        """
        left = timeout_s
        while not condition():
            if left <= 0:
                return False
            begun = time.monotonic()
            self.executor.spin_once(timeout_sec=min(left, _IDLE_S))
            left -= min(time.monotonic() - begun, _IDLE_S)
        return True

    def wait_for_viewer(self) -> None:
        """Work until a viewer that is there hears all that it shows."""
        mesher = self.nodes["mesher"]

        def heard(topic: str) -> bool:
            ends = mesher.get_subscriptions_info_by_topic(mesher.resolve_topic_name(topic))
            return any(end.node_name == "viewer" for end in ends)

        self.spin_until(lambda: all(map(heard, _SHOWN)), _VIEWER_TIMEOUT_S)

    def settle(self) -> None:
        """Work until nothing has come for a while: all that was sent has been used."""
        while True:
            try:
                handler, _, _ = self.executor.wait_for_ready_callbacks(timeout_sec=_QUIET_S)
            except TimeoutException:
                return
            handler()
            handler.result()

    def call(self, node: Node, kind: type, service: str) -> Any:
        """Call a service of one of the nodes, over the wire.

        Raises:
            RuntimeError: no answer.
        """
        client = node.create_client(kind, service)
        try:
            self.spin_until(client.service_is_ready, _SERVICE_TIMEOUT_S)
            answer = client.call_async(kind.Request())  # type: ignore[attr-defined]
            if not self.spin_until(answer.done, _SERVICE_TIMEOUT_S):
                raise RuntimeError(f"no answer from {service}")
            return answer.result()
        finally:
            node.destroy_client(client)

    def close(self) -> None:
        """End all nodes."""
        self.executor.shutdown()
        for node in self._added:
            node.destroy_node()


@contextmanager
def pipeline(
    arguments: list[str],
    values: Values,
    domain_id: int | None = None,
    further: Kinds | None = None,
) -> Iterator[Pipeline]:
    """The nodes in a context of their own, which no signal ends.

    Args:
        arguments: --ros-args ...
        values: parameters that outdo those of the arguments.
        domain_id: None for that of the environment.
        further: nodes beside the three, by name.

    Raises:
        UserError: arguments or parameters that cannot be used.
    """
    context = Context()
    try:
        try:
            rclpy.init(
                args=arguments,
                context=context,
                domain_id=domain_id,
                signal_handler_options=SignalHandlerOptions.NO,
            )
        except RuntimeError as error:  # a parameter file that rcl cannot parse
            raise UserError(f"parameters cannot be read: {error}") from None
        nodes = Pipeline(context, values, further or {})
        try:
            yield nodes
        finally:
            nodes.close()
    finally:
        context.try_shutdown()
