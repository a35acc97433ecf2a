"""The three nodes in one process, over real topics."""

import re
from dataclasses import replace

import numpy as np
import pytest
from rig import SECOND, SMALL, scan, views
from scipy.spatial.transform import Rotation

from msg_adapters import decode_rim, decode_shape, decode_stamp
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.scene import make_object


def test_a_full_turn_gives_a_rim_a_frame_and_a_strip_between_all(graph):
    rig = graph.rig
    scan(graph.ros, rig, views())
    rims = [decode_rim(msg) for msg in rig.got["rim"]]
    assert len({rim.stamp_ns for rim in rims}) == SMALL.frames
    contours = {decode_stamp(m.header.stamp): m.width for m in rig.got["contours"]}
    assert all(contours[rim.stamp_ns] == len(rim) for rim in rims)
    good = np.concatenate([rim.points[rim.status == 0] for rim in rims])
    distance = np.abs(make_object("vase").distance(good))
    assert np.median(distance) < 2e-4  # a pixel is 2.5 mm here
    # Every strip but that of the very first rim has triangles: the turn is closed.
    empty = [msg for msg in rig.got["strip"] if not msg.height]
    assert len(empty) == 1
    assert len(rig.triangles()) > 1000


@pytest.mark.slow
def test_a_dropped_frame_loses_one_rim_and_not_the_scan(graph):
    frames = views()
    scan(graph.ros, graph.rig, frames[:6], finish=False)
    for k, view in enumerate(frames[6:], start=6):
        parts = ("info", "pose") if k == 9 else ("info", "pose", "image")
        graph.rig.send(view, 100 * SECOND + k * SECOND // 10, parts=parts)
        graph.settle()
    graph.ros.spin_until(lambda: graph.reconstructor.figures()["frames"] == SMALL.frames - 1)
    assert graph.ros.call(*graph.rig.trigger("reconstructor/finish")).success
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == SMALL.frames - 1)
    assert graph.tracker.drops == {"no_image": 1}
    rims = [decode_rim(msg) for msg in graph.rig.got["rim"]]
    missing = 100 * SECOND + 9 * SECOND // 10
    assert missing not in {rim.stamp_ns for rim in rims}
    assert sum(not msg.height for msg in graph.rig.got["strip"]) == 1


def test_a_frame_from_where_the_camera_was_before_gives_no_rim_and_is_named(graph):
    frames = views()[:5]
    scan(graph.ros, graph.rig, [*frames[:3], frames[2], *frames[3:]], finish=False, start_s=50)
    graph.ros.spin_until(lambda: len(graph.rig.stamps("rim")) == 3)
    assert graph.reconstructor.drops == {"camera_unmoved": 1}
    assert 50 * SECOND + 3 * SECOND // 10 not in graph.rig.stamps("rim")


def test_two_rigs_in_two_namespaces_do_not_touch(ros, make_graph):
    left, right = make_graph(namespace="/left"), make_graph(namespace="/right")
    scan(ros, left.rig, views()[:6], finish=False)
    scan(ros, right.rig, views(name="torus")[:4], finish=False)
    left.settle()
    assert len(left.rig.got["contours"]) == 6
    assert len(right.rig.got["contours"]) == 4
    assert len(left.rig.got["rim"]) == 4
    assert len(right.rig.got["rim"]) == 2
    assert ros.call(*left.rig.trigger("/left/reconstructor/finish")).success
    ros.spin_until(lambda: len(left.rig.got["rim"]) == 6)
    assert len(right.rig.got["rim"]) == 2


def test_the_virtual_turntable_waits_for_listeners_and_runs_through(ros, make_graph):
    settings = {"frames": 5, "width": 320, "height": 240, "focal_px": 400.0, "frame_rate": 200.0}
    table = ros.start(VirtualTurntableNode, params=settings | {"object": "torus", "step": 0.3})
    for _ in range(20):
        ros.executor.spin_once(timeout_sec=0.01)
    assert table.figures()["frames published"] == 0
    graph = make_graph()
    ros.spin_until(lambda: len(graph.rig.got["contours"]) == 5, what="five contours")
    assert not graph.tracker.drops
    assert {m.header.frame_id for m in graph.rig.got["contours"]} == {"turntable"}


def test_the_shape_of_the_surface_comes_with_the_rim_where_asked_for(make_graph):
    graph = make_graph({"reconstructor": {"shape_fields": True}})
    scan(graph.ros, graph.rig, views()[:8])
    for msg in graph.rig.got["rim"]:
        rim, shape = decode_rim(msg), decode_shape(msg)
        good = rim.status == 0
        assert np.isfinite(shape.gauss[good]).mean() > 0.9
        assert (np.abs(shape.theta[good] - np.pi / 2) < np.pi / 2).mean() > 0.8


def test_cameras_that_look_aside_are_said_in_diagnostics(make_graph):
    graph = make_graph()
    frames = []
    for camera, image in views():
        turn = Rotation.from_rotvec(4 * np.array([0, 1, 0]) / camera.K[0, 0])
        R, t = turn.apply(camera.R_camera_object.T).T, turn.apply(camera.t_camera_object)
        frames.append((replace(camera, R_camera_object=R, t_camera_object=t), image))
    scan(graph.ros, graph.rig, frames)
    message = graph.report(graph.reconstructor).message
    said = re.search(r"calibration are off by about ([0-9.]+) px", message)
    assert said, message
    assert 2 < float(said[1]) < 8
