"""Faults injected for real while a scan goes on: for each, what is lost."""

import os
import resource
import shutil
import signal
from contextlib import contextmanager

import pytest
import trimesh
from rclpy.parameter import Parameter
from rig import SECOND, Rig, scan, views
from test_scan_end import Watched

from occ_recon_ros.nodes import scan_keeper
from occ_recon_ros.streams import scan_files

FRAMES = 10


@pytest.fixture
def run(make_graph, tmp_path):
    return Watched(make_graph, tmp_path / "scans", finish_when_closed=False, close_body=False)


@contextmanager
def full_disk(room=1000):
    """No file may grow any more: RLIMIT_FSIZE fails as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def saved(tmp_path):
    """The meshes on disk, by the names of their scans."""
    return {p.parent.name: len(trimesh.load_mesh(p).faces) for p in tmp_path.glob("scans/*/mesh.*")}


def scanned(run, start_s=100):
    """Part of a turn; how many triangles it gave."""
    scan(run.ros, run.rig, views()[:FRAMES], start_s=start_s, finish=False)
    last = start_s * SECOND + (FRAMES - 2) * SECOND // 10
    run.ros.spin_until(lambda: last in run.rig.stamps("strip"), what="the last strip")
    return len(run.graph.mesher._surface)


def test_a_disk_that_is_full_at_the_end_of_a_scan_loses_nothing(run, tmp_path):
    scanned(run)
    with full_disk():
        answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
        assert not answer.success
        assert "File too large" in answer.message or "No space" in answer.message
        assert "mesh.ply" in answer.message
        assert run.until("failed")["reason"] == answer.message
    assert not saved(tmp_path)
    assert not list(tmp_path.rglob("*.part"))
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert answer.success, answer.message
    assert list(saved(tmp_path).values()) == [len(run.graph.mesher._surface)]
    assert run.graph.mesher.drops["disk_full"] >= 1


def test_a_scan_that_is_cleared_while_the_disk_is_full_is_written_later(run, tmp_path, monkeypatch):
    monkeypatch.setattr(scan_keeper, "_RETRY_S", 0.1)
    triangles = scanned(run)
    with full_disk():
        assert run.ros.call(*run.rig.trigger("mesher/reset")).success
        run.ros.spin_until(lambda: run.graph.mesher.drops["disk_full"] > 1, what="two tries")
        assert not saved(tmp_path)
    run.ros.spin_until(lambda: saved(tmp_path), what="the mesh on disk")
    assert list(saved(tmp_path).values()) == [triangles]


def test_what_never_found_room_is_named_at_the_end(run, tmp_path, capsys):
    run.graph.mesher.set_parameters([Parameter("save_on_shutdown", value=True)])
    scanned(run)
    scan_id = run.states[-1]["id"]
    with full_disk():
        assert run.ros.call(*run.rig.trigger("mesher/reset")).success
        run.ros.end(run.graph.mesher)
    assert not saved(tmp_path)
    path = tmp_path / "scans" / scan_id / "mesh.ply"
    assert f"mesher: error: File too large ({path})" in capsys.readouterr().err


def test_an_output_folder_that_vanishes_is_made_again(run, tmp_path):
    scanned(run)
    assert run.ros.call(*run.rig.trigger("mesher/save")).success
    shutil.rmtree(tmp_path / "scans")
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert answer.success, answer.message
    assert list(saved(tmp_path).values()) == [len(run.graph.mesher._surface)]


def test_memory_that_does_not_suffice_for_the_file_loses_nothing(run, tmp_path, monkeypatch):
    def fail(*args):
        raise MemoryError

    scanned(run)
    with monkeypatch.context() as patch:
        patch.setattr(scan_files, "exported", fail)
        answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
        assert not answer.success
        assert "out of memory" in answer.message
    assert run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180).success
    assert saved(tmp_path)


def test_a_body_process_that_is_killed_costs_the_body_and_not_the_mesh(make_graph, tmp_path):
    run = Watched(make_graph, tmp_path / "scans", finish_when_closed=False)
    scanned(run)
    os.kill(run.graph.mesher.keeper._body.pid, signal.SIGKILL)
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert answer.success, answer.message
    assert "no closed body: the process that closes the body has ended" in answer.message
    assert list(saved(tmp_path).values()) == [len(run.graph.mesher._surface)]


@pytest.mark.parametrize("faster", [1, 4])
def test_a_second_camera_is_told_from_a_clock_set_back(run, tmp_path, faster):
    """Its frames, an hour behind, are dropped by name; the scan is that of the first."""
    second = run.ros.start(Rig)
    run.ros.spin_until(second.ready, what="the second camera")
    for k, view in enumerate(views()[:FRAMES]):
        run.rig.send(view, 5000 * SECOND + k * SECOND // 10)
        run.ros.spin_until(
            lambda k=k: 5000 * SECOND + k * SECOND // 10 in run.rig.stamps("contours")
        )
        for n in range(faster):
            second.send(view, 1400 * SECOND + (faster * k + n) * SECOND // 50)
            run.graph.settle(4)
    tracker, mesher = run.graph.tracker, run.graph.mesher
    run.ros.spin_until(lambda: tracker.drops["second_publisher"] > FRAMES // 2)
    assert min(run.rig.stamps("contours")) >= 5000 * SECOND
    assert run.states[-1]["state"] == "scanning"
    run.ros.spin_until(lambda: len(mesher._surface._placed) == FRAMES - 2)
    assert not saved(tmp_path)
