"""run: all nodes live in one process, until told to end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

NODES = {"contour_tracker", "reconstructor", "mesher"}
PROGRAM = "import sys; from occ_recon_ros.cli import main; sys.exit(main(sys.argv[1:]))"


def start(domain_id: int, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "run", *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain_id)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_nodes_are_seen_by_others_and_end_on_a_signal(ros, tmp_path, number):
    from rclpy.node import Node

    params = tmp_path / "rig.yaml"
    params.write_text("/**/mesher:\n  ros__parameters:\n    mesh_rate: 2.0\n")
    child = start(ros.domain_id, "--params", str(params), "--set", "mesher.marker_triangles=9")
    try:
        watcher = ros.start(Node, "watcher")
        ros.spin_until(lambda: set(watcher.get_node_names()) >= NODES, what="the nodes")
        ros.spin_until(lambda: watcher.count_subscribers("/image") == 1, what="a subscription")
        child.send_signal(number)
        out, err = child.communicate(timeout=20)
    finally:
        child.kill()
    assert child.returncode == 0, err
    assert "are running" in out
    assert "Traceback" not in err


def test_a_bad_parameter_is_one_line(ros):
    child = start(ros.domain_id, "--set", "mesher.mesh_rate=0")
    _, err = child.communicate(timeout=30)
    assert child.returncode == 2
    assert err.count("\n") == 1
    assert "mesh_rate" in err
