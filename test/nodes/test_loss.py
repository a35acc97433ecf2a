"""One frame in ten is lost: what is left is joined over the gaps, and rightly."""

from dataclasses import replace

import numpy as np
import pytest
from rig import SECOND, SMALL, send_until_seen, views

from occ_recon_ros.scene import make_object

FRAMES = 60
STEP = 2 * np.pi / FRAMES
TURN = replace(SMALL, frames=FRAMES, step=STEP)


def lossy_scan(graph, name, seed):
    """Scan a turn of which each frame loses one of its three messages with a chance of 0.1.

    Returns:
        The numbers of the frames that were whole, and the triangles.
    """
    rig, rng = graph.rig, np.random.default_rng(seed)
    lost = rng.random(FRAMES) < 0.1
    for k, view in enumerate(views(TURN, name)):
        stamp = 100 * SECOND + k * SECOND // 10
        if lost[k]:
            rig.send(view, stamp, parts=rng.permutation(("info", "pose", "image"))[:2])
        else:
            send_until_seen(graph.ros, rig, view, stamp)
    whole = np.flatnonzero(~lost)
    graph.ros.spin_until(lambda: graph.reconstructor.figures()["frames"] == len(whole))
    assert graph.ros.call(*rig.trigger("reconstructor/finish")).success
    graph.ros.spin_until(lambda: len(rig.got["strip"]) == len(whole))
    assert sum(graph.tracker.drops.values()) in (np.count_nonzero(lost), np.count_nonzero(lost) - 1)
    return whole, rig.triangles()


def widest_hole(triangles, heights):
    """The widest angle about z that horizontal cuts through the triangles lack, radians."""
    worst = 0.0
    for height in heights:
        z = triangles[:, :, 2] - height
        cut = triangles[(z.min(axis=1) < 0) & (z.max(axis=1) > 0)]
        angle = np.arctan2(cut[:, :, 1], cut[:, :, 0])
        start = angle[:, 0] + np.minimum(0, wrapped(angle - angle[:, :1])).min(axis=1)
        end = angle[:, 0] + np.maximum(0, wrapped(angle - angle[:, :1])).max(axis=1)
        order = np.argsort(start)
        start, end = start[order], np.maximum.accumulate(end[order])
        if not len(start):
            return 2 * np.pi
        gaps = np.append(start[1:], start[0] + 2 * np.pi) - end
        worst = max(worst, float(gaps.max()))
    return worst


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vase", "torus"])
def test_frames_lost_at_random_leave_no_hole_and_no_wrong_triangle(graph, name):
    body = make_object(name)
    whole, triangles = lossy_scan(graph, name, seed=0)
    gap = STEP * np.diff(np.append(whole, whole[0] + FRAMES)).max()
    assert gap > 2 * STEP
    z = body.surface_samples(64)[0][:, 2]
    assert widest_hole(triangles, np.quantile(z, [0.2, 0.4, 0.6, 0.8, 0.9])) < gap + STEP
    # Corners lie on the surface, and the rest no deeper than a chord over the widest gap may.
    corners, middles = np.unique(triangles.reshape(-1, 3), axis=0), triangles.mean(axis=1)
    radius = np.linalg.norm(corners[:, :2], axis=1).max()
    chord = radius * (1 - np.cos(gap / 2))
    assert np.abs(body.distance(corners)).max() < 2.5e-4  # a tenth of a pixel
    assert np.abs(body.distance(middles)).max() < chord + 2.5e-4
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    outward, _ = body.shape(middles)
    assert (np.einsum("ij,ij->i", across, outward) > 0).all()
