"""What is said of a scan that is saved, where what it was made of is in doubt or lacks images."""

from dataclasses import replace

import numpy as np
import pytest
from rig import SECOND, scan, views
from test_scan_end import Watched

from msg_adapters import Level, encode_camera_info

STEP = SECOND // 10


def finished(run):
    answer = run.ros.call(*run.rig.trigger("mesher/finish"))
    assert answer.success, answer.message
    return answer.message


def test_another_k_in_mid_scan_is_a_doubt_of_what_is_saved(make_graph, tmp_path):
    run = Watched(make_graph, tmp_path, close_body=False, finish_when_closed=False)
    grown = [(replace(c, K=c.K * [[1.06], [1.06], [1]]), image) for c, image in views()[5:9]]
    scan(run.ros, run.rig, [*views()[:5], *grown], finish=False)
    words = "f 424.0 px instead of 400.0 (+6.0%)"
    told = run.graph.report(run.graph.tracker, lambda r: r.values.get("doubt"))
    assert words in told.values["doubt"]
    assert words in finished(run)
    assert words in run.until("saved")["doubt"]
    assert run.levels[-1] == Level.WARN
    # The next scan begins with the K of now.
    assert run.ros.call(*run.rig.trigger("contour_tracker/reset")).success
    scan(run.ros, run.rig, grown[:1], start_s=300, finish=False)
    assert run.graph.report(run.graph.tracker).values.get("doubt") is None


@pytest.mark.slow
def test_images_without_a_mask_and_those_that_wait_for_a_pose_are_counted_as_lost(
    make_graph, tmp_path
):
    run = Watched(make_graph, tmp_path, close_body=False, finish_when_closed=False)
    scan(run.ros, run.rig, views()[:6], finish=False)
    run.rig.publish_mask(np.zeros((240, 320), np.uint8), SECOND)
    run.ros.spin_until(lambda: run.graph.tracker._wants_mask(), what="the masks")
    for k, view in enumerate(views()[6:9]):
        run.rig.send(view, 101 * SECOND + k * STEP, parts=("info", "pose", "image"))
        run.graph.settle()
    for k, view in enumerate(views()[9:11]):
        run.rig.send(view, 102 * SECOND + k * STEP, parts=("info", "image"))
        run.graph.settle()
    words = "5 of 11 images were lost: 3 had no mask, 2 had no camera_pose"
    run.graph.report(run.graph.tracker, lambda r: words in r.values.get("images lost", ""))
    run.graph.settle()
    assert words in finished(run)
    assert words in run.until("saved")["reason"]


def test_images_whose_camera_info_cannot_be_used_are_lost_too(make_graph, tmp_path):
    run = Watched(make_graph, tmp_path, close_body=False, finish_when_closed=False)
    scan(run.ros, run.rig, views()[:5], finish=False)
    for k, view in enumerate(views()[5:8]):
        stamp_ns = 101 * SECOND + k * STEP
        info = encode_camera_info(view[0], stamp_ns, "camera")
        info.k[:] = np.zeros(9)
        run.rig.info.publish(info)
        run.rig.send(view, stamp_ns, parts=("pose", "image"))
        run.graph.settle()
    words = "3 of 8 images were lost: 3 had no camera_info, pose or pixels that can be used"
    run.graph.report(run.graph.tracker, lambda r: words in r.values.get("images lost", ""))
