"""replay: whatever bag the frames come in, none is lost; whatever is wrong is said."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from diagnostic_msgs.msg import DiagnosticArray
from fixtures import COARSE
from rclpy.node import Node
from recordings import FRAMES, changed, write_all
from rosgraph_msgs.msg import Clock

from msg_adapters import decode_diagnostics, decode_stamp
from occ_recon_ros.cli.app import run
from occ_recon_ros.cli.replay import BagSource
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.blank import Blank
from occ_recon_ros.evaluation.image_quality import ImageQuality
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.second_look import SecondLook
from occ_recon_ros.evaluation.shifted import ShiftedPoses

LATER_NS = 30_000_000
PATIENT = f"--set=contour_tracker.work_queue={FRAMES}"  # a busy machine must not drop frames


def report(out: Path) -> dict:
    return json.loads((out / "report.json").read_text())


def replayed(out: Path) -> tuple[int, bytes]:
    return report(out)["frames"]["rims"], (out / "rims.ply").read_bytes()


@pytest.mark.slow
def test_the_make_of_the_bag_and_first_passes_that_find_all_right_do_not_matter(
    command, bag, expected, tmp_path
):
    other = tmp_path / "scan"
    assert command("import", bag.parent / "images", other, "--storage", "sqlite3")[0] == 0
    code, out, err = command("replay", other, "--out", tmp_path / "out", COARSE)
    assert (code, err) == (0, "")
    assert f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims" in out
    assert replayed(tmp_path / "out") == (FRAMES, expected)


def test_masks_and_poses_are_followed_by_a_second_look_at_both_and_at_single_poses(
    bag, tmp_path, monkeypatch
):
    steps = []

    def prepare(self, values, options):
        steps.extend(self._steps)
        raise UserError("enough")

    monkeypatch.setattr(BagSource, "prepare", prepare)
    assert run(["replay", str(bag), "--out", str(tmp_path / "out"), "--refine"]) == 2
    first, shifted, masks, poses, second, placed, last = steps
    assert isinstance(first, Blank)
    assert isinstance(shifted, ShiftedPoses)
    assert isinstance(second, SecondLook)
    assert isinstance(placed, Misplaced)
    assert isinstance(last, ImageQuality)
    for step in (second, placed):
        assert (step._masks, step._poses) == (masks, poses)
    assert (masks.name, poses.name) == ("segmentation", "refinement")


def test_topics_of_other_names_are_renamed(replay, messages, expected, tmp_path):
    names = {"/image": "/rig/image_raw", "/camera_info": "/rig/info", "/camera_pose": "/arm"}
    renamed = [m._replace(topic=names[m.topic]) for m in messages]
    other = write_all(tmp_path / "bag", renamed)
    code, out, err = replay(other, tmp_path / "out")
    assert code == 0
    for topic, name in names.items():
        assert f"{name} is taken for {topic}" in err
    assert replayed(tmp_path / "out") == (FRAMES, expected)

    # Of two that could be it, none.
    two = [m._replace(topic="/leg") for m in renamed if m.topic == "/arm"]
    other = write_all(tmp_path / "two", renamed + two)
    code, out, err = replay(other, tmp_path / "other")
    assert (code, out) == (2, "")
    hints = re.findall(r"--remap \S+:=\S+", err)
    assert len(hints) == 3
    arguments = " ".join(hints).replace(":\n", "").split()
    arguments = [argument.rstrip(",") for argument in arguments]
    assert replay(other, tmp_path / "other", *arguments)[0] == 0
    assert replayed(tmp_path / "other") == (FRAMES, expected)


def test_images_before_their_poses_in_another_frame_are_not_lost(
    replay, messages, expected, tmp_path
):
    def rename(pose):
        pose.header.frame_id = "plate"

    late = [m._replace(time_ns=m.time_ns + LATER_NS * (m.topic != "/image")) for m in messages]
    late = [changed(m, rename) if m.topic == "/camera_pose" else m for m in late]
    late.sort(key=lambda m: m.time_ns)
    assert late[0].topic == "/image"
    bag = write_all(tmp_path / "bag", late)
    assert replay(bag, tmp_path / "out")[0] == 0
    assert replayed(tmp_path / "out") == (FRAMES, expected)


def test_a_bad_frame_and_one_without_a_pose_are_dropped_by_name_and_the_others_are_used(
    replay, messages, tmp_path
):
    def blank(image):
        image.data = np.full_like(image.data, 200)

    fifth = [m for m in messages if m.topic == "/image"][4]
    without = [m for m in messages if m.topic == "/camera_pose"][7]
    spoilt = [changed(m, blank) if m is fifth else m for m in messages if m is not without]
    bag = write_all(tmp_path / "bag", spoilt)
    code, out, _ = replay(bag, tmp_path / "out")
    assert code == 0
    found = report(tmp_path / "out")
    assert found["frames"]["images"] == FRAMES
    assert found["frames"]["contours"] == FRAMES - 2
    drops = found["drops"]["contour_tracker"]
    assert drops.pop("no_camera_pose") == 1
    assert [*drops.values()] == [1]
    assert out.count("contour_tracker dropped 1: ") == 2


@pytest.mark.slow
def test_the_nodes_live_by_the_time_of_the_bag(ros, replay, bag, expected, tmp_path, monkeypatch):
    """In time, at a rate that they keep up with, all frames come through. Latency is measured
    from the stamps, of 1970, and within the time that /clock tells."""
    node = ros.start(Node, "watcher")
    ticks, reports = [], []
    node.create_subscription(Clock, "/clock", ticks.append, 1000)
    node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 1000)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain_id))
    rate = 0.2  # slow, for on a busy machine others are found late
    code, _, err = replay(bag, tmp_path / "out", "--rate", rate, "--clock", PATIENT)
    assert code == 0, err
    assert replayed(tmp_path / "out") == (FRAMES, expected)
    assert report(tmp_path / "out")["wall_time_s"] > (FRAMES - 1) * 0.1 / rate
    # The last one may be on its way when the replay ends; the nodes are in this process.
    ros.spin_until(
        lambda: ticks and decode_stamp(ticks[-1].clock) >= 2_000_000_000, what="the last times"
    )
    times = np.array([decode_stamp(tick.clock) for tick in ticks])
    assert (np.diff(times) >= 0).all()
    assert len(set(times)) > 2 * FRAMES  # also between the frames
    reports = [report for msg in reports for report in decode_diagnostics(msg)]
    # A second without a strip, as while the turn is finished, has no latency to report.
    name = "latency median ms"
    latency = [r.values[name] for r in reports if r.name == "/mesher" and name in r.values][-1]
    # A strip needs the next frame, 100 ms of the bag's time later.
    assert 100 <= float(latency) < 1000


def test_a_truncated_bag_is_replayed_as_far_as_it_is_whole(command, bag, tmp_path):
    data = bag.read_bytes()
    cut = tmp_path / "cut.db3"
    assert command("import", bag.parent / "images", cut)[0] == 0
    data = cut.read_bytes()
    cut.write_bytes(data[: len(data) * 3 // 4])
    code, _, err = command("replay", cut, "--out", tmp_path / "out", COARSE)
    assert code == 0
    assert err.startswith("warning: ")
    assert "is lost" in err
    assert err.count("\n") == 1
    found = report(tmp_path / "out")
    assert 6 <= found["frames"]["images"] < FRAMES
    assert found["frames"]["rims"] == found["frames"]["images"]
    assert "breaks off" in found["source"]["lost"]
    assert not found["turn"]["closed"]
    assert found["source"]["lost"] in (tmp_path / "out" / "report.html").read_text()


def test_parameters_reach_the_nodes(replay, bag, expected, tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text("reconstructor:\n  ros__parameters:\n    baseline: 0.9\n")
    assert replay(bag, tmp_path / "a", "--params", file)[0] == 0
    assert replayed(tmp_path / "a")[1] != expected
    # And --set the mesher: of 200 cells it would have some 80,000.
    assert report(tmp_path / "a")["closed"]["triangles"] < 10_000
    file.write_text("reconstructor:\n  ros__parameters:\n    baseline: -1.0\n")
    code, _, err = replay(bag, tmp_path / "c", "--params", file)
    assert code == 2
    assert "baseline" in err
    assert err.count("\n") == 1


BLANK = "blank"
BAD = {
    "no bag": (["nothing.mcap", "--out", "out"], "nothing.mcap does not exist"),
    "no out": (["scan.mcap"], "--out"),
    "out is a file": (["scan.mcap", "--out", "scan.mcap"], "not a folder"),
    "rate": (["scan.mcap", "--out", "out", "--rate", "fast"], "--rate fast"),
    "rate zero": (["scan.mcap", "--out", "out", "--rate", "0"], "--rate 0"),
    "parameter": (["scan.mcap", "--out", "out", "--set", "mesher.x=1"], "no parameter 'x'"),
    "file": (["scan.mcap", "--out", "out", "--params", "no.yaml"], "no.yaml does not exist"),
    "not yaml": (["scan.mcap", "--out", "out", "--params", "bad.yaml"], "bad.yaml cannot be read"),
    "remap": (["scan.mcap", "--out", "out", "--remap", "/a:=/image"], "the bag has no /a"),
    "topics": (["notopics", "--out", "out"], "has no /camera_pose"),
    "no object": ([BLANK, "--out", "out"], "no contours were found in 4 images"),
    "too few": (["two", "--out", "out"], "no rim has a point"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_call_is_one_line_and_leaves_nothing(
    command, bag, messages, tmp_path, monkeypatch, name
):
    monkeypatch.chdir(tmp_path)
    arguments, words = BAD[name]
    Path("scan.mcap").symlink_to(bag)
    Path("bad.yaml").write_text("a: [1, 2\n b: 3")
    if "notopics" in arguments:
        write_all(Path("notopics"), [m for m in messages if m.topic != "/camera_pose"])
    if "two" in arguments:
        write_all(Path("two"), messages[:6])
    if BLANK in arguments:

        def blank(image):
            image.data = np.full_like(image.data, 200)

        # Of four views, too few for masks of all of them together: those are sought in vain.
        few = messages[:12]
        write_all(Path(BLANK), [changed(m, blank) if m.topic == "/image" else m for m in few])
    before = sorted(tmp_path.iterdir())
    code, out, err = command("replay", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert words in err
    assert err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("views", "word"),
    [
        ((0, 1, 2, 3, 4, 5, 6, 7), "210 of 360 degrees"),
        ((5, 0, 0, 7, 2, 1, 6, 3, 3, 3, 4), "210 of 360 degrees"),
    ],
)
def test_a_turn_that_is_not_whole_gives_the_body_that_its_outlines_bound(
    command, replay, bag, tmp_path, views, word
):
    images = bag.parent / "images"
    content = json.loads((images / "cameras.json").read_text())
    frames = [content["frames"][view] for view in views]
    content["frames"] = [{**f, "file": str(images / f["file"])} for f in frames]
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "scan.mcap")[0] == 0
    baseline = "--set=reconstructor.baseline=0.4"
    assert replay(tmp_path / "scan.mcap", tmp_path / "out", baseline, PATIENT)[0] == 0
    found = report(tmp_path / "out")
    assert found["verdict"]["word"] == "doubtful"
    assert any(word in reason for reason in found["verdict"]["reasons"])
    # Half a turn shows all of it: an ellipse across, 0.8 as wide as it is long.
    whole = trimesh.load_mesh(tmp_path / "out" / "closed.ply")
    assert whole.is_watertight
    assert whole.extents[:2] == pytest.approx([0.15, 0.12], rel=0.03)
