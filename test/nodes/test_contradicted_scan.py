"""Scans whose views contradict each other until no strip is left: what there is is saved."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from exact_turns import exact_turn
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import encode_contours, encode_rim
from occ_recon_ros.geometry import RimReconstructor, Status
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.qos import reliable

PARAMS = {"finish_when_closed": False, "close_body": True, "body_cells": 40, "closed_preview": 0.0}


def outside(rim):
    """As it comes again where another view shows none of the object."""
    return replace(rim, status=np.full(len(rim), Status.OUTSIDE, np.uint8))


@pytest.fixture
def heard(ros, tmp_path):
    """A mesher that has heard the contours of a turn and rims of them."""

    def start(change, frames=12, step=None):
        output = {"output_dir": str(tmp_path), "scan_name": "one"}
        mesher = ros.start(MesherNode, params={**PARAMS, **output})
        rig = ros.start(Node, "rig")
        topics = [rig.create_publisher(PointCloud2, t, reliable(100)) for t in ("contours", "rim")]
        ros.spin_until(lambda: all(t.get_subscription_count() for t in topics))
        _, _, contours = exact_turn("vase", frames, step=step, width=320)
        rims = RimReconstructor()
        made = [rim for c in contours for rim in rims.add(c)] + list(rims.finish())
        for one in contours:
            topics[0].publish(encode_contours(one))
        for one in made:
            topics[1].publish(encode_rim(change(one)))
        ros.spin_until(lambda: mesher.keeper.scan.report.frames == frames, what="the rims")
        mesher.rims = made
        return mesher, lambda: ros.call(
            rig.create_client(Trigger, "mesher/finish"), Trigger.Request()
        )

    return start


def bodies(folder):
    body = trimesh.load_mesh(folder / "closed.ply", process=False)
    assert body.is_watertight
    return body


def test_a_turn_without_a_strip_is_saved_as_its_body(heard, tmp_path):
    _, finish = heard(outside)
    answer = finish()
    assert answer.success, answer.message
    assert bodies(tmp_path / "one").volume > 0
    assert f"{tmp_path / 'one' / 'closed.ply'}: watertight" in answer.message
    assert "turn further" not in answer.message
    assert "; 100% of the samples fall outside the outlines of others" in answer.message
    assert "no strips: 100% of the samples fall outside" not in answer.message  # said by whom asked
    assert not (tmp_path / "one" / "mesh.ply").exists()


def test_strips_that_the_last_rims_take_back_are_saved_as_they_were(heard, tmp_path):
    mesher, finish = heard(lambda rim: rim)
    triangles = len(mesher._surface)

    async def last_rims():
        for rim in mesher.rims:
            mesher._revise(outside(rim))
        return ""

    mesher.keeper._upstream.last_rims = last_rims
    answer = finish()
    assert answer.success, answer.message
    assert not len(mesher._surface)
    assert len(trimesh.load_mesh(tmp_path / "one" / "mesh.ply").faces) == triangles
    assert f"those before the last rims: {triangles} of these triangles" in answer.message
    assert bodies(tmp_path / "one").volume > 0


def test_rims_of_the_next_object_are_not_in_the_files_of_the_one_before(heard, tmp_path):
    mesher, finish = heard(lambda rim: rim)
    triangles, body = len(mesher._surface), mesher.keeper._body
    closed = body.made

    async def made(*what):
        for rim in mesher.rims[:3]:
            mesher._add(replace(rim, stamp_ns=rim.stamp_ns + 1000))
        return await closed(*what)

    body.made = made
    answer = finish()
    assert answer.success, answer.message
    assert f"{triangles} triangles from 12 rims" in answer.message
    assert len(trimesh.load_mesh(tmp_path / "one" / "mesh.ply").faces) == triangles
    assert mesher.keeper.scan.unsaved
    assert mesher.keeper.save()  # beside it
    assert (tmp_path / "one" / "mesh.previous.ply").exists()


@pytest.mark.parametrize("frames", [6, 12])
def test_ctrl_c_saves_the_body_of_a_scan_without_strips(heard, ros, tmp_path, capfd, frames):
    mesher, _ = heard(outside, frames, step=np.pi / 6)
    ros.end(mesher)
    assert "the body is saved" in capfd.readouterr().err
    assert bodies(tmp_path / "one").volume > 0
    assert not mesher.lost


def test_a_scan_of_which_nothing_can_be_saved_says_so_in_the_exit_code(heard, ros, capfd):
    mesher, finish = heard(outside, 3, step=1e-3)
    assert not finish().success
    ros.end(mesher)
    assert "error: one is not saved: no strips" in capfd.readouterr().err
    assert mesher.lost
