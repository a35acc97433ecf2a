"""The axis from poses on a known circle."""

import numpy as np
import pytest
from rendered import CHARUCO, view

from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses import candidate_poses
from occ_recon_ros.poses.axis import Turntable, calibrate_axis, read_turntable, turntable_to_yaml
from occ_recon_ros.poses.projection import difference

DIRECTION = np.array([0.03, -0.02, 1.0])
DIRECTION /= np.linalg.norm(DIRECTION)
POINT = np.array([0.012, -0.02, 0.0])
POINT -= (POINT @ DIRECTION) * DIRECTION
CAMERA = view(0.3, 0.6, distance=1.0, f=2000.0)
TABLE = Turntable(POINT, DIRECTION, CAMERA.pose)


def measured(angles, sigma_px=0.1, seed=0):
    """Board poses at angles of the table, from noisy corners."""
    rng, poses, covariances = np.random.default_rng(seed), [], []
    for angle in angles:
        uv = CAMERA.at(TABLE.camera_at(angle)).project(CHARUCO.corners)
        uv = uv + rng.normal(0, sigma_px, uv.shape)
        found = candidate_poses(CAMERA, CHARUCO.corners, uv)[0]
        poses.append(found.pose)
        covariances.append(found.covariance)
    return poses, covariances


def off_axis(fit):
    cosine = abs(fit.table.direction @ DIRECTION)
    apart = fit.table.point - POINT
    return np.rad2deg(np.arccos(min(cosine, 1.0))), 1e3 * np.linalg.norm(
        apart - (apart @ DIRECTION) * DIRECTION
    )


def test_twelve_noisy_poses_give_the_axis_and_its_sigmas() -> None:
    errors, told = [], []
    for seed in range(8):
        fit = calibrate_axis(*measured(np.arange(12) * np.pi / 6, 0.1, seed))
        errors.append(off_axis(fit))
        told.append((fit.sigma_direction_deg, fit.sigma_point_mm))
    degrees, mm = np.mean(errors, axis=0)
    assert degrees <= 0.02
    assert mm <= 0.05
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / 2) / np.mean(told, axis=0)
    assert (ratio < 1.5).all()
    assert (ratio > 0.4).all()


@pytest.mark.parametrize("ratio", [1.0, -1.0])
def test_the_encoders_sense_and_zero_are_found(ratio: float) -> None:
    angles = np.arange(12) * 0.5
    fit = calibrate_axis(*measured(angles), joint_angles=ratio * (angles - 1.3), joint="table")
    assert fit.table.ratio == ratio
    for angle in (0.2, 3.0):
        pose = fit.table.camera_at(ratio * (angle - 1.3))
        error = difference(pose, TABLE.camera_at(angle))
        assert np.linalg.norm(error[:3]) < 1e-3
        assert np.linalg.norm(error[3:]) < 1e-3
    assert fit.slips == ()


def test_a_slip_is_found_where_it_was() -> None:
    angles = np.arange(12) * 0.5
    joint = angles.copy()
    joint[7:] += np.deg2rad(3)
    fit = calibrate_axis(*measured(angles), joint_angles=joint)
    assert fit.slips == (7,)


def test_an_encoder_in_degrees_is_refused() -> None:
    angles = np.arange(12) * 0.5
    with pytest.raises(ValueError, match="radians"):
        calibrate_axis(*measured(angles), joint_angles=np.rad2deg(angles))


def test_a_camera_that_moved_is_named() -> None:
    poses, covariances = measured(np.arange(12) * 0.5)
    poses[5] = CameraPose(poses[5].R_object_camera, poses[5].centre + np.array([0.03, 0, 0.02]))
    with pytest.raises(ValueError, match="no circle"):
        calibrate_axis(poses, covariances)


def test_too_small_a_turn_is_refused() -> None:
    with pytest.raises(ValueError, match="10 degrees"):
        calibrate_axis(*measured([0.0, 0.02, 0.05]))


def test_the_file_is_read_back(tmp_path) -> None:
    path = tmp_path / "axis.yaml"
    path.write_text(turntable_to_yaml(TABLE, "found on a bench"))
    again = read_turntable(path)
    assert difference(again.camera_at(1.1), TABLE.camera_at(1.1)) == pytest.approx(
        np.zeros(6), abs=1e-9
    )
    assert again.angle_of(TABLE.camera_at(0.7)) == pytest.approx(0.7)


@pytest.mark.parametrize("text", ["", "axis: 3", "axis: {point: [0, 0, 0], direction: [0, 0, 2]}"])
def test_a_file_without_an_axis_is_refused(text, tmp_path) -> None:
    path = tmp_path / "axis.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"axis\.yaml"):
        read_turntable(path)
