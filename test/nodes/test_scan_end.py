"""A scan ends by itself: closed body, files, and a state that everybody can see."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from diagnostic_msgs.msg import DiagnosticStatus
from forked import wait_until_ready
from rclpy.parameter import Parameter
from rig import SECOND, SMALL, scan, views
from sensor_msgs.msg import PointCloud2

from msg_adapters import Level, decode_contours, decode_rim, decode_status, decode_strip
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.qos import latched
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.surface.body import body_views, closed_views, closing_settings

CELLS = 40
WHOLE = {"finish_when_closed": True, "close_body": True, "save_on_shutdown": True}
WHOLE["body_cells"] = CELLS


def turn():
    """Cameras and images of a turn in steps of 30 degrees."""
    return views(replace(SMALL, frames=12, step=np.pi / 6))


class Watched:
    """A graph whose mesher ends scans by itself, and what it says of them."""

    def __init__(self, make_graph, folder, **mesher):
        wait_until_ready()  # a node would wait for it when it begins to close a body
        self.graph = make_graph({"mesher": {**WHOLE, "output_dir": str(folder), **mesher}})
        self.ros, self.rig = self.graph.ros, self.graph.rig
        self.states, self.levels, self.closed = [], [], []
        self.rig.create_subscription(DiagnosticStatus, "mesher/scan", self._on_state, latched())
        self.rig.create_subscription(PointCloud2, "closed", self.closed.append, latched())
        self.ros.spin_until(lambda: self.states, what="the state of the scan")

    def _on_state(self, msg):
        status = decode_status(msg)
        self.states.append(status.values)
        self.levels.append(status.level)

    def until(self, state, timeout=180):
        self.ros.spin_until(lambda: self.states[-1]["state"] == state, timeout, state)
        return self.states[-1]

    def passed(self):
        """The states, each once as it was entered."""
        names = [values["state"] for values in self.states]
        return [n for k, n in enumerate(names) if not k or n != names[k - 1]]


@pytest.fixture
def watched(make_graph, tmp_path):
    return lambda **mesher: Watched(make_graph, tmp_path / "scans", **mesher)


def offline_body(rig):
    """The body that replay makes of the same contours and rims."""
    contours = {c.stamp_ns: c for c in map(decode_contours, rig.got["contours"])}
    rims = {r.stamp_ns: r for r in map(decode_rim, rig.got["rim"])}
    return closed_views(*body_views(contours, rims), settings=closing_settings(CELLS)).mesh


@pytest.mark.usefixtures("begun_from_nothing")
def test_a_turn_that_nobody_ends_is_closed_and_saved(watched, tmp_path):
    run = watched(closed_preview=0.0)
    scan(run.ros, run.rig, turn(), finish=False)
    saved = run.until("saved")
    assert run.passed() == ["waiting", "scanning", "turn_closed", "finishing", "saved"]
    assert saved["id"].startswith("scan_20")
    assert float(saved["angle deg"]) in (0, 360)
    assert saved["frames"] == str(len(turn()))
    assert 0.3 < float(saved["good share"]) <= 1
    assert (saved["doubt"], run.levels[-1]) == ("", Level.OK)
    folder = tmp_path / "scans" / saved["id"]
    assert {p.name for p in folder.iterdir()} == {"mesh.ply", "closed.ply"}
    assert str(folder / "closed.ply") in saved["reason"]
    mesh = trimesh.load_mesh(folder / "mesh.ply", process=False)
    assert len(mesh.faces) == len(run.graph.mesher._surface)

    # The body on the topic, the one in the file and that of replay are one.
    body = trimesh.load_mesh(folder / "closed.ply", process=False)
    assert body.is_watertight
    run.ros.spin_until(lambda: run.closed, what="the body")
    strip = decode_strip(run.closed[-1])
    assert strip.frame_id == "turntable"
    np.testing.assert_array_equal(strip.corners, np.float32(body.vertices)[body.faces])
    offline = offline_body(run.rig)
    np.testing.assert_array_equal(body.faces, offline.faces)
    np.testing.assert_allclose(body.vertices, offline.vertices, atol=1e-7)


def test_finish_drives_the_whole_chain_and_answers_when_all_is_there(watched, tmp_path):
    run = watched(finish_when_closed=False)
    scan(run.ros, run.rig, turn()[:8], finish=False)
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert answer.success, answer.message
    # The last rims have come, although nobody waited for them.
    assert len(run.graph.mesher._surface._placed) == 8
    assert run.states[-1]["state"] == "saved" or run.until("saved")
    (mesh,) = (tmp_path / "scans").glob("scan_*/mesh.ply")
    assert str(mesh) in answer.message
    assert f"{len(trimesh.load_mesh(mesh).faces)} triangles from 8 rims" in answer.message


def test_a_view_that_contradicts_the_others_is_named_when_the_scan_is_saved(watched):
    # The table slipped for one frame: too little to be seen among the samples of all rims.
    run = watched(finish_when_closed=False)
    frames = list(turn())
    camera, image = frames[7]
    frames[7] = camera, np.roll(image, 25, axis=1)
    scan(run.ros, run.rig, frames, finish=False)
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert answer.success, answer.message
    saved = run.until("saved")
    assert saved["doubt"].startswith("1 of 12 views contradict the others, by up to ")
    stamp = decode_contours(run.rig.got["contours"][7]).stamp_ns
    assert saved["doubt"].endswith(f"look at pose and outline at stamp {stamp * 1e-9:.3f}")
    assert saved["doubt"] in answer.message
    assert run.levels[-1] == Level.WARN


def test_two_who_ask_at_once_get_one_answer(watched):
    run = watched(finish_when_closed=False, close_body=False)
    scan(run.ros, run.rig, turn()[:8], finish=False)
    client, request = run.rig.trigger("mesher/finish")
    run.ros.spin_until(client.service_is_ready)
    futures = [client.call_async(request) for _ in range(2)]
    run.ros.spin_until(lambda: all(f.done() for f in futures))
    assert futures[0].result().success
    assert futures[0].result().message == futures[1].result().message


def test_finish_of_a_scan_too_short_says_what_to_do(watched, tmp_path):
    run = watched()
    frames = turn()[:1] * 3
    scan(run.ros, run.rig, frames, finish=False)
    answer = run.ros.call(*run.rig.trigger("mesher/finish"), timeout=180)
    assert not answer.success
    assert "all 3 camera poses are the same: turn further" in answer.message
    assert "in the frame that turns with the object" in answer.message
    assert run.until("failed")["reason"] == answer.message
    assert not (tmp_path / "scans").exists()


def test_finish_without_a_scan_says_so(watched):
    answer = (run := watched()).ros.call(*run.rig.trigger("mesher/finish"))
    assert not answer.success
    assert "nothing to finish" in answer.message


@pytest.mark.slow
def test_a_coarse_body_is_seen_while_the_turn_goes_on(watched):
    run = watched(closed_preview=0.1, body_cells=160)
    scan(run.ros, run.rig, turn()[:8], finish=False)
    run.ros.spin_until(lambda: run.closed, what="a preview")
    coarse = decode_strip(run.closed[0])
    scan(run.ros, run.rig, turn()[8:], start_s=102, finish=False)
    run.until("saved")
    fine = decode_strip(run.closed[-1])
    assert 1000 < len(coarse) < len(fine) / 4


@pytest.mark.slow
@pytest.mark.parametrize("back_s", [1, 3600])
def test_time_that_goes_back_saves_the_scan_first(watched, tmp_path, back_s):
    run = watched(closed_preview=0.0)
    scan(run.ros, run.rig, turn()[:10], start_s=4000, finish=False)
    first = run.until("scanning")["id"]
    run.ros.spin_until(lambda: len(run.rig.got["strip"]) == 8, what="the strips so far")
    triangles = len(run.graph.mesher._surface)
    assert triangles
    for k, view in enumerate(turn()):
        run.rig.send(view, (4000 - back_s) * SECOND + k * SECOND // 50)
        run.graph.settle(12)
    path = tmp_path / "scans" / first / "mesh.ply"
    run.ros.spin_until(path.exists, what="the first scan on disk")
    assert len(trimesh.load_mesh(path).faces) == triangles
    # The second is whole: its own name, its own body.
    second = run.until("saved")
    assert second["id"] != first
    seen = {s for s in run.rig.stamps("contours") if s >= (4000 - back_s) * SECOND}
    seen -= {4000 * SECOND + k * SECOND // 10 for k in range(10)}
    assert second["frames"] == str(len(seen))
    body = trimesh.load_mesh(tmp_path / "scans" / second["id"] / "closed.ply", process=False)
    assert body.is_watertight


def test_a_reset_keeps_a_copy_of_what_is_cleared(watched, tmp_path):
    run = watched()
    scan(run.ros, run.rig, turn()[:8], finish=False)
    first = run.until("scanning")["id"]
    assert run.ros.call(*run.rig.trigger("mesher/reset")).success
    assert trimesh.load_mesh(tmp_path / "scans" / first / "mesh.ply").faces.size
    run.until("waiting")


def test_scans_of_one_name_keep_the_one_before(watched, tmp_path):
    run = watched(scan_name="cup", finish_when_closed=False)
    counts = []
    for start in (100, 200):
        scan(run.ros, run.rig, turn()[: start // 25 + 3], start_s=start, finish=False)
        wanted = {start * SECOND + (start // 25 + 1) * SECOND // 10}
        run.ros.spin_until(lambda w=wanted: w <= run.rig.stamps("strip"), what="its strips")
        counts.append(len(run.graph.mesher._surface))
        for node in ("contour_tracker", "reconstructor", "mesher"):
            assert run.ros.call(*run.rig.trigger(f"{node}/reset")).success
    folder = tmp_path / "scans" / "cup"
    sizes = [len(trimesh.load_mesh(folder / f"mesh{k}.ply").faces) for k in (".previous", "")]
    assert sizes == counts


@pytest.mark.parametrize("name", ["../up", "/etc/x", "..", "a/b", "a\\b"])
def test_no_name_leads_out_of_the_folder(graph, name):
    (answer,) = graph.mesher.set_parameters([Parameter("scan_name", value=name)])
    assert not answer.successful
    assert "plain name" in answer.reason
    (answer,) = graph.mesher.set_parameters([Parameter("output_dir", value="/tmp")])
    assert not answer.successful


@pytest.mark.slow
def test_one_scan_after_the_other_without_a_call(watched, tmp_path):
    run = watched(reset_when_saved=True, close_body=False)
    for start in (100, 200):
        scan(run.ros, run.rig, turn(), start_s=start, finish=False)
        run.until("saved")
        run.until("waiting")
        run.ros.spin_until(lambda: not run.graph.reconstructor.figures()["frames"])
    meshes = sorted((tmp_path / "scans").glob("scan_*/mesh.ply"))
    assert len(meshes) == 2
    assert len({path.read_bytes() for path in meshes}) == 1


@pytest.mark.slow
def test_a_finished_scan_is_quiet(watched):
    run = watched(close_body=False)
    scan(run.ros, run.rig, turn(), finish=False)
    run.until("saved")
    for node in (run.graph.tracker, run.graph.reconstructor, run.graph.mesher):
        report = run.graph.report(node, lambda r: float(r.values.get("rim rate Hz", 0)) == 0)
        report = run.graph.report(node)
        assert report.message == "OK", report


def test_a_scan_that_was_saved_is_not_gone_on_with(watched, tmp_path):
    keep = {"checkpoint_every": 1, "checkpoint_path": str(tmp_path / "kept"), "resume": True}
    run = watched(close_body=False, **keep)
    run.ros.end(run.graph.reconstructor)
    reconstructor = run.ros.start(ReconstructorNode, params=keep)
    run.ros.spin_until(run.rig.ready, what="the graph")
    scan(run.ros, run.rig, turn(), finish=False)
    run.until("saved")
    files = [tmp_path / "kept" / f"{name}.checkpoint" for name in ("mesher", "reconstructor")]
    run.ros.spin_until(lambda: all(f.read_bytes().endswith(b"saved") for f in files))
    run.ros.end(run.graph.mesher)
    run.ros.end(reconstructor)
    again = [run.ros.start(kind, params=keep) for kind in (MesherNode, ReconstructorNode)]
    assert again[0].figures()["rims"] == again[1].figures()["frames"] == 0
    assert all(f.with_name(f"{f.name}.previous").stat().st_size > 10_000 for f in files)


@pytest.mark.slow
def test_a_scan_that_goes_on_keeps_its_name_and_ends_in_the_same_body(watched, tmp_path):
    keep = {"checkpoint_every": 1, "checkpoint_path": str(tmp_path / "kept"), "resume": True}
    run = watched(closed_preview=0.0, **keep)
    scan(run.ros, run.rig, turn()[:9], finish=False)
    name = run.until("scanning")["id"]
    last = 100 * SECOND + 7 * SECOND // 10
    run.ros.spin_until(lambda: last in run.rig.stamps("strip"), what="the strips so far")
    run.graph.mesher.keeper.scan.unsaved = False  # as a killed one, it saves nothing
    run.ros.end(run.graph.mesher)
    output = {"output_dir": str(tmp_path / "scans")}
    run.graph.mesher = run.ros.start(MesherNode, params={**keep, **WHOLE, **output})
    run.ros.spin_until(run.rig.ready, what="the graph")
    scan(run.ros, run.rig, turn()[9:], start_s=101, finish=False)
    saved = run.until("saved")
    assert saved["id"] == name
    body = trimesh.load_mesh(tmp_path / "scans" / name / "closed.ply", process=False)
    offline = offline_body(run.rig)
    np.testing.assert_array_equal(body.faces, offline.faces)
    np.testing.assert_allclose(body.vertices, offline.vertices, atol=1e-7)
