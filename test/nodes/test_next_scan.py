"""Another scan begins, or the node ends, before a scan is all saved; and a scan that goes on."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from forked import wait_until_ready
from rig import SECOND, SMALL, scan, views
from test_scan_end import Watched

from msg_adapters import Level
from occ_recon_ros.nodes import closed_body
from occ_recon_ros.scene import make_object

STEP = SECOND // 10
COARSE = replace(SMALL, frames=12, step=2 * np.pi / 12)


BOTH = {"mesh.ply", "closed.ply"}
KEPT = {"mesh.previous.ply", "closed.previous.ply"}


@pytest.fixture
def watched(make_graph, tmp_path):
    wait_until_ready()
    return lambda **mesher: Watched(
        make_graph, tmp_path / "scans", **{"closed_preview": 0.0, **mesher}
    )


def scanned(run, frames, start_s=100, first=0):
    """Part of a turn, until its strips have come."""
    scan(run.ros, run.rig, frames, start_s=start_s, finish=False, first=first)
    last = start_s * SECOND + (first + len(frames) - 2) * STEP
    run.ros.spin_until(lambda: last in run.rig.stamps("strip"), what="the last strip")


def halted(run, goes_on=False):
    """The process that closes bodies stands still, until it goes on."""
    pid = run.graph.mesher.keeper._body.pid
    os.kill(pid, signal.SIGCONT if goes_on else signal.SIGSTOP)


def closing(run):
    """~/finish, as far as the body that is being closed; what will be its answer."""
    halted(run)
    client, request = run.rig.trigger("mesher/finish")
    run.ros.spin_until(client.service_is_ready)
    answer = client.call_async(request)
    run.ros.spin_until(lambda: run.states[-1]["reason"] == "the body is closed")
    return answer


def files(folder):
    return {path.name for path in folder.iterdir()}


def is_of(path, name):
    """Whether a closed body is that of an object, as far as so few views and cells tell."""
    body = trimesh.load_mesh(path, process=False)
    assert body.is_watertight
    return np.median(np.abs(make_object(name).distance(body.vertices))) < 2e-3


def begin_next(run, way, frames):
    if way == "reset":
        for node in ("contour_tracker", "reconstructor", "mesher"):
            assert run.ros.call(*run.rig.trigger(f"{node}/reset")).success
        scanned(run, frames, start_s=200)
        return
    for k, view in enumerate(frames):
        run.rig.send(view, 50 * SECOND + k * STEP)
        run.graph.settle(12)
    run.ros.spin_until(lambda: 50 * SECOND + (len(frames) - 2) * STEP in run.rig.stamps("strip"))


@pytest.mark.parametrize("way", ["reset", "stamps that go back"])
def test_a_body_is_that_of_its_own_scan_and_a_finish_too(watched, tmp_path, way):
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    first = tmp_path / "scans" / run.states[-1]["id"]
    cut_short = closing(run)
    begin_next(run, way, views(name="torus")[:10])
    run.ros.spin_until(cut_short.done, what="an answer")
    assert not cut_short.result().success
    assert f"another scan has begun meanwhile: what there is of this one goes to {first}" in (
        cut_short.result().message
    )
    second = tmp_path / "scans" / run.until("scanning")["id"]
    assert first != second
    assert files(first) == {"mesh.ply"}

    halted(run, goes_on=True)
    run.ros.spin_until((first / "closed.ply").exists, what="the body of the first scan")
    assert is_of(first / "closed.ply", "vase")
    assert not run.closed
    answer = run.ros.call(*run.rig.trigger("mesher/save"))
    assert "closed" not in answer.message
    assert files(second) == {"mesh.ply"}
    answer = run.ros.call(*run.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    assert is_of(second / "closed.ply", "torus")
    assert not is_of(first / "closed.ply", "torus")


def test_finish_does_not_wait_for_the_body_of_the_scan_before(watched, tmp_path):
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    cut_short = closing(run)
    begin_next(run, "reset", views(name="torus")[:10])
    answer = closing(run)
    assert cut_short.done()
    halted(run, goes_on=True)
    run.ros.spin_until(answer.done, what="the second answer")
    assert answer.result().success, answer.result().message
    assert "triangles from 10 rims" in answer.result().message
    assert len(list((tmp_path / "scans").glob("*/closed.ply"))) == 2


@pytest.mark.parametrize("saved", [False, True])
def test_a_turn_that_is_closed_gets_its_body_though_it_is_cleared_at_once(watched, tmp_path, saved):
    run = watched(finish_when_closed=False)
    scanned(run, views())
    scan_id = run.until("turn_closed")["id"]
    if saved:
        assert run.ros.call(*run.rig.trigger("mesher/save")).success
    assert run.ros.call(*run.rig.trigger("mesher/reset")).success
    closed = tmp_path / "scans" / scan_id / "closed.ply"
    run.ros.spin_until(closed.exists, what="the body")
    assert is_of(closed, "vase")


def test_a_body_that_takes_too_long_is_saved_when_it_is_made(watched, tmp_path, monkeypatch):
    monkeypatch.setattr(closed_body, "_BODY_S", 0.1)
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    answer = closing(run)
    run.ros.spin_until(answer.done, what="an answer without a body")
    assert answer.result().success
    assert "no closed body: it takes longer than 0 s, and is saved then" in answer.result().message
    halted(run, goes_on=True)
    run.ros.spin_until(lambda: run.closed, what="the body")
    (closed,) = tmp_path.glob("scans/*/closed.ply")
    assert is_of(closed, "vase")
    assert run.ros.call(*run.rig.trigger("mesher/save")).message.endswith(f"; {closed}")


@pytest.mark.slow
def test_the_next_turn_ends_by_itself_after_one_that_was_cut_short(watched, tmp_path):
    run = watched(reset_when_saved=True)
    turn = views(COARSE)
    scanned(run, turn[:6])
    halted(run)
    scanned(run, turn[6:], first=6)
    run.ros.spin_until(lambda: run.states[-1]["reason"] == "the body is closed")
    begin_next(run, "reset", turn)
    halted(run, goes_on=True)
    run.until("saved")
    run.until("waiting")
    assert not run.graph.mesher.drops
    assert [files(folder) for folder in (tmp_path / "scans").iterdir()] == [BOTH, BOTH]


def test_the_end_waits_for_a_body_and_says_so(watched, tmp_path, capfd):
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    closing(run)
    halted(run, goes_on=True)
    run.ros.end(run.graph.mesher)
    (folder,) = (tmp_path / "scans").iterdir()
    said = capfd.readouterr().err
    assert "the body is being closed: waiting for it" in said
    assert str(folder / "closed.ply") in said
    assert is_of(folder / "closed.ply", "vase")
    assert files(folder) == BOTH


def test_what_came_after_a_finish_is_saved_with_its_body_at_the_end(watched, tmp_path):
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    assert run.ros.call(*run.rig.trigger("mesher/finish")).success
    scanned(run, views()[9:12], first=9)
    run.ros.end(run.graph.mesher)
    (folder,) = (tmp_path / "scans").iterdir()
    assert files(folder) == BOTH | KEPT
    assert is_of(folder / "closed.ply", "vase")
    assert (folder / "closed.ply").read_bytes() != (folder / "closed.previous.ply").read_bytes()


def test_the_end_says_which_file_is_missing(watched, tmp_path, capfd):
    run = watched(finish_when_closed=False)
    scanned(run, views()[:9])
    closing(run)
    os.kill(run.graph.mesher.keeper._body.pid, signal.SIGKILL)
    run.ros.end(run.graph.mesher)
    (folder,) = (tmp_path / "scans").iterdir()
    words = f"no {folder / 'closed.ply'}: the process that closes the body has ended (-9)"
    assert words in capfd.readouterr().err
    assert files(folder) == {"mesh.ply"}


@pytest.mark.slow
def test_a_body_that_is_out_of_date_is_closed_anew_and_the_turn_still_closes(watched, tmp_path):
    run = watched()
    scanned(run, views()[:9])
    answer = run.ros.call(*run.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    assert "200 degrees were not seen" in answer.message
    folder = tmp_path / "scans" / run.states[-1]["id"]
    body = (folder / "closed.ply").read_bytes()
    scanned(run, views()[9:14], first=9)
    answer = run.ros.call(*run.rig.trigger("mesher/save"))
    assert answer.message.endswith("the body is closed anew, and follows")
    # What was saved together stays together.
    assert files(folder) >= {"mesh.ply", *KEPT}
    assert (folder / "closed.previous.ply").read_bytes() == body
    run.ros.spin_until((folder / "closed.ply").exists, what="the body of 14 views")
    fuller = (folder / "closed.ply").read_bytes()
    run.ros.spin_until(lambda: run.states[-1]["angle deg"] == "260.0", what="the angle so far")

    scanned(run, views()[14:], first=14)
    run.until("turn_closed")
    assert run.until("saved")["angle deg"] == "360.0"
    assert len({body, fuller, (folder / "closed.ply").read_bytes()}) == 3


@pytest.mark.slow
def test_what_contradicts_a_saved_scan_is_saved_beside_it(watched, tmp_path):
    run = watched(close_body=False)
    scanned(run, views())
    first = run.until("saved")["id"]
    path = tmp_path / "scans" / first / "mesh.ply"
    saved = path.read_bytes()
    scanned(run, views(name="torus"), start_s=200)
    report = run.graph.report(run.graph.mesher, lambda r: r.level == Level.WARN)
    assert "contradicts it" in report.message
    run.until("turn_closed")
    last = run.until("saved")
    assert last["id"] == f"{first}_2"
    assert "contradicts it, and is saved beside it: another object?" in last["reason"]
    assert path.read_bytes() == saved
    assert files(path.parent) == files(path.parent.with_name(last["id"])) == {"mesh.ply"}


def test_a_turn_with_a_hole_is_saved_and_not_called_closed(watched):
    run = watched(close_body=False)
    scanned(run, views()[:6] + views()[12:])
    saved = run.until("saved")
    assert "turn_closed" not in run.passed()
    assert saved["angle deg"] == "220.0"
    assert "140 degrees were not seen" in saved["reason"]
    assert run.graph.reconstructor.figures()["angle covered deg"] == 220
