"""The three nodes in one process, over real topics."""

import numpy as np
import pytest
from rig import SMALL, Rig, scan, views

from msg_adapters import decode_rim, decode_stamp
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.scene import make_object


@pytest.fixture
def graph(ros):
    for kind in (ContourTrackerNode, ReconstructorNode, MesherNode):
        ros.start(kind)
    return ros


def test_a_full_turn_gives_a_rim_a_frame_and_a_strip_between_all(graph):
    rig = graph.start(Rig)
    scan(graph, rig, views())
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
