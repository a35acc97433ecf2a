"""What is said of a body where only some images came with masks."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from occ_recon_ros.evaluation.advice import HIDDEN, of_remark
from occ_recon_ros.imaging.joint.judge import STRANGE
from occ_recon_ros.report.result import _bare, _lacking, _left_out, _strange
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface.covering import uncovered


def test_what_a_body_lacks_of_masks_that_came_is_told():
    cameras = turntable_cameras(TurntableSettings(frames=3, step=np.pi / 3))
    ball = make_object("sphere")
    contours = {k: ball.exact_contours(camera, 2.0, k) for k, camera in enumerate(cameras)}
    body = trimesh.creation.icosphere(4, radius=0.1)
    assert (uncovered(body, list(contours.values())) < 0.02).all()
    body.apply_scale(0.9)
    np.testing.assert_allclose(uncovered(body, list(contours.values())), 0.19, atol=0.03)
    heard, found = SimpleNamespace(contours=contours), SimpleNamespace(mesh=body)
    (words,) = _lacking(heard, {"masked_ns": [1, 7]}, found)
    assert words.startswith("the masks that came show ")
    assert _lacking(heard, {"masked_ns": [7]}, found) == []
    assert _lacking(heard, {}, found) == _lacking(heard, {"masked_ns": [1]}, None) == []


@pytest.mark.parametrize(("way", "asked"), [("single", True), ("given", True), ("joint", False)])
def test_masks_are_asked_for_by_name_where_none_were_found(way, asked):
    images = [{"name": f"{k}.jpg"} for k in range(4)]
    source = {"images": images, "segmentation": {"way": way, "without_masks": [1, 3]}}
    assert _bare(source) == "give masks for the other 2 images: 1.jpg, 3.jpg" * asked
    assert _bare({"segmentation": {"way": way}}) == ""


def test_images_that_show_nothing_are_to_be_left_out():
    bad = {2: "it shows no object; left out", 3: "it agrees with the others by 30% only; left out"}
    images = [{"name": f"{k}.jpg"} for k in range(4)]
    words = _bare({"images": images, "segmentation": {"way": "joint", "bad_views": bad}})
    assert words == "leave out the images that show no object, or take them again: 2.jpg"


def test_images_that_show_a_hand_are_to_be_left_out():
    bad = {1: "it shows no object; left out", 3: f"{STRANGE} that no other view shows (9%)"}
    images = [{"name": f"{k}.jpg"} for k in range(4)]
    source = {"images": images, "segmentation": {"way": "joint", "bad_views": bad}}
    (doubt,), notes = _strange(source, 4)
    assert doubt == f"{STRANGE} in 1 of 4 images: 3.jpg"
    assert of_remark(doubt, "") == HIDDEN
    assert not notes
    assert _strange(source, 30) == ([], [f"{STRANGE} in 1 of 30 images: 3.jpg: {HIDDEN}"])
    assert _strange({}, 4) == ([], [])


def test_views_that_were_left_out_are_no_empty_masks():
    hidden = "its mask lies on edges: left out; something is before the object"
    bad = {2: "it shows no object; left out", 3: hidden, 4: "lit otherwise: drawn there"}
    assert _left_out({"bad_views": bad}) == [3]
    assert _left_out({}) == []
