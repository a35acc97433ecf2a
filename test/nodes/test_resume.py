"""What a node that is started again has to know beside the messages of the scan."""

import numpy as np
import pytest
from rig import SECOND, STRIPS_ONLY, scan, send_until_seen, views
from test_colour_topics import coloured_views

from msg_adapters import decode_contours
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode

EMPTY = 2


def keep(folder, **more):
    return {"checkpoint_every": 1, "checkpoint_path": str(folder), "resume": True, **more}


def contours_of(graph, start_s):
    """By frame, of the scan that began then."""
    all_of = {c.stamp_ns: c for c in map(decode_contours, graph.rig.got["contours"])}
    return {s // (SECOND // 10) - 10 * start_s: c for s, c in all_of.items() if s >= start_s * 1e9}


@pytest.mark.parametrize("cut", [1, 7])
def test_a_tracker_that_comes_back_finds_what_it_would_have_found(make_graph, tmp_path, cut):
    """It has learnt the empty rig, partly or wholly, and follows its outlines; none can be seen
    from the one image that comes next."""
    settings = {"segmentation": "background", "background_frames": EMPTY, "tracking": "snake"}
    frames = [(c, np.full_like(i, i[0, 0])) for c, i in views()[:EMPTY]] + views()[EMPTY:9]

    def run(graph, start_s, stop):
        for k, view in enumerate(frames):
            if k == stop:
                graph.ros.end(graph.tracker)
                graph.tracker = graph.ros.start(ContourTrackerNode, params=params)
                graph.ros.spin_until(graph.rig.ready, what="the new tracker")
            stamp = start_s * SECOND + k * SECOND // 10
            if k < EMPTY:
                drops = graph.tracker.drops["background_frame"]
                graph.rig.send(view, stamp)
                graph.ros.spin_until(lambda d=drops: graph.tracker.drops["background_frame"] > d)
            else:
                send_until_seen(graph.ros, graph.rig, view, stamp)
        return contours_of(graph, start_s)

    params = settings | keep(tmp_path)
    graph = make_graph({"tracker": params})
    whole = run(graph, 100, None)
    assert graph.ros.call(*graph.rig.trigger("contour_tracker/reset")).success
    resumed = run(graph, 200, cut)
    assert sorted(resumed) == sorted(whole) == list(range(EMPTY, 9))
    for k, contours in whole.items():
        for name in ("uv", "loop", "sigma", "N"):
            np.testing.assert_array_equal(getattr(resumed[k], name), getattr(contours, name))


def test_a_tracker_keeps_no_more_than_its_last_states(make_graph, tmp_path):
    graph = make_graph({"tracker": keep(tmp_path)})
    send_until_seen(graph.ros, graph.rig, views()[0], 100 * SECOND)
    path, sizes, tracker = tmp_path / "contour_tracker.checkpoint", [], graph.tracker
    for k in range(1, 200):
        tracker._memory.keep(tracker._tracker, 100 * SECOND + k)
        sizes.append(path.stat().st_size)
    assert max(sizes) == max(sizes[:40]) < 30 * sizes[0]


def test_a_mesher_that_comes_back_colours_as_before(make_graph, tmp_path):
    params = STRIPS_ONLY | {"color": True} | keep(tmp_path)
    graph = make_graph({"mesher": params})
    ros, rig, frames = graph.ros, graph.rig, coloured_views()[:12]

    def surface(start_s):
        wanted = start_s * SECOND + 10 * SECOND // 10
        ros.spin_until(lambda: wanted in rig.stamps("strip"), what="the last strip")
        return graph.mesher._surface.whole()

    scan(ros, rig, frames, start_s=100, finish=False)
    whole = surface(100)
    for node in ("mesher", "contour_tracker", "reconstructor"):
        assert ros.call(*rig.trigger(f"{node}/reset")).success
    scan(ros, rig, frames[:7], start_s=200, finish=False)
    ros.spin_until(lambda: 200 * SECOND + 5 * SECOND // 10 in rig.stamps("strip"))
    ros.end(graph.mesher)
    graph.mesher = ros.start(MesherNode, params=params)
    assert len(graph.mesher.colours) == 7
    ros.spin_until(rig.ready, what="the graph")
    scan(ros, rig, frames[7:], start_s=200, step_ns=SECOND // 10, finish=False, first=7)
    resumed = surface(200)
    assert len(resumed) == len(whole) > 500
    np.testing.assert_array_equal(resumed.corners, whole.corners)
    np.testing.assert_array_equal(resumed.rgb, whole.rgb)
