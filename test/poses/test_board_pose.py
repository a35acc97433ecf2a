"""Poses from rendered boards, whose cameras are known."""

import cv2
import numpy as np
import pytest
from rendered import CHARUCO, CHESS, GRID, photograph, view

from occ_recon_ros.poses import BoardDetector, BoardSpec, candidate_poses, is_mirrored
from occ_recon_ros.poses.detect import why_unseen
from occ_recon_ros.poses.projection import difference, moved, pixel_jacobian

LENS = (0.08, -0.15, 0.001, -0.0005, 0.02)


def pose_in(image, board, camera):
    found = BoardDetector(board).find(image)
    assert found.problem is None
    return candidate_poses(camera, board.corners[found.index], found.uv)[0]


def hidden(camera, share: float):
    """A disc before the middle of the board that hides a share of its corners."""
    uv = camera.project(CHARUCO.corners)
    middle = uv.mean(axis=0)
    radius = np.quantile(np.linalg.norm(uv - middle, axis=1), share)
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.hypot(u - middle[0], v - middle[1]) < radius


@pytest.mark.parametrize(
    ("board", "azimuth"),
    [(CHARUCO, 0.3), (CHARUCO, 4.4), (GRID, 2.0), (GRID, 4.4), (CHESS, 0.3), (CHESS, 2.0)],
    ids=lambda value: getattr(value, "kind", None),
)
def test_the_pose_is_right_within_its_covariance(board: BoardSpec, azimuth: float) -> None:
    camera = view(azimuth, 0.7, D=LENS)
    hide = None if board is CHESS else hidden(camera, 0.4)
    found = pose_in(photograph(board, camera, hide=hide), board, camera)
    error = difference(found.pose, camera.pose)
    chi2 = error @ np.linalg.solve(found.covariance, error)
    assert chi2 < 6 * 2.5**2
    assert np.linalg.norm(error[:3]) < 0.5e-3
    assert found.rms_px < 0.2


def test_the_derivatives_are_those_of_the_projection() -> None:
    camera = view(0.4, 0.6, D=LENS)
    points = np.array([[0.05, 0.02, 0.0], [-0.03, 0.08, 0.01]])
    uv, J = pixel_jacobian(camera, points)
    assert uv == pytest.approx(camera.project(points), abs=1e-9)
    for k in range(6):
        step = np.eye(6)[k] * 1e-6
        there = camera.at(moved(camera.pose, step)).project(points)
        back = camera.at(moved(camera.pose, -step)).project(points)
        assert J[:, :, k] == pytest.approx((there - back) / 2e-6, rel=1e-4, abs=1e-2)


def test_precise_corners_give_a_pose_that_is_known_as_well() -> None:
    camera, rng, normed = view(1.0, 0.8), np.random.default_rng(0), []
    for _ in range(40):
        uv = camera.project(CHARUCO.corners) + rng.normal(0, 0.01, (54, 2))
        found = candidate_poses(camera, CHARUCO.corners, uv)[0]
        error = difference(found.pose, camera.pose)
        normed.append(error @ np.linalg.solve(found.covariance, error) / 6)
    assert 0.8 < np.sqrt(np.mean(normed)) < 1.2


def test_few_corners_that_fit_by_chance_are_not_thought_precise() -> None:
    camera, few = view(1.0, 0.8), CHARUCO.corners[[0, 5, 48, 53]]
    found = candidate_poses(camera, few, camera.project(few))[0]
    assert found.rms_px < 1e-3
    assert found.sigma_px > 0.02


def test_a_wrong_corner_moves_nothing() -> None:
    camera = view(1.0, 0.8)
    uv = camera.project(CHARUCO.corners) + np.random.default_rng(1).normal(0, 0.05, (54, 2))
    right = candidate_poses(camera, CHARUCO.corners, uv)[0]
    uv[20] += [4.0, -3.0]
    spoilt = candidate_poses(camera, CHARUCO.corners, uv)[0]
    assert np.flatnonzero(~spoilt.used).tolist() == [20]
    change = np.abs(difference(spoilt.pose, right.pose))
    assert (change < 0.5 * np.sqrt(np.diag(right.covariance))).all()


def test_the_covariance_is_that_of_many_trials() -> None:
    camera = view(0.5, 0.9)
    clean, rng = camera.project(CHARUCO.corners), np.random.default_rng(2)
    errors, told = [], []
    for _ in range(100):
        found = candidate_poses(camera, CHARUCO.corners, clean + rng.normal(0, 0.2, (54, 2)))[0]
        errors.append(difference(found.pose, camera.pose))
        told.append(found.covariance)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.diag(np.mean(told, axis=0)))
    assert ratio == pytest.approx(np.ones(6), abs=0.2)


def test_a_far_board_may_be_seen_from_two_places() -> None:
    camera = view(0.5, 1.0, distance=8.0, f=1500.0)
    uv = camera.project(CHARUCO.corners) + np.random.default_rng(3).normal(0, 0.3, (54, 2))
    found = candidate_poses(camera, CHARUCO.corners, uv)
    assert len(found) == 2
    near = [np.linalg.norm(p.pose.centre - camera.centre) for p in found]
    assert min(near) < 0.5 < max(near)


def test_corners_in_a_row_or_too_few_give_no_pose() -> None:
    camera = view()
    row = CHARUCO.corners[:6]
    assert candidate_poses(camera, row, camera.project(row)) == []
    assert candidate_poses(camera, row[:3], camera.project(row[:3])) == []


def test_a_mirrored_board_is_recognised() -> None:
    image = np.ascontiguousarray(photograph(CHARUCO, view())[:, ::-1])
    detector = BoardDetector(CHARUCO)
    assert detector.find(image).problem[0] in ("no_board", "few_corners")
    assert is_mirrored(detector, image)


def test_two_boards_are_named() -> None:
    image = photograph(CHARUCO, view(distance=0.8))
    assert BoardDetector(CHARUCO).find(cv2.hconcat([image, image])).problem[0] == "two_boards"


def test_no_board_is_named() -> None:
    empty = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)
    assert BoardDetector(CHARUCO).find(empty).problem[0] == "no_board"


def test_markers_of_another_board_are_named() -> None:
    image = photograph(BoardSpec(first_id=50, dictionary="DICT_5X5_100"), view())
    assert BoardDetector(CHARUCO).find(image).problem[0] == "wrong_board"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shown", "told", "says"),
    [
        ((11, 8), CHESS, "a chessboard of 8 x 11 squares is in view, board.yaml says 7 x 10"),
        ((11, 8), CHARUCO, "a chessboard of 8 x 11 squares is in view, board.yaml says charuco"),
        ((10, 7), CHESS, None),
        (None, CHESS, "the markers are of DICT_5X5_250, board.yaml says chessboard"),
        (None, CHARUCO, None),
    ],
)
def test_what_is_in_view_in_place_of_the_board_is_named(shown, told, says) -> None:
    # Who counts the corners between the squares as OpenCV does heard that no board is in view.
    board = CHARUCO if shown is None else BoardSpec("chessboard", *shown, square_m=0.025)
    why = why_unseen(BoardDetector(told), photograph(board, view(0.3, 1.0, distance=0.8)))
    assert why is None if says is None else why == ("wrong_board", why[1])
    assert says is None or says in why[1]


def test_blur_is_measured_in_pixels() -> None:
    camera, detector = view(0.3, 1.2), BoardDetector(CHARUCO)
    told = []
    for blur in (0.8, 1.3, 2.5):
        image = photograph(CHARUCO, camera, blur=blur, noise=1.0)
        told.append(detector.blur_px(image, detector.find(image)))
    assert told[:2] == pytest.approx([np.hypot(0.8, 0.3), np.hypot(1.3, 0.3)], rel=0.15)
    assert told[2] > 1.1 * told[1]  # beyond the markers' black rim it cannot be told in full
