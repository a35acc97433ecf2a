"""The reconstructor says what its rims tell of poses, calibration and outlines."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from exact_turns import exact_turn
from rclpy.node import Node
from recorded import real_frames
from rig import SECOND
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import Level, encode_contours
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.nodes.qos import reliable
from occ_recon_ros.nodes.reconstructor import ReconstructorNode

STEPS = 24


@pytest.fixture
def doubts(ros):
    """What the diagnostics of a reconstructor say after contours, and after ~/finish of them."""
    node = ros.start(ReconstructorNode)
    rig = ros.start(Node, "rig")
    contours = rig.create_publisher(PointCloud2, "contours", reliable(100))
    finish = rig.create_client(Trigger, "reconstructor/finish")
    ros.spin_until(contours.get_subscription_count, what="the node")

    def said(views, frames=None, finished=True):
        for k, view in enumerate(views):
            contours.publish(encode_contours(replace(view, stamp_ns=(k + 1) * SECOND)))
            came = lambda n=k + 1: node.figures()["frames"] + node.drops.total() == n  # noqa: E731
            ros.spin_until(came, what="the contours")
        if finished:
            assert ros.call(finish, Trigger.Request()).success
        sentences = list(node._watch.doubts(over=False))
        assert [Level.WARN] * len(sentences) == [
            level for level, words in node.problems(node._rates.counts) if words in sentences
        ]
        return "; ".join(sentences)

    return said


def turn(name="gourd", frames=STEPS, step=None):
    _, cameras, contours = exact_turn(name, frames, step=step, width=320)
    return cameras, contours


def about_z(camera, degrees):
    R = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return replace(camera, R_camera_object=camera.R_camera_object @ R.T)


def zoomed(k, camera, cameras):
    """What the camera was told to be when its zoom was turned: f of before."""
    return replace(camera, K=camera.K * [[0.8], [0.8], [1]]) if k >= STEPS // 2 else camera


WRONG = {
    "zoom": (zoomed, "fall outside the outlines of other views and are given up: the poses of"),
    "poses that jump": (
        lambda k, camera, _: about_z(camera, 25 * (k in (7, 16))),
        "fall outside the outlines of other views and are given up: the poses of some views, "
        "camera_info (zoom",
    ),
    "slip": (lambda k, camera, _: about_z(camera, 10 * (k >= STEPS // 2)), "fall outside"),
    "the other way": (lambda k, _, cameras: cameras[-k % STEPS], "turns the other way than"),
}


@pytest.mark.parametrize("name", WRONG)
def test_samples_that_are_given_up_in_numbers_are_a_doubt(doubts, name):
    change, words = WRONG[name]
    cameras, contours = turn()
    views = [seen_by(change(k, cameras[k], cameras), c) for k, c in enumerate(contours)]
    assert words in doubts(views)


@pytest.mark.parametrize(
    ("frames", "degrees"), [(360, 1), (36, 10), (18, 20)], ids=["1 deg", "10 deg", "20 deg"]
)
def test_a_right_turn_is_in_no_doubt(doubts, frames, degrees):
    _, contours = turn(frames=frames, step=np.deg2rad(degrees))
    assert doubts(contours[:45]) == ""


def test_a_recorded_turn_is_in_no_doubt(doubts, shared_data):
    tracker = ContourTracker()
    frames = list(real_frames(shared_data / "oxford_dino"))[::2]
    views = [tracker.process(i, c, k, "turntable", m) for k, (i, m, c) in enumerate(frames)]
    assert doubts(views) == ""


def test_a_camera_that_stands_while_the_object_turns(doubts):
    cameras, contours = turn()
    views = [seen_by(cameras[0], c) for c in contours[:8]]
    said = doubts(views, finished=False)
    assert "the camera does not move: the latest poses are of one place, though the out" in said


def test_an_encoder_that_stops_in_the_middle(doubts):
    cameras, contours = turn()
    views = [seen_by(cameras[min(k, 6)], c) for k, c in enumerate(contours[:14])]
    assert "the camera does not move: the latest poses" in doubts(views, finished=False)


def test_a_table_that_rests_in_the_middle_is_no_trouble(doubts):
    _, contours = turn()
    assert doubts([*contours[:7], *[contours[6]] * 7], finished=False) == ""


def test_poses_of_the_object_before_the_camera(doubts):
    cameras, contours = turn()
    inverse = [
        replace(c, R_camera_object=c.R_camera_object.T, t_camera_object=c.centre) for c in cameras
    ]
    views = [seen_by(c, view) for c, view in zip(inverse, contours, strict=True)]
    said = doubts(views, finished=False)
    assert "the camera does not move" in said
    assert "not the camera's in the frame that turns with the object" in said


def test_a_turn_without_a_good_point_is_said_before_it_is_finished(doubts):
    cameras, contours = turn()
    aside = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    wrong = [replace(c, R_camera_object=aside @ c.R_camera_object) for c in cameras]
    views = [seen_by(c, view) for c, view in zip(wrong, contours, strict=True)]
    assert "% of the samples are not found in the views beside" in doubts(views, finished=False)


def test_contours_that_do_not_come_are_said_after_some_looks(ros):
    node = ros.start(ReconstructorNode)
    looks = [list(node.problems(Counter())) for _ in range(6)]
    assert not any(looks[:4])
    assert "no contours on /contours" in looks[5][0][1]
    assert not list(node.problems(Counter(contours=1)))
