"""What runs on either host of test_two_hosts: the camera on one, the three nodes on the other.

python two_hosts.py camera --ros-args ...
python two_hosts.py nodes RESULT.npz --ros-args ...
"""

import json
import os
import signal
import sys
import time
from importlib import import_module

import numpy as np
import rclpy
from rclpy.node import Node
from rig import Rig

from msg_adapters import decode_stamp
from occ_recon_ros.geometry.warming import warm_up
from occ_recon_ros.nodes.main import run_node
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode

NODES = ("contour_tracker", "reconstructor", "mesher")


class Camera(VirtualTurntableNode):
    """A virtual turntable that prints the stamp of each frame it has published."""

    def publish_frame(self, index, stamp_ns):
        super().publish_frame(index, stamp_ns)
        print(stamp_ns, flush=True)


class Watcher(Rig):
    """Collects what the nodes make; publishes nothing."""

    def __init__(self):
        Node.__init__(self, "watcher")
        self.collect()


def spin_until(node, condition, timeout=180.0):
    end = time.monotonic() + timeout
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    return condition()


def fork(module, arguments):
    """Run a node in a process of its own; the process."""
    if child := os.fork():
        return child
    sys.argv[1:] = arguments
    code = 1
    try:
        code = module.main() or 0
    finally:
        os._exit(code)


def nodes(result, arguments):
    """Run the three nodes; a line "[stamps]" on stdin says which frames they should get. When
    these have come, close the turn, and write what was made."""
    warm_up()
    children = [fork(import_module(f"occ_recon_ros.nodes.{name}"), arguments) for name in NODES]
    rclpy.init()
    rig = Watcher()
    try:
        joined = spin_until(rig, rig.joined)
        print("joined" if joined else "not joined", flush=True)
        line = sys.stdin.readline()
        if not line:
            return
        wanted = set(json.loads(line))
        # The rim before the last says that the last contours have come to the reconstructor.
        on_the_way = set(sorted(wanted)[1:-1])
        if not spin_until(rig, lambda: on_the_way <= rig.stamps("rim")):
            print(rig.reports, file=sys.stderr)
        client, request = rig.trigger("reconstructor/finish")
        client.wait_for_service()
        spin_until(rig, client.call_async(request).done)
        spin_until(rig, lambda: rig.stamps("contours") <= rig.stamps("strip"))
        stamps = {t: [decode_stamp(m.header.stamp) for m in rig.got[t]] for t in ("rim", "strip")}
        rig.reports.clear()
        spin_until(rig, lambda: len(rig.reports) >= 3)
        drops = {
            f"{report.name} {key}": value
            for report in rig.reports.values()
            for key, value in report.values.items()
            if key.startswith("dropped ")
        }
        print("drops", drops, flush=True)
        np.savez(result, triangles=rig.triangles(), **stamps)
        print("written", flush=True)
    finally:
        for child in children:
            os.kill(child, signal.SIGTERM)
        for child in children:
            os.waitpid(child, 0)


if __name__ == "__main__":
    if sys.argv[1] == "camera":
        sys.exit(run_node(Camera))
    nodes(sys.argv[2], sys.argv[3:])
