"""Intrinsics from views whose camera is known."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import CHARUCO, photograph, view

from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses.board import BoardSpec
from occ_recon_ros.poses.camera_yaml import camera_to_yaml, read_camera
from occ_recon_ros.poses.detect import BoardDetector
from occ_recon_ros.poses.intrinsics import BoardView, calibrate_intrinsics

LENS = (0.08, -0.15, 0.001, -0.0005)
BOARD: BoardSpec = CHARUCO


def poses(count, seed=0, size=(960, 720), f=900.0):
    """Views from all sides, near enough to fill the image, some off centre."""
    rng = np.random.default_rng(seed)
    return [
        view(
            rng.uniform(0, 6.28),
            rng.uniform(0.7, 1.4),
            rng.uniform(0.28, 0.42),
            f=f,
            size=size,
            D=LENS,
            at=(rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06), 0),
        )
        for _ in range(count)
    ]


def corners(cameras, sigma, seed=0):
    rng = np.random.default_rng(seed)
    views = []
    for k, camera in enumerate(cameras):
        uv = camera.project(BOARD.corners)
        inside = ((uv > 5) & (uv < [camera.width - 6, camera.height - 6])).all(axis=1)
        noisy = uv[inside] + rng.normal(0, sigma, (inside.sum(), 2))
        views.append(BoardView(f"{k}", BOARD.corners[inside], noisy))
    return views


@pytest.mark.slow
def test_rendered_views_give_the_camera() -> None:
    cameras = poses(8, size=(640, 480), f=600.0)
    detector, views = BoardDetector(BOARD), []
    for k, camera in enumerate(cameras):
        found = detector.find(photograph(BOARD, camera, seed=k, samples=3))
        views.append(BoardView(f"{k}", BOARD.corners[found.index], found.uv))
    told = calibrate_intrinsics(views, (640, 480))
    true, got = cameras[0].K, told.camera.K
    assert got[0, 0] == pytest.approx(true[0, 0], rel=2e-3)
    error = np.array([got[0, 0], got[1, 1], *got[:2, 2]]) - [600, 600, *true[:2, 2]]
    assert (np.abs(error) < 3.5 * told.sigma[:4]).all()
    assert told.verdict[0] == "good"


@pytest.mark.slow
def test_the_sigmas_are_those_of_many_trials() -> None:
    cameras, errors, told = poses(12), [], []
    for seed in range(12):
        found = calibrate_intrinsics(corners(cameras, 0.2, seed), (960, 720))
        K = found.camera.K - cameras[0].K
        errors.append([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        told.append(found.sigma[:4])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(told, axis=0)
    assert ratio == pytest.approx(np.ones(4), abs=0.35)


def test_wrong_corners_are_left_out() -> None:
    views = corners(poses(10), 0.1)
    views[3].uv[5] += [9.0, 4.0]
    views[7].uv[2] -= [6.0, 0.0]
    told = calibrate_intrinsics(views, (960, 720))
    assert told.rejected == 2
    assert told.camera.K[0, 0] == pytest.approx(900, rel=2e-3)


def test_a_perfect_lens_gets_no_distortion() -> None:
    cameras = [replace(c, D=np.zeros(0), distortion="none") for c in poses(10)]
    told = calibrate_intrinsics(corners(cameras, 0.1), (960, 720))
    assert len(told.camera.D) <= 1 or np.abs(told.camera.D).max() < 0.02


def test_a_board_on_a_turntable_tells_less_and_says_so() -> None:
    cameras = [view(k * 0.4, 0.7, 0.4) for k in range(12)]
    told = calibrate_intrinsics(corners(cameras, 0.1), (960, 720))
    assert told.centred
    # Across the tilt the principal point is told, along it what is believed of lenses helps.
    off = np.abs(told.camera.K[:2, 2] - cameras[0].K[:2, 2])
    assert (off < 3 * told.sigma[2:4]).all()
    assert told.sigma[3] > 3 * told.sigma[2]
    assert told.verdict[0] != "good"
    assert "one tilt" in told.verdict[1]
    assert abs(told.camera.K[0, 0] - 900) < 3 * told.sigma[0]


def test_a_fisheye_lens_is_told_from_a_usual_one() -> None:
    rng, views, lens = np.random.default_rng(5), [], None
    bends = np.array([0.05, -0.02, 0.004, -0.001])
    for k in range(10):
        at, far = (*rng.uniform(-0.06, 0.06, 2), 0), rng.uniform(0.1, 0.2)
        camera = view(2.2 * k, rng.uniform(0.6, 1.3), far, f=400.0, size=(1280, 960), at=at)
        lens = replace(camera, D=bends, distortion="equidistant")
        views += corners([lens], 0.1, k)
    told = calibrate_intrinsics(views, (1280, 960))
    assert told.camera.distortion == "equidistant"
    K, true = told.camera.K, lens.K
    off = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
    off -= [true[0, 0], true[1, 1], true[0, 2], true[1, 2]]
    assert (np.abs(off) < 3.5 * told.sigma[:4]).all()
    assert told.sigma[:4].max() < 0.3
    ahead = np.array([[0.8, 0.3, 1], [-1, 0.5, 1], [0.1, -0.9, 1]])
    here = CameraPose(np.eye(3), np.zeros(3))
    assert np.abs(told.camera.at(here).project(ahead) - lens.at(here).project(ahead)).max() < 0.5
    assert told.rms_px < 0.16
    assert told.verdict[0] != "poor"
    assert "fisheye lens (equidistant)" in told.verdict[1]
    assert not told.rejected


def test_a_fisheye_seen_in_its_middle_alone_gets_no_lens_that_folds_back() -> None:
    views, bends = [], np.array([-0.06, 0.012, 0, 0])
    for k in range(5):  # where plumb_bob fits nearly as well
        camera = view(2.2 * k, 0.7 + 0.1 * k, 0.3, f=415.0, size=(1280, 720))
        views += corners([replace(camera, D=bends, distortion="equidistant")], 0.7, k)
    assert calibrate_intrinsics(views, (1280, 720)).camera.distortion == "equidistant"


def test_a_wide_lens_without_bends_is_none() -> None:
    cameras = [
        view(2.2 * k, 0.7 + 0.1 * (k % 5), 0.14, f=500.0, size=(1280, 960)) for k in range(9)
    ]
    told = calibrate_intrinsics(corners(cameras, 0.1), (1280, 960))
    assert told.camera.distortion != "equidistant"
    assert abs(told.camera.K[0, 0] - 500) < min(3.5 * told.sigma[0], 2.5)


def test_too_few_views_are_refused() -> None:
    with pytest.raises(ValueError, match="3 are needed"):
        calibrate_intrinsics(corners(poses(2), 0.1), (960, 720))
    with pytest.raises(ValueError, match="1 view shows 8 corners of the board or more"):
        calibrate_intrinsics(corners(poses(1), 0.1), (960, 720))


def test_the_file_is_read_back(tmp_path) -> None:
    path, camera = tmp_path / "camera.yaml", poses(1)[0]
    path.write_text(camera_to_yaml(camera))
    again = read_camera(path)
    assert np.array_equal(again.K, camera.K)
    assert again.D[:4] == pytest.approx(camera.D)
    assert (again.width, again.distortion) == (960, "plumb_bob")
    path.write_text(camera_to_yaml(replace(camera, D=np.zeros(4), distortion="equidistant")))
    assert read_camera(path).distortion == "equidistant"


OPENCV = """%YAML:1.0
---
calibration_time: "Fri Nov  6 10:00:00 2020"
image_width: 960
image_height: 720
{K}: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 900., 0., 480., 0., 901., 360.,
       0., 0., 1. ]
{D}: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.2, 0., 0., 0. ]
"""


@pytest.mark.parametrize(
    "text",
    [
        OPENCV.format(K="camera_matrix", D="distortion_coefficients"),
        OPENCV.format(K="cameraMatrix", D="distCoeffs"),
        "image_width: 960\nimage_height: 720\ncamera_matrix: [900, 0, 480, 0, 901, 360, 0, 0, 1]\n"
        "distortion_coefficients: [0.1, -0.2, 0, 0, 0]",
    ],
    ids=["OpenCV", "OpenCV's classes", "flat"],
)
def test_calibrations_of_other_programs_are_read(text, tmp_path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    camera = read_camera(path)
    assert camera.K.tolist() == [[900, 0, 480], [0, 901, 360], [0, 0, 1]]
    assert camera.D[:2] == pytest.approx([0.1, -0.2])
    assert (camera.width, camera.height, camera.distortion) == (960, 720, "plumb_bob")


@pytest.mark.parametrize(
    ("written", "instead", "words"),
    [
        ("image_width: 960\n", "", "it lacks image_width: wanted are image_width, image_height"),
        ("image_width: 960", 'image_width: "960px"', "whole number of pixels, got '960px'"),
        ("0., 0., 1. ]", "0., 0. ]", "camera_matrix must have 9 numbers, it has 8"),
        ("900.,", "wide,", "camera_matrix must be numbers"),
        ("   data: [ 0.1,", "   values: [ 0.1,", "distortion_coefficients lacks data"),
    ],
)
def test_what_a_calibration_lacks_is_said(written, instead, words, tmp_path) -> None:
    path = tmp_path / "camera.yaml"
    text = OPENCV.format(K="camera_matrix", D="distortion_coefficients")
    assert written in text
    path.write_text(text.replace(written, instead))
    with pytest.raises(ValueError, match=words):
        read_camera(path)


@pytest.mark.parametrize("text", ["", "a: [", "image_width: 3", "[1]"])
def test_a_file_of_another_form_is_refused(text, tmp_path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"camera\.yaml"):
        read_camera(path)
