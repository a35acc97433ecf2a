"""Signals: run ends well, a demo ends early; nothing is left behind."""

import signal
import subprocess

import pytest

from occ_recon_ros.poses import BoardSpec, board_to_yaml

NODES = {"contour_tracker", "reconstructor", "mesher"}
PROGRAM = "import sys; from occ_recon_ros.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_nodes_are_seen_by_others_and_end_on_a_signal(ros, tmp_path, number):
    from rclpy.node import Node

    params = tmp_path / "rig.yaml"
    params.write_text("/**/mesher:\n  ros__parameters:\n    mesh_rate: 2.0\n")
    arguments = ("run", "--params", params, "--set=mesher.marker_triangles=9")
    if number == signal.SIGINT:
        child = ros.program("-c", PROGRAM, *arguments, stderr=subprocess.PIPE)
    else:
        child = ros.command(*arguments)
    try:
        watcher = ros.start(Node, "watcher")
        ros.spin_until(lambda: set(watcher.get_node_names()) >= NODES, what="the nodes")
        ros.spin_until(lambda: watcher.count_subscribers("/image") == 1, what="a subscription")
        assert child.stdout is not None
        assert "are running" in child.stdout.readline()
        child.send_signal(number)
        _, err = child.communicate(timeout=120)
    finally:
        child.kill()
    assert child.returncode == 0, err
    assert "Traceback" not in err


def test_a_bad_parameter_is_one_line(ros):
    child = ros.command("run", "--set", "mesher.mesh_rate=0")
    _, err = child.communicate(timeout=120)
    assert child.returncode == 2
    assert err.count("\n") == 1
    assert "mesh_rate" in err


def test_a_demo_that_is_stopped_leaves_nothing(ros, tmp_path):
    from rclpy.node import Node

    child = ros.command("demo", "--frames", "3600", "--out", tmp_path / "out")
    try:
        watcher = ros.start(Node, "watcher")
        ros.spin_until(lambda: watcher.count_publishers("/image") == 1, what="the turntable")
        assert len(list(tmp_path.iterdir())) == 1
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=120)
    finally:
        child.kill()
    assert child.returncode == 1
    assert err == "error: interrupted\n"
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_asks_for_no_domain_has_one_of_its_own(monkeypatch):
    from occ_recon_ros.cli.pipeline import private_domain

    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert private_domain() is None
    monkeypatch.delenv("ROS_DOMAIN_ID")
    domain = private_domain()
    assert domain is not None
    assert 1 <= domain <= 101


def test_poses_come_from_a_board_in_the_same_process(ros, tmp_path):
    from rclpy.node import Node

    board = tmp_path / "sheet.yaml"
    board.write_text(board_to_yaml(BoardSpec()))
    child = ros.command("run", "--pose", "board", "--set", f"board_pose.board={board}")
    try:
        watcher = ros.start(Node, "watcher")
        ros.spin_until(
            lambda: set(watcher.get_node_names()) >= NODES | {"board_pose"},
            timeout=180,
            what="the nodes",
        )
        ros.spin_until(lambda: watcher.count_publishers("/camera_pose") == 1, what="its poses")
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=120)
    finally:
        child.kill()
    assert child.returncode == 0, err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--pose", "board", "--set", "board_pose.board=none.yaml"), "occ-recon board"),
        (("--pose", "turntable", "--set", "turntable_pose.axis=none.yaml"), "calibrate axis"),
        (("--pose", "tf"), "tf2_msgs"),
        (("--pose", "moon"), "must be one of"),
    ],
)
def test_a_source_of_poses_that_cannot_be_is_one_line(ros, arguments, words):
    child = ros.command("run", *arguments)
    _, err = child.communicate(timeout=120)
    assert child.returncode == 2
    assert words in err
    assert err.count("\n") == 1
