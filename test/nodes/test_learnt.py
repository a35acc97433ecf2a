"""Segmentation that a live scan learns from its first turn."""

import os
import signal

import numpy as np
import pytest
import trimesh
from forked import wait_until_ready
from photograph_scenes import Stage, body, folded, mottled, photograph, plain, turn
from rig import SECOND, scan, send_until_seen

from msg_adapters import decode_contours, decode_stamp
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.scene import coverage
from occ_recon_ros.streams.kept_frames import PackedFrame
from occ_recon_ros.streams.learning import learn

SIZE = (160, 120)
VIEWS = 12
PLASTER = mottled((185, 195, 200), (165, 175, 180), 0.04)
WHOLE = {"finish_when_closed": False, "closed_preview": 0.0, "body_cells": 40}


def shots(stage, frames):
    return [photograph(stage, camera, k) for k, camera in enumerate(turn(frames, SIZE))]


@pytest.fixture(scope="module")
def before_folds():
    """A plaster figure before blue cloth with folds as light as itself."""
    stage = Stage(body("figure"), PLASTER, folded((90, 40, 20), 25), ambient=0.15)
    return shots(stage, VIEWS)


def frames_of(taken):
    return [(shot.camera, shot.image) for shot in taken]


def iou(a, b):
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def overlap(contours, truth):
    """IoU of contours with a mask (h, w)."""
    loops = [contours.uv[contours.loop == k] for k in np.unique(contours.loop)]
    return iou(coverage(loops, *SIZE) > 0.5, truth)


def learning_graph(make_graph, folder=None, close_body=True, **tracker):
    wait_until_ready()  # the tracker would wait for it when it begins to learn
    mesher = {**WHOLE, "output_dir": str(folder), "close_body": close_body} if folder else {}
    tracker = {"segmentation": "learnt", "learn_frames": 120, **tracker}
    return make_graph({"tracker": tracker, "mesher": mesher})


def outcome(graph):
    """The report of the tracker once what was to be learnt is learnt, or not."""
    report = graph.report(graph.tracker, lambda r: not r.values["learning"].startswith("learning"))
    return report, report.values["learning"]


@pytest.mark.slow
def test_later_frames_are_taken_well_and_the_first_ones_again(make_graph, tmp_path, before_folds):
    graph = learning_graph(make_graph, tmp_path, learn_after=250.0)
    views = frames_of(before_folds)
    early = 10  # of 30 degrees each
    scan(graph.ros, graph.rig, views[:early], finish=False, step_ns=SECOND)
    _, words = outcome(graph)
    assert words.startswith("learnt: belief")
    assert "single images contradict the others" in words
    scan(graph.ros, graph.rig, views[early:], 100 + early, SECOND, finish=False)
    seen = [decode_contours(msg) for msg in graph.rig.got["contours"]]
    truth = {(100 + k) * SECOND: shot.truth for k, shot in enumerate(before_folds)}
    scores = {c.stamp_ns: overlap(c, truth[c.stamp_ns]) for c in seen}
    alone, learnt = np.split(np.array([scores[stamp] for stamp in sorted(truth)]), [early])
    assert alone.mean() < 0.5
    assert learnt.min() > 0.8

    graph.rig.got["contours"].clear()
    answer = graph.ros.call(*graph.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    assert f"triangles from {VIEWS} rims" in answer.message
    assert f"{VIEWS} frames were taken again" in answer.message
    mark, *again = map(decode_contours, graph.rig.got["contours"])
    assert not len(mark)
    assert [c.stamp_ns for c in again] == sorted(truth)
    better = [overlap(c, truth[c.stamp_ns]) for c in again]
    assert np.mean(better) > 0.86
    assert min(better) > 0.8

    # One scan, whose files are of the contours that came again.
    (closed,) = tmp_path.glob("scan_*/closed.ply")
    solid, right = trimesh.load_mesh(closed), body("figure")
    low, high = np.array([solid.bounds, right.bounds]).swapaxes(0, 1)
    points = np.random.default_rng(0).uniform(low.min(axis=0), high.max(axis=0), (4000, 3))
    assert iou(solid.contains(points), right.contains(points)) > 0.7  # 0.002 of the first ones

    # Nothing more is to be taken again, and what comes now belongs to the same scan.
    send_until_seen(graph.ros, graph.rig, views[1], 200 * SECOND)
    answer = graph.ros.call(*graph.rig.trigger("contour_tracker/finish"))
    assert not answer.success
    assert answer.message.startswith("no frames are to be taken again (learnt: belief")
    assert not graph.tracker.drops
    assert len(list(tmp_path.glob("scan_*"))) == 1


@pytest.mark.slow
def test_frames_that_contradict_each_other_are_taken_again_at_the_end_by_default(
    make_graph, tmp_path, before_folds
):
    graph = learning_graph(make_graph, tmp_path, segmentation="auto")
    views = frames_of(before_folds)
    scan(graph.ros, graph.rig, views, finish=False, step_ns=SECOND)
    words = graph.report(graph.tracker).values["learning"]
    assert words == "collecting: 360 at ~/finish"  # however far the turn has come
    graph.rig.got["contours"].clear()
    answer = graph.ros.call(*graph.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    assert f"{VIEWS} frames were taken again by all of them together (belief" in answer.message
    assert "single images contradict the others" in answer.message
    _, *again = map(decode_contours, graph.rig.got["contours"])
    assert min(overlap(c, shot.truth) for c, shot in zip(again, before_folds, strict=True)) > 0.8
    # What comes now is taken as well, and none is kept any longer.
    graph.rig.got["contours"].clear()
    send_until_seen(graph.ros, graph.rig, views[1], 200 * SECOND)
    assert overlap(decode_contours(graph.rig.got["contours"][-1]), before_folds[1].truth) > 0.8
    assert graph.report(graph.tracker).values["frames kept"] == "0"


@pytest.mark.slow
def test_by_default_frames_that_agree_are_let_go_when_the_turn_has_ended(make_graph, tmp_path):
    taken = shots(Stage(body("vase"), PLASTER, plain((90, 40, 20)), ambient=0.5), 9)
    graph = learning_graph(make_graph, tmp_path, close_body=False, segmentation="auto")
    said = "no frames are to be taken again (not needed: what single images say agrees)"
    finish = graph.rig.trigger("contour_tracker/finish")
    scan(graph.ros, graph.rig, frames_of(taken)[:8], finish=False, step_ns=SECOND)
    assert graph.ros.call(*finish).message == said
    # The turn may go on: what it shows until then is still kept.
    assert graph.report(graph.tracker).values["frames kept"] == "8"
    scan(graph.ros, graph.rig, frames_of(taken)[8:], 108, finish=False)
    graph.report(graph.mesher, lambda r: r.values["scan state"] == "turn_closed")
    graph.settle()
    assert graph.ros.call(*finish).message == said
    assert graph.report(graph.tracker).values["frames kept"] == "0"
    assert len(graph.rig.got["contours"]) == 9  # none came again


@pytest.mark.parametrize("why", [{"learn_frames": 0}, {"background_frames": 1}])
def test_nothing_is_kept_where_nothing_is_to_be_taken_again(make_graph, why):
    graph = make_graph({"tracker": {"learn_frames": 120, **why}})
    assert "learning" not in graph.report(graph.tracker).values


@pytest.mark.slow
@pytest.mark.usefixtures("begun_from_nothing")
def test_where_single_images_agree_everything_is_as_without_learning(make_graph):
    taken = shots(Stage(body("vase"), PLASTER, plain((90, 40, 20)), ambient=0.5), 8)
    graph = learning_graph(make_graph, learn_after=300.0)
    scan(graph.ros, graph.rig, frames_of(taken), finish=False, step_ns=SECOND)
    assert outcome(graph)[1] == "not needed: what single images say agrees"
    answer = graph.ros.call(*graph.rig.trigger("contour_tracker/finish"))
    assert answer.message.startswith("no frames are to be taken again (not needed")
    assert not graph.tracker.drops
    alone = ContourTracker(ContourSettings())
    for msg, shot in zip(graph.rig.got["contours"], taken, strict=True):
        stamp = decode_stamp(msg.header.stamp)
        expected = alone.process(shot.image, shot.camera, stamp, "turntable")
        np.testing.assert_allclose(decode_contours(msg).uv, expected.uv, atol=1e-4)


def test_too_few_frames_leave_the_scan_as_it_is(make_graph, tmp_path, before_folds):
    graph = learning_graph(make_graph, tmp_path, close_body=False)
    scan(graph.ros, graph.rig, frames_of(before_folds)[:6], finish=False, step_ns=SECOND)
    assert outcome(graph)[1] == "collecting: 0 of 270 degrees"
    answer = graph.ros.call(*graph.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    assert "taken again" not in answer.message
    assert len(graph.rig.got["contours"]) == 6
    assert not graph.tracker.drops


def test_a_killed_process_leaves_the_node_as_it_was(make_graph, before_folds):
    graph = learning_graph(make_graph, learn_after=200.0)
    views = frames_of(before_folds)
    scan(graph.ros, graph.rig, views[:8], finish=False, step_ns=SECOND)
    os.kill(graph.tracker._learning.process.pid, signal.SIGKILL)
    report, words = outcome(graph)
    assert words == "failed: the process that learns has ended (-9)"
    assert "images are segmented one by one" in report.message
    send_until_seen(graph.ros, graph.rig, views[9], 200 * SECOND)


def test_a_new_scan_learns_anew(make_graph, before_folds):
    graph = learning_graph(make_graph, learn_after=200.0)
    views = frames_of(before_folds)
    scan(graph.ros, graph.rig, views[:8], finish=False, step_ns=SECOND)
    pid = graph.tracker._learning.process.pid
    assert graph.ros.call(*graph.rig.trigger("contour_tracker/reset")).success
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    report, words = outcome(graph)
    assert words == "collecting: 0 of 200 degrees"
    assert report.values["frames kept"] == "0"


def test_images_of_which_nothing_can_be_learnt_say_so():
    black = np.zeros((30, 40, 3), np.uint8)
    frames = [PackedFrame.of(black, camera, k) for k, camera in enumerate(turn(4, (40, 30)))]
    lesson = learn(frames, ContourSettings(segmentation="learnt"))
    assert lesson.failed
    assert lesson.masks is None
    assert lesson.words.startswith("single images give 0 outlines in 4 frames; all together: 4")
