"""Scans begin, pause, jump, are saved and seen by those who come late."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from rclpy.parameter import Parameter
from rig import SECOND, scan, views
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from msg_adapters import decode_strip
from occ_recon_ros.nodes.qos import latched

HEARD_BY = {"contours": 3, "rim": 2}


def latest_mesh(graph, fits):
    """The whole mesh as a viewer gets it who comes only now."""
    seen = []
    viewer = graph.rig.create_subscription(PointCloud2, "mesh", seen.append, latched())
    graph.ros.spin_until(lambda: seen and fits(decode_strip(seen[-1])), what="the mesh")
    graph.rig.destroy_subscription(viewer)
    return decode_strip(seen[-1])


def settled_mesh(graph, frames):
    """The mesh when all rims are in it; after ``~/finish`` some come a second time."""
    sender = graph.reconstructor
    graph.ros.spin_until(
        lambda: graph.mesher.loss.last("rim") == sender._sent + len(sender._rims), what="all rims"
    )
    assert len(graph.mesher._surface._placed) == frames
    whole = as_set(graph.mesher._surface.whole().corners)
    return latest_mesh(graph, lambda mesh: as_set(mesh.corners) == whole)


def as_set(corners):
    return {triangle.tobytes() for triangle in corners}


def test_the_mesh_is_all_strips_together_soon_after_the_last(graph):
    scan(graph.ros, graph.rig, views())
    triangles = graph.rig.triangles()
    mesh = latest_mesh(graph, lambda mesh: len(mesh) == len(triangles))
    np.testing.assert_array_equal(mesh.corners, triangles)
    assert mesh.frame_id == "turntable"


def test_the_mesh_is_published_at_most_mesh_rate_times_a_second(make_graph):
    graph = make_graph({"mesher": {"mesh_rate": 0.01}})
    meshes = []
    graph.rig.create_subscription(PointCloud2, "mesh", meshes.append, latched())
    scan(graph.ros, graph.rig, views()[:8])
    graph.settle()
    assert len(meshes) == 1  # the first strip's; the next is due in 100 s


def test_the_marker_is_made_for_those_who_look_and_thinned(make_graph):
    graph = make_graph({"mesher": {"marker_triangles": 50, "mesh_rate": 30.0}})
    scan(graph.ros, graph.rig, views()[:6])
    graph.settle()
    assert not graph.mesher.stages["marker"]
    seen = []
    graph.rig.create_subscription(Marker, "mesh_marker", seen.append, latched())
    graph.ros.spin_until(lambda: seen, what="a marker, although no rim comes any more")
    assert (seen[-1].action, len(seen[-1].points)) == (Marker.ADD, 150)
    assert graph.ros.call(*graph.rig.trigger("mesher/reset")).success
    graph.ros.spin_until(lambda: seen[-1].action == Marker.DELETE)


def test_save_writes_what_is_there_in_the_middle_of_a_scan(make_graph, tmp_path):
    path = tmp_path / "half" / "mesh.ply"
    graph = make_graph({"mesher": {"output_dir": str(tmp_path), "scan_name": "half"}})
    answer = graph.ros.call(*graph.rig.trigger("mesher/save"))
    assert not answer.success
    assert "no triangles" in answer.message
    assert not path.exists()
    scan(graph.ros, graph.rig, views()[:8], finish=False)
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == 6)
    answer = graph.ros.call(*graph.rig.trigger("mesher/save"))
    count = len(graph.rig.triangles())
    assert answer.success
    assert answer.message == f"{path}: {count} triangles from 6 rims"
    assert len(trimesh.load_mesh(path).faces) == count
    scan(graph.ros, graph.rig, views()[8:10], start_s=101, finish=False)
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == 8)
    assert graph.ros.call(*graph.rig.trigger("mesher/save")).success
    assert len(trimesh.load_mesh(path).faces) == len(graph.rig.triangles()) > count
    assert [p.name for p in path.parent.iterdir()] == ["mesh.ply"]


def test_while_paused_rims_are_dropped_by_name_and_nothing_wrong_is_joined_after(graph):
    scan(graph.ros, graph.rig, views()[:6], finish=False)
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == 4)
    assert graph.ros.call(*graph.rig.set_bool("mesher/pause", True)).success
    for k in (6, 7, 8):
        graph.rig.send(views()[k], 100 * SECOND + k * SECOND // 10)
        graph.settle()
    assert graph.mesher.drops == {"paused": 3}
    assert graph.report(graph.mesher).message.startswith("paused")
    assert graph.ros.call(*graph.rig.set_bool("mesher/pause", False)).success
    for k in (9, 10, 11):
        graph.rig.send(views()[k], 100 * SECOND + k * SECOND // 10)
        graph.settle()
    graph.ros.spin_until(lambda: len(graph.rig.got["strip"]) == 7)
    heights = [msg.height for msg in graph.rig.got["strip"]]
    # The first rim after the pause has no neighbour, the next ones have.
    assert [bool(h) for h in heights] == [False, True, True, True, False, True, True]


def test_time_that_jumps_back_begins_a_new_scan_and_keeps_the_old_mesh_meanwhile(make_graph):
    graph = make_graph({"mesher": {"mesh_rate": 30.0}})
    scan(graph.ros, graph.rig, views()[:9], start_s=100)
    first = settled_mesh(graph, 9).corners
    for messages in graph.rig.got.values():
        messages.clear()

    shown = []
    graph.rig.create_subscription(PointCloud2, "mesh", shown.append, latched())
    graph.ros.spin_until(lambda: shown, what="the mesh of the first scan")

    # A bag that loops: the same stamps again, another object.
    frames = views(name="torus")[:9]
    for k, view in enumerate(frames):
        graph.rig.send(view, stamp := 100 * SECOND + k * SECOND // 10)
        graph.settle(12)
        if k >= 3:  # so many are put aside until it is clear that time went back
            graph.ros.spin_until(lambda s=stamp: s in graph.rig.stamps("contours"))
    graph.ros.spin_until(lambda: graph.reconstructor.figures()["frames"] == len(frames))
    assert graph.ros.call(*graph.rig.trigger("reconstructor/finish")).success
    looped = settled_mesh(graph, len(frames))
    assert not as_set(looped.corners) & as_set(first)
    # Until the new scan has a triangle the old mesh stays: who looks never sees nothing.
    whole = as_set(first)
    meshes = [as_set(decode_strip(msg).corners) for msg in shown]
    assert meshes[0] == whole
    assert all(mesh and (mesh == whole or not mesh & whole) for mesh in meshes)
    assert not graph.tracker.drops + graph.reconstructor.drops + graph.mesher.drops

    # It is the mesh that a fresh scan of the torus gives.
    for node in ("contour_tracker", "reconstructor", "mesher"):
        assert graph.ros.call(*graph.rig.trigger(f"{node}/reset")).success
    for messages in graph.rig.got.values():
        messages.clear()
    scan(graph.ros, graph.rig, frames, start_s=500)
    fresh = settled_mesh(graph, len(frames))
    assert as_set(looped.corners) == as_set(fresh.corners)


def test_finish_without_a_scan_says_so(graph):
    answer = graph.ros.call(*graph.rig.trigger("reconstructor/finish"))
    assert not answer.success
    assert "no contours" in answer.message


def test_many_rims_at_once_all_arrive(graph):
    """More than the queues of the topics hold: a slow turn owes many rims at its end."""
    scan(graph.ros, graph.rig, views(), finish=False)
    rims = list(graph.reconstructor._reconstructor.finish())
    graph.settle()
    before = len(graph.rig.got["rim"])
    many = [replace(rims[0], stamp_ns=rims[0].stamp_ns + k + 1) for k in range(80)]
    graph.reconstructor._queue(many)
    graph.ros.spin_until(lambda: len(graph.rig.got["rim"]) == before + 80)
    graph.ros.spin_until(lambda: graph.mesher.figures()["rims"] >= 80)
    assert not graph.mesher.drops


def test_a_settings_change_waits_for_the_next_scan(graph):
    scan(graph.ros, graph.rig, views()[:2], finish=False)
    (result,) = graph.tracker.set_parameters([Parameter("spacing_px", value=4.0)])
    assert result.successful
    scan(graph.ros, graph.rig, views()[2:4], start_s=200, finish=False)
    assert graph.ros.call(*graph.rig.trigger("contour_tracker/reset")).success
    scan(graph.ros, graph.rig, views()[:1], start_s=300, finish=False)
    widths = [msg.width for msg in graph.rig.got["contours"]]
    assert widths[4] < 0.4 * widths[0]
    assert widths[3] > 0.8 * widths[0]


@pytest.mark.parametrize("topic", ["contours", "rim"])
def test_messages_of_another_frame_are_dropped_by_name(graph, topic):
    scan(graph.ros, graph.rig, views()[:6], finish=False)
    graph.settle()
    message = graph.rig.got[topic][-1]
    message.header.frame_id = "world"
    message.header.stamp.sec += 50
    publisher = graph.rig.create_publisher(PointCloud2, topic, 10)
    graph.ros.spin_until(lambda: publisher.get_subscription_count() == HEARD_BY[topic])
    publisher.publish(message)
    node = {"contours": graph.reconstructor, "rim": graph.mesher}[topic]
    graph.ros.spin_until(lambda: node.drops)
    assert node.drops == {f"{topic}_frame": 1}


def test_empty_clouds_that_say_nothing_are_dropped_by_name(graph):
    scan(graph.ros, graph.rig, views()[:6], finish=False)
    graph.settle()
    contours, rim = graph.rig.got["contours"][-1], graph.rig.got["rim"][-1]
    for topic, message, node in (
        ("contours", contours, graph.reconstructor),
        ("rim", rim, graph.mesher),
    ):
        message.width, message.row_step, message.data = 0, 0, []
        message.header.stamp.sec += 50
        publisher = graph.rig.create_publisher(PointCloud2, topic, 10)
        graph.ros.spin_until(lambda p=publisher, t=topic: p.get_subscription_count() == HEARD_BY[t])
        publisher.publish(message)
        graph.ros.spin_until(lambda n=node: n.drops)
        assert node.drops == {f"empty_{topic}": 1}
