"""A node that is killed and started again goes on with the scan."""

import time

import numpy as np
import pytest
from rig import NODES, PARAMS, SECOND, STRIPS, STRIPS_ONLY, Rig, send_until_seen, views
from sensor_msgs.msg import PointCloud2

from msg_adapters import Level, decode_strip
from occ_recon_ros.nodes.qos import latched
from occ_recon_ros.scene import make_object

STEP = SECOND // 10
OUTPUTS = {"contour_tracker": ("contours", 3), "reconstructor": ("rim", 2), "mesher": ("strip", 1)}
"""What a node sends, and to how many: the next nodes, and the rig."""
DEAD = {"contour_tracker": 5, "reconstructor": 9, "mesher": 13}
"""The frame that comes while a node is dead."""


def stamp(frame):
    return 100 * SECOND + frame * STEP


def as_set(corners):
    return {triangle.tobytes() for triangle in corners}


def wait_for_mesh(ros, rig, fits):
    """Until the whole mesh, as a set of triangles, fits."""
    seen = []
    viewer = rig.create_subscription(PointCloud2, "mesh", seen.append, latched())
    ros.spin_until(
        lambda: seen and fits(as_set(decode_strip(seen[-1]).corners)), what="the right mesh"
    )
    rig.destroy_subscription(viewer)


def undisturbed(ros, skipped):
    """Mesh, and strips by frame, of a scan in one process that lacks some frames."""
    rig = ros.start(Rig)
    nodes = [ros.start(kind, params=PARAMS.get(name)) for name, kind in NODES.items()]
    ros.spin_until(rig.ready, what="the graph")
    for k in sorted(set(range(len(views()))) - skipped):
        send_until_seen(ros, rig, views()[k], stamp(k))
    finish(ros, rig, skipped)
    for _ in range(50):
        ros.executor.spin_once(timeout_sec=0.01)
    strips = [decode_strip(msg) for msg in rig.got["strip"]]
    mesh = nodes[-1]._whole().corners
    for node in [*nodes, rig]:
        ros.end(node)
    return mesh, {(strip.stamp_ns - stamp(0)) // STEP: strip.corners for strip in strips}


def finish(ros, rig, skipped):
    """Close the turn when all contours have come to the reconstructor."""
    frames = sorted(set(range(len(views()))) - skipped)
    wanted = {stamp(k) for k in frames[1:-1]}
    ros.spin_until(lambda: wanted <= rig.stamps("rim"), what="the rims on the way")
    answer = ros.call(*rig.trigger("reconstructor/finish"))
    assert answer.success, answer.message
    ends = {stamp(frames[0]), stamp(frames[-1])}
    ros.spin_until(lambda: ends <= rig.stamps("strip"), what="the last strips")


def counts_as_there(killed):
    """Whether one that was killed then is still counted, as every participant is for 20 s."""
    return time.monotonic() - killed < 25


def restart(ros, rig, name, start):
    """Start a node that was killed; wait until its neighbours have it, and it has them."""
    killed = time.monotonic()
    rig.reports.clear()
    start(name)
    before = {"reconstructor": "contour_tracker", "mesher": "reconstructor"}.get(name)

    def subscribers(node):
        report = rig.reports.get(f"/{node}")
        return int(report.values[f"{OUTPUTS[node][0]} subscribers"]) if report else 0

    def joined():
        dead = counts_as_there(killed)
        if before is None:
            heard = rig.image.get_subscription_count() == 1 + dead
        else:
            heard = subscribers(before) == OUTPUTS[before][1] + dead
        return heard and subscribers(name) == OUTPUTS[name][1]

    ros.spin_until(joined, timeout=180, what=f"the new {name}")


@pytest.mark.slow
def test_each_node_may_be_killed_in_the_middle_of_a_scan(ros, tmp_path):
    unseen = {DEAD["contour_tracker"], DEAD["reconstructor"]}
    mesh, strips = undisturbed(ros, unseen)

    keep = ["-p", "checkpoint_every:=1", "-p", f"checkpoint_path:={tmp_path}", "-p", "resume:=true"]
    children = {}

    def start(name):
        arguments = list(keep)
        arguments += STRIPS if name == "mesher" else []
        children[name] = ros.process(name, *arguments)

    rig = ros.start(Rig)
    for name in NODES:
        start(name)
    ros.spin_until(rig.joined, timeout=180, what="the three processes")
    ros.spin_until(rig.ready, what="the graph")
    by_frame = {frame: name for name, frame in DEAD.items()}
    for k, view in enumerate(views()):
        name = by_frame.get(k)
        if name is None:
            send_until_seen(ros, rig, view, stamp(k))
            continue
        # All that the frames so far gave has come.
        ros.spin_until(lambda k=k: stamp(k - 2) in rig.stamps("strip"), what="the last strip")
        children[name].kill()
        children[name].wait()
        if name == "contour_tracker":
            rig.send(view, stamp(k))
        else:
            send_until_seen(ros, rig, view, stamp(k))
        if name == "mesher":
            ros.spin_until(lambda k=k: stamp(k - 1) in rig.stamps("rim"), what="a rim for nobody")
        restart(ros, rig, name, start)
    finish(ros, rig, unseen)

    # The rim of the frame before came when the mesher was dead: two strips hang on it.
    lost = DEAD["mesher"] - 1
    dead = as_set(strips[lost]) | as_set(strips[lost + 1])
    assert len(dead) < 0.15 * len(mesh)
    whole = as_set(mesh)
    wait_for_mesh(ros, rig, lambda got: whole - dead <= got <= whole)


@pytest.mark.parametrize("name", ["reconstructor", "mesher"])
def test_without_a_checkpoint_a_node_that_comes_back_says_what_is_missing(make_graph, name):
    """It begins with nothing, what it makes is right, and diagnostics tell."""
    graph = make_graph()
    ros, rig = graph.ros, graph.rig
    whole, half = range(len(views())), len(views()) // 2
    for k in whole[:half]:
        send_until_seen(ros, rig, views()[k], stamp(k))
    ros.spin_until(lambda: stamp(half - 2) in rig.stamps("strip"), what="half the strips")
    first = as_set(rig.triangles())
    ros.end(getattr(graph, name))
    rig.got["strip"].clear()
    again = ros.start(NODES[name], params=PARAMS.get(name))
    ros.spin_until(rig.ready, what="the graph")
    for k in whole[half:]:
        send_until_seen(ros, rig, views()[k], stamp(k))
    assert ros.call(*rig.trigger("reconstructor/finish")).success
    ros.spin_until(lambda: stamp(whole[-1]) in rig.stamps("strip"), what="the last strip")

    second = rig.triangles()
    assert len(second) > 0.5 * len(first)
    distance = make_object("vase").distance(second.reshape(-1, 3))
    assert distance.max() < 2e-4
    steps = np.linalg.norm(second - np.roll(second, 1, axis=1), axis=2)
    assert steps.max() < 0.06  # from rim to rim; nothing is joined across the gap
    topic = {"reconstructor": "contours", "mesher": "rims"}[name]
    report = graph.report(again)
    assert report.level == Level.WARN
    assert f" {topic} were sent before this node began" in report.message


@pytest.mark.slow
def test_run_goes_on_with_a_scan_after_a_crash(ros, tmp_path):
    mesh, _ = undisturbed(ros, skipped=set())
    params = tmp_path / "rig.yaml"
    state = tmp_path / "state"
    params.write_text(
        f"/**:\n  ros__parameters:\n    checkpoint_every: 4\n    checkpoint_path: {state}\n"
        "/**/mesher:\n  ros__parameters:\n"
        + "".join(f"    {k}: {str(v).lower()}\n" for k, v in STRIPS_ONLY.items())
    )
    rig = ros.start(Rig)
    child = ros.command("run", "--params", params, one_pipe=True)
    ros.spin_until(lambda: rig.ready() and rig.joined(), timeout=180, what="the nodes")
    for k in range(9):
        send_until_seen(ros, rig, views()[k], stamp(k))
    ros.spin_until(lambda: stamp(7) in rig.stamps("strip"), what="the strips so far")
    child.kill()
    child.wait()
    killed = time.monotonic()
    rig.reports.clear()
    ros.command("run", "--resume", state, "--params", params, one_pipe=True)

    def joined():
        heard = rig.image.get_subscription_count() == 1 + counts_as_there(killed)
        return heard and rig.joined()

    ros.spin_until(joined, what="the new nodes")
    for k in range(9, 18):
        send_until_seen(ros, rig, views()[k], stamp(k))
    finish(ros, rig, set())
    wait_for_mesh(ros, rig, lambda got: got == as_set(mesh))


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "no checkpoints there"), (b"ply\n", "is not a checkpoint of reconstructor")],
)
def test_a_state_that_cannot_be_resumed_is_one_line(ros, tmp_path, content, says):
    if content is not None:
        (tmp_path / "reconstructor.checkpoint").write_bytes(content)
    child = ros.command("run", "--resume", tmp_path, one_pipe=True)
    output = child.communicate(timeout=120)[0]
    assert child.returncode == 2, output
    assert output.count("\n") == 1
    assert says in output
