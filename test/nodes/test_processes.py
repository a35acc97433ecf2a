"""Three processes make the mesh that one makes."""

import signal
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from rig import NODES, PARAMS, SECOND, SMALL, STRIPS, Rig, scan, views


def full_hd_colour():
    """1920x1080 bgr8: 6.2 MB an image, far above what Fast DDS carries unaided."""
    settings = replace(SMALL, frames=6, width=1920, height=1080, focal_px=1800.0)
    return [(camera, cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)) for camera, grey in views(settings)]


@pytest.mark.parametrize("frames", [views, pytest.param(full_hd_colour, marks=pytest.mark.slow)])
def test_three_processes_make_the_same_mesh_as_one(ros, frames):
    frames = frames()
    rig = ros.start(Rig)
    own = [ros.start(k, params=PARAMS.get(name)) for name, k in NODES.items()]
    scan(ros, rig, frames)
    alone = rig.triangles()
    for node in own:
        ros.end(node)
    ros.end(rig)

    rig = ros.start(Rig)
    for name in NODES:
        ros.process(name, *(STRIPS if name == "mesher" else ()))
    ros.spin_until(rig.joined, timeout=180, what="the three processes to find each other")
    scan(ros, rig, frames)
    assert len(alone) > 1000
    np.testing.assert_array_equal(rig.triangles(), alone)


def test_a_listener_that_hangs_does_not_hold_back_the_rims(ros, graph):
    hung = ros.process("mesher")
    ros.spin_until(lambda: graph.reconstructor.count_subscribers("rim") == 3, what="the listener")
    hung.send_signal(signal.SIGSTOP)
    try:
        scan(ros, graph.rig, views())
    finally:
        hung.send_signal(signal.SIGCONT)
    assert len(graph.rig.got["rim"]) >= len(views())


@pytest.mark.slow
@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_with_exit_code_0(ros, name, number):
    watcher = ros.start(Rig)
    child = ros.process(name)
    ros.spin_until(
        lambda: name in [n for n, _ in watcher.get_node_names_and_namespaces()], what=name
    )
    # Discovered is not yet spinning: an answered service is.
    ros.call(*watcher.trigger(f"{name}/reset"))
    child.send_signal(number)
    output = child.communicate(timeout=120)[0]
    assert child.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("-p", "mesh_rate:=0.0"), "mesh_rate: must be 0.01 to 30.0, got 0.0"),
        (("-p", "mesh_rate:=fast"), "mesh_rate: must be a number, got 'fast'"),
        (("--params-file", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_bad_arguments_end_a_node_with_one_line_and_exit_code_2(ros, arguments, says):
    child = ros.process("mesher", *arguments)
    output = child.communicate(timeout=120)[0]
    assert child.returncode == 2, output
    errors = [line for line in output.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert says in errors[0]
    assert "Traceback" not in output


def test_a_signal_saves_the_mesh(ros, tmp_path):
    path = tmp_path / "vase" / "mesh.ply"
    rig = ros.start(Rig)
    for name in ("contour_tracker", "reconstructor"):
        ros.start(NODES[name])
    save = [
        "-p",
        "finish_when_closed:=false",
        "-p",
        f"output_dir:={tmp_path}",
        "-p",
        "scan_name:=vase",
    ]
    child = ros.process("mesher", *save)
    ros.spin_until(rig.joined, timeout=180, what="the mesher")
    scan(ros, rig, views(), finish=False)
    last = 100 * SECOND + (len(views()) - 2) * SECOND // 10  # that of the last frame is owed
    ros.spin_until(lambda: last in rig.stamps("strip"), what="the last strip")
    child.terminate()
    output = child.communicate(timeout=120)[0]
    assert child.returncode == 0, output
    assert "error" not in output.lower()
    assert f"{path}: {len(rig.triangles())} triangles" in output
    assert len(trimesh.load_mesh(path).faces) == len(rig.triangles())
