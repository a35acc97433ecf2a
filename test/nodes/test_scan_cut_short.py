"""A scan that is ended before it is whole: what is kept of it, and what is said."""

import os
import pickle
import re
import signal
import time

import pytest
import trimesh
from forked import Beside
from rig import SECOND, STRIPS_ONLY, Rig, scan, views
from test_next_scan import STEP, Watched, scanned

from msg_adapters import Level, decode_contours, decode_rim
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode

ALONE = re.compile(r"Ctrl-C again leaves it to process (\d+), which still writes (\S+)")


@pytest.fixture
def watched(make_graph, tmp_path):
    def started(**mesher):
        mesher = {"finish_when_closed": False, "closed_preview": 0.0, **mesher}
        return Watched(make_graph, tmp_path / "scans", **mesher)

    return started


def test_a_body_whose_node_has_ended_is_written_all_the_same(graph, tmp_path):
    scan(graph.ros, graph.rig, views()[:9], finish=False)
    got = graph.rig.got
    messages = [("contours", decode_contours(msg)) for msg in got["contours"]]
    messages += [("rim", decode_rim(msg)) for msg in got["rim"]]
    path = tmp_path / "scans" / "one" / "closed.ply"
    child = Beside("occ_recon_ros.streams.body_process")
    child.stdout.close()
    for message in (*messages, ("close", True, 40, path)):
        pickle.dump(message, child.stdin)
    child.stdin.close()
    child.wait()
    assert trimesh.load_mesh(path, process=False).is_watertight


@pytest.mark.slow
def test_ctrl_c_twice_leaves_the_body_to_its_process(ros, tmp_path):
    params = {"output_dir": str(tmp_path), "body_cells": 200, "closed_preview": 0.0}
    params["finish_when_closed"] = False
    words = [word for k, v in params.items() for word in ("-p", f"{k}:={str(v).lower()}")]
    mesher = ros.process("mesher", *words)
    for kind in (ContourTrackerNode, ReconstructorNode):
        ros.start(kind)
    rig = ros.start(Rig)
    scan(ros, rig, views(), finish=False)
    ros.spin_until(lambda: 100 * SECOND + 16 * STEP in rig.stamps("strip"), what="strips")
    client, request = rig.trigger("mesher/finish")
    ros.spin_until(client.service_is_ready)
    client.call_async(request)
    ros.spin_until(lambda: 100 * SECOND + 17 * STEP in rig.stamps("strip"), what="the last strip")
    mesher.send_signal(signal.SIGINT)
    said = next(filter(None, map(ALONE.search, mesher.stdout)))
    mesher.send_signal(signal.SIGINT)
    assert mesher.wait() == -signal.SIGINT
    late = time.monotonic() + 120
    while not os.path.exists(said[2]) and time.monotonic() < late:
        time.sleep(0.1)  # nothing to wait on: nobody is told
    assert trimesh.load_mesh(said[2], process=False).is_watertight


@pytest.mark.parametrize("kept", [False, True])
def test_a_turn_that_is_ended_in_its_middle_says_how_its_body_is_got(
    watched, tmp_path, capfd, kept
):
    keep = {"checkpoint_every": 1, "checkpoint_path": str(tmp_path / "kept")} if kept else {}
    run = watched(**keep)
    scanned(run, views()[:9])
    scan_id = run.states[-1]["id"]
    run.ros.end(run.graph.mesher)
    folder, said = tmp_path / "scans" / scan_id, capfd.readouterr().err
    assert f"{folder / 'mesh.ply'}: " in said
    assert f"no {folder / 'closed.ply'}: the turn had not ended; /mesher/finish closes it" in said
    assert (f"or after occ-recon run --resume {tmp_path / 'kept'}" in said) == kept
    assert not run.graph.mesher.lost


def test_a_folder_that_cannot_be_written_is_said_at_once_and_in_the_exit_code(make_graph, tmp_path):
    (tmp_path / "file").write_text("")
    mesher = {"output_dir": str(tmp_path / "file" / "scans"), "save_on_shutdown": True}
    graph = make_graph({"mesher": mesher})
    words = f"output_dir: {tmp_path / 'file'} cannot be written into: no scan can be saved"
    assert graph.report(graph.mesher, lambda r: words in r.message).level == Level.WARN
    scan(graph.ros, graph.rig, views()[:6], finish=False)
    graph.ros.spin_until(lambda: len(graph.mesher._surface), what="triangles")
    graph.ros.end(graph.mesher)
    assert graph.mesher.lost


@pytest.mark.slow
@pytest.mark.parametrize(("number", "folder", "code"), [("SIGHUP", "", 0), ("SIGINT", "file", 1)])
def test_a_run_ends_by_what_it_could_save(ros, tmp_path, number, folder, code):
    (tmp_path / "file").write_text("")
    output = tmp_path / folder / "scans"
    off = [f"--set=mesher.{k}=false" for k in STRIPS_ONLY if k != "save_on_shutdown"]
    child = ros.command("run", f"--set=mesher.output_dir={output}", *off)
    rig = ros.start(Rig)
    scan(ros, rig, views()[:8], finish=False)
    ros.spin_until(lambda: 100 * SECOND + 6 * STEP in rig.stamps("strip"), what="the strips")
    child.send_signal(getattr(signal, number))
    _, err = child.communicate()
    assert child.returncode == code, err
    assert len(list(tmp_path.glob("scans/*/mesh.ply"))) == 1 - code


def test_finish_says_what_was_dropped_and_not_to_turn_further(make_graph):
    graph = make_graph({"tracker": {"sync_queue": 2}})
    scan(graph.ros, graph.rig, views()[:1], finish=False)
    for k in range(1, 5):
        graph.rig.send(views()[k], 100 * SECOND + k * STEP, parts=("info", "image"))
        graph.settle()
    graph.report(graph.tracker, lambda r: "dropped no_camera_pose" in r.values)
    graph.settle()
    answer = graph.ros.call(*graph.rig.trigger("mesher/finish"))
    assert not answer.success
    assert answer.message.startswith("contour_tracker has dropped 2 no_camera_pose, and says: ")
    assert "its camera_pose never came" in answer.message
    assert answer.message.endswith("a rim needs three views, and 1 came with an outline")


def test_stamps_that_go_back_in_the_middle_of_a_turn_are_a_warning(watched):
    run = watched(close_body=False)
    scanned(run, views()[:9])
    first = run.until("scanning")["id"]
    for k, view in enumerate(views()[9:15]):
        run.rig.send(view, 50 * SECOND + k * STEP)
        run.graph.settle(12)
    words = f"stamps went back in the middle of {first}, at 7 rims: what comes since is another"
    run.ros.spin_until(
        lambda: run.passed()[-2:] == ["waiting", "scanning"] and words in run.states[-1]["reason"]
    )
    assert run.levels[-1] == Level.WARN
    assert words in run.graph.report(run.graph.mesher, lambda r: r.level == Level.WARN).message
    assert run.ros.call(*run.rig.trigger("mesher/finish")).success
    assert run.until("saved")
    assert run.levels[-1] == Level.OK
