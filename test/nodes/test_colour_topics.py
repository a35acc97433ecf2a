"""Colour through the real nodes: from images on the topics to strips, mesh, marker and file."""

import numpy as np
import trimesh
from rclpy.qos import DurabilityPolicy, QoSProfile
from rig import SECOND, SMALL, scan, views
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from msg_adapters import Level, decode_strip
from occ_recon_ros.scene import RenderSettings, make_object, render, turntable_cameras

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def coloured_views():
    """A bluish vase before a bright backdrop."""
    vase, settings = make_object("vase"), RenderSettings(encoding="bgr8")
    return [(camera, render(vase, camera, settings)) for camera in turntable_cameras(SMALL)]


def bluish(rgb):
    """Share of colours that are the vase's, not the backdrop's."""
    rgb = rgb.reshape(-1, 3).astype(int)
    return ((rgb[:, 2] > rgb[:, 0] + 25) & (rgb[:, 0] < 150)).mean()


def test_the_surface_is_coloured_everywhere_it_is_sent_or_written(make_graph, tmp_path):
    path = tmp_path / "blue" / "mesh.ply"
    where = {"output_dir": str(tmp_path), "scan_name": "blue"}
    graph = make_graph({"mesher": {"color": True, "mesh_rate": 30.0, **where}})
    ros, rig = graph.ros, graph.rig
    meshes, markers = [], []
    rig.create_subscription(PointCloud2, "mesh", meshes.append, LATCHED)
    rig.create_subscription(Marker, "mesh_marker", markers.append, LATCHED)
    scan(ros, rig, coloured_views(), start_s=100)
    assert ros.call(*rig.trigger("mesher/save")).success
    ros.spin_until(lambda: meshes and markers, what="mesh and marker")
    strips = [decode_strip(msg) for msg in rig.got["strip"] if msg.height]
    assert len(strips) > 10
    for strip in strips:
        assert strip.rgb is not None
        assert bluish(strip.rgb) > 0.9
    whole = decode_strip(meshes[-1])
    assert bluish(whole.rgb) > 0.99
    assert len(markers[-1].colors) == len(markers[-1].points)
    saved = trimesh.load_mesh(path, process=False)
    assert bluish(np.asarray(saved.visual.vertex_colors)[:, :3]) > 0.99


def test_grey_images_give_no_colour_and_the_node_says_so(make_graph):
    graph = make_graph({"mesher": {"color": True}})
    scan(graph.ros, graph.rig, views()[:8], start_s=100)
    strips = [msg for msg in graph.rig.got["strip"] if msg.height]
    assert strips
    for msg in strips:
        assert "rgb" not in [field.name for field in msg.fields]
    report = graph.report(graph.mesher, lambda r: "grey" in r.message)
    assert report.level == Level.WARN


def test_a_new_scan_is_not_coloured_by_the_old_one(make_graph):
    graph = make_graph({"mesher": {"color": True}})
    scan(graph.ros, graph.rig, coloured_views()[:6], start_s=100)
    for node in ("mesher", "contour_tracker", "reconstructor"):
        assert graph.ros.call(*graph.rig.trigger(f"{node}/reset")).success
    assert not graph.mesher.colours
    red = [(camera, pixels[..., ::-1].copy()) for camera, pixels in coloured_views()[:6]]
    before = len(graph.rig.got["strip"])
    scan(graph.ros, graph.rig, red, start_s=200)
    late = [decode_strip(msg) for msg in graph.rig.got["strip"][before:] if msg.height]
    assert late[-1].stamp_ns >= 200 * SECOND
    assert bluish(late[-1].rgb[..., ::-1]) > 0.9
