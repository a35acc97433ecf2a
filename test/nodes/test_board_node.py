"""board_pose over its real topics: poses, masks, and what it says where there are none."""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rig import SECOND, Rig
from sensor_msgs.msg import Image

from msg_adapters import decode_contours, decode_mask, decode_pose, encode_camera_info, encode_image
from msg_adapters.pose import decode_pose_covariance, encode_pose_covariance
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.nodes import board_pose
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.poses import board_to_yaml
from occ_recon_ros.poses.projection import difference

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "poses"))

from rendered import CHARUCO, photograph, view

_images: dict = {}


def disc(camera, share=0.3):
    """An object before the board: a disc that hides a part of it."""
    uv = camera.project(CHARUCO.corners)
    middle = uv.mean(axis=0) - [0, 20]
    radius = np.quantile(np.linalg.norm(uv - middle, axis=1), share)
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.hypot(u - middle[0], v - middle[1]) < radius


def frame(k):
    """A camera, its image of board and object, and the object's mask."""
    if k not in _images:
        camera = view(0.3 * k, 0.8, f=600.0, size=(640, 480), distance=0.45)
        hide = disc(camera)
        grey = photograph(CHARUCO, camera, hide=hide, samples=3, seed=k)
        red = cv2.GaussianBlur(hide.astype(np.float32), (0, 0), 0.8)[..., None]
        image = grey[..., None] * (1 - red) + red * np.array([60.0, 90.0, 190.0])
        _images[k] = camera, np.rint(image).astype(np.uint8), hide
    return _images[k]


@pytest.fixture
def board(tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(board_to_yaml(CHARUCO))
    return str(path)


class BoardRig(Rig):
    """Sends images and calibration alone; collects poses and masks."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.destroy_publisher(self.pose)
        self.poses, self.covariances, self.masks = {}, {}, {}
        self.create_subscription(PoseStamped, "camera_pose", self._on_pose, 100)
        self.create_subscription(
            PoseWithCovarianceStamped, "camera_pose_cov", self._on_covariance, 100
        )
        self.create_subscription(Image, "mask", self._on_mask, self.image.qos_profile)

    def _on_pose(self, msg):
        self.poses[msg.header.stamp.sec] = (msg.header.frame_id, decode_pose(msg))

    def _on_covariance(self, msg):
        self.covariances[msg.header.stamp.sec] = decode_pose_covariance(msg)

    def _on_mask(self, msg):
        self.masks[msg.header.stamp.sec] = decode_mask(msg)

    def show(self, camera, pixels, second):
        self.info.publish(encode_camera_info(camera, second * SECOND, "camera"))
        self.image.publish(encode_image(pixels, second * SECOND, "camera"))


@pytest.fixture
def started(ros, board):
    node = ros.start(BoardPoseNode, params={"board": board})
    rig = ros.start(BoardRig)
    ros.spin_until(
        lambda: rig.image.get_subscription_count() and rig.info.get_subscription_count(),
        what="the node",
    )
    return ros, node, rig


def test_each_image_gets_the_pose_it_was_taken_from(started) -> None:
    ros, node, rig = started
    for k in range(4):
        camera, pixels, hide = frame(k)
        rig.show(camera, pixels, 10 + k)
        ros.spin_until(lambda k=k: 10 + k in rig.masks, what="a pose and a mask")
        name, pose = rig.poses[10 + k]
        error = difference(pose, camera.pose)
        covariance = rig.covariances[10 + k]
        assert name == "turntable"
        assert error @ np.linalg.solve(covariance, error) < 6 * 2.5**2
        # Rings of a pixel around the outline are left to the tracker.
        found = rig.masks[10 + k] > 0
        assert np.count_nonzero(found ^ hide) < 0.06 * np.count_nonzero(hide)
    assert not node.drops
    told = node.figures()
    plotted = [value for name, value in told.items() if name != "board"]
    assert all(isinstance(value, (int, float)) for value in plotted)
    assert 0 < told["reprojection error px"] < 1
    assert 4 <= told["corners used"] <= told["corners found"]


def test_the_outline_of_the_object_becomes_contours_and_the_board_does_not(ros, board) -> None:
    tracker = ros.start(ContourTrackerNode)
    ros.start(BoardPoseNode, params={"board": board})
    rig = ros.start(BoardRig)
    ros.spin_until(lambda: tracker.count_publishers("mask") == 1, what="the graph")
    ros.spin_until(lambda: rig.image.get_subscription_count() == 2, what="the graph")
    camera, pixels, hide = frame(1)
    rig.show(camera, pixels, 50)
    ros.spin_until(lambda: rig.got["contours"], what="contours")
    contours = decode_contours(rig.got["contours"][0])
    v, u = np.nonzero(hide)
    middle, radius = np.array([u.mean(), v.mean()]), np.sqrt(hide.sum() / np.pi)
    off = np.linalg.norm(contours.uv - middle, axis=1) - radius
    assert np.quantile(np.abs(off), 0.95) < 3
    assert np.median(np.abs(off)) < 1
    assert len(np.unique(contours.loop)) == 1


@pytest.mark.slow
def test_what_the_board_cannot_keep_up_with_is_dropped_there_and_the_rest_become_contours(
    ros, board, monkeypatch
) -> None:
    cut_out = board_pose.object_mask

    def slow(*args):
        time.sleep(0.3)
        return cut_out(*args)

    monkeypatch.setattr(board_pose, "object_mask", slow)
    tracker = ros.start(ContourTrackerNode)
    node = ros.start(BoardPoseNode, params={"board": board})
    rig = ros.start(BoardRig)
    ros.spin_until(lambda: tracker.count_publishers("mask") == 1, what="the graph")
    ros.spin_until(lambda: rig.image.get_subscription_count() == 2, what="the graph")
    sent = range(50, 70)

    def taken(second):
        last = node._waiting[-1].stamp_ns if node._waiting else node._worked_on or 0
        return last >= second * SECOND

    for second in sent:
        rig.show(*frame(second % 4)[:2], second)
        ros.spin_until(lambda second=second: taken(second), what="the image")
        rounds = iter(range(6))
        ros.spin_until(lambda rounds=rounds: next(rounds, None) is None, what="some more rounds")
    ros.spin_until(lambda: sent[-1] in rig.masks, what="the last")
    ros.spin_until(lambda: len(rig.got["contours"]) >= len(rig.masks), what="contours of each mask")
    assert not tracker.drops["overload"]
    assert node.drops["overload"] + len(rig.masks) == len(sent)
    assert "and the object cut out (" in node.last_drops["overload"]
    assert len(rig.masks) > board_pose._MOST_WAITING  # which are left when nothing comes any more
    assert max(np.diff(sorted(rig.masks))) <= 8


def test_sigma_of_contours_holds_that_of_the_pose(graph) -> None:
    from rig import send_until_seen, views

    publisher = graph.rig.create_publisher(PoseWithCovarianceStamped, "camera_pose_cov", 100)
    graph.ros.spin_until(publisher.get_subscription_count, what="the tracker")
    sigmas = []
    for second, sigma_m in ((10, 0.0), (11, 2e-3)):
        camera, _ = views()[second - 10]
        covariance = np.diag([sigma_m**2] * 3 + [0.0] * 3)
        message = encode_pose_covariance(camera.pose, covariance, second * SECOND, "turntable")
        publisher.publish(message)
        graph.settle()
        send_until_seen(graph.ros, graph.rig, views()[second - 10], second * SECOND)
        contours = decode_contours(graph.rig.got["contours"][-1])
        sigmas.append(contours.sigma)
        distance = np.linalg.norm(camera.centre)
    known = [s[np.isfinite(s)] for s in sigmas]
    # A shift of 2 mm across the contour, seen from the distance of the object.
    assert np.median(known[1]) == pytest.approx(2e-3 / distance, rel=0.1)
    assert np.median(known[0]) < 0.3 * np.median(known[1])


def test_a_bad_covariance_is_counted_and_the_contours_go_on(graph) -> None:
    from rig import send_until_seen, views

    publisher = graph.rig.create_publisher(PoseWithCovarianceStamped, "camera_pose_cov", 100)
    graph.ros.spin_until(publisher.get_subscription_count, what="the tracker")
    camera, _ = views()[0]
    bad = np.full((6, 6), np.nan)
    publisher.publish(encode_pose_covariance(camera.pose, bad, 10 * SECOND, "turntable"))
    graph.settle()
    send_until_seen(graph.ros, graph.rig, views()[0], 10 * SECOND)
    assert graph.tracker.drops["bad_camera_pose_cov"] == 1


WRONG = {
    "no_board": (lambda k: np.full((480, 640), 128, np.uint8), "no board is in view"),
    "mirrored_board": (lambda k: frame(k)[1][:, ::-1].copy(), "mirrored"),
    "two_boards": (lambda k: np.hstack([frame(k)[1][:, 160:480]] * 2), "two boards"),
    "bad_image": (lambda k: np.zeros((0, 0), np.uint8), ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("reason", WRONG)
def test_what_is_wrong_has_a_name_and_is_said_in_diagnostics(started, reason) -> None:
    ros, node, rig = started
    make, words = WRONG[reason]
    camera, _, _ = frame(0)
    rig.show(camera, make(1), 10)
    ros.spin_until(lambda: node.drops.total(), what="a drop")
    assert set(node.drops) == {reason}
    ros.spin_until(
        lambda: (
            "/board_pose" in rig.reports
            and words in rig.reports["/board_pose"].message
            and reason in rig.reports["/board_pose"].message
        ),
        what="words in the diagnostics",
    )
    # And the next good image has its pose.
    camera, pixels, _ = frame(2)
    rig.show(camera, pixels, 12)
    ros.spin_until(lambda: 12 in rig.poses, what="the next pose")


def test_garbage_stops_nothing(started) -> None:
    ros, node, rig = started
    camera, pixels, _ = frame(0)
    bad = encode_image(pixels, 5 * SECOND, "camera")
    bad.encoding = "nonsense"
    negative = encode_image(pixels, 5 * SECOND, "camera")
    negative.header.stamp.sec = -7
    uncalibrated = encode_camera_info(camera, 6 * SECOND, "camera")
    uncalibrated.k = np.zeros(9)
    rig.info.publish(encode_camera_info(camera, 5 * SECOND, "camera"))
    for count, message in enumerate((bad, negative), 1):
        rig.image.publish(message)
        ros.spin_until(lambda n=count: node.drops["bad_image"] == n, what="a drop")
    rig.info.publish(uncalibrated)
    rig.image.publish(encode_image(pixels, 6 * SECOND, "camera"))
    ros.spin_until(lambda: node.drops["bad_camera_info"], what="a drop by name")
    assert node.drops["bad_image"] == 2
    rig.show(camera, pixels, 12)
    ros.spin_until(lambda: 12 in rig.poses, what="the next pose")


def test_without_its_board_the_node_says_how_to_make_one(ros, tmp_path) -> None:
    with pytest.raises(SettingsError, match="occ-recon board"):
        ros.start(BoardPoseNode, params={"board": str(tmp_path / "none.yaml")})


@pytest.mark.slow
def test_as_a_program_of_its_own(ros, board) -> None:
    ros.program("-m", "occ_recon_ros.nodes.board_pose", "--ros-args", "-p", f"board:={board}")
    rig = ros.start(BoardRig)
    ros.spin_until(
        lambda: rig.image.get_subscription_count() and rig.info.get_subscription_count(),
        timeout=180,
        what="the program",
    )
    camera, pixels, _ = frame(0)
    for second in range(10, 20):
        rig.show(camera, pixels, second)
        try:
            ros.spin_until(lambda: rig.poses, timeout=5)
            break
        except AssertionError:
            continue
    assert rig.poses
