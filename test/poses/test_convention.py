"""Poses of another convention are known by where their views look."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.bags.dataset import load_dataset
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.convention import other_convention

K = np.array([[500.0, 0, 160], [0, 500, 120], [0, 0, 1]])
FLIP = np.diag([1.0, -1, -1])


def turn(covered=2 * np.pi, n=12, tilt=0.4, offset=(0.0, 0, 0)):
    """Cameras on a circle that look at the middle, the object frame's origin elsewhere."""
    cameras = []
    for a in np.linspace(0, covered, n, endpoint=False):
        z = -np.array([np.cos(a) * np.cos(tilt), np.sin(a) * np.cos(tilt), np.sin(tilt)])
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z])
        cameras.append(Camera(K, 320, 240, R, [0, 0, 1.2] - R @ np.asarray(offset)))
    return cameras


def changed(cameras, change):
    return [
        replace(c, R_camera_object=R, t_camera_object=t)
        for c in cameras
        for R, t in [change(c.R_camera_object, c.t_camera_object)]
    ]


@pytest.mark.parametrize("covered", [0.3, 1.5, 2 * np.pi])
@pytest.mark.parametrize("offset", [(0, 0, 0), (3, -4, 1)])
def test_right_poses_pass(covered, offset):
    assert other_convention(turn(covered, offset=offset)) is None


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.3, -0.4, 0.1)])
def test_inverted_and_flipped_poses_are_named(offset):
    cameras = turn(offset=offset)
    inverted = changed(cameras, lambda R, t: (R.T, -R.T @ t))
    flipped = changed(cameras, lambda R, t: (FLIP @ R, FLIP @ t))
    both = changed(flipped, lambda R, t: (R.T, -R.T @ t))
    assert other_convention(inverted).startswith("camera -> object: give")
    assert other_convention(flipped).startswith("of a camera that looks along -z")
    assert other_convention(both).startswith("camera -> object, of a camera")


def test_nonsense_is_not_named():
    rng = np.random.default_rng(0)
    rotations = np.linalg.qr(rng.normal(size=(12, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    cameras = [Camera(K, 320, 240, R, rng.normal(size=3)) for R in rotations]
    assert other_convention(cameras) is None
    assert other_convention(turn(n=2)) is None


@pytest.mark.parametrize("name", ["oxford_dino", "dino_ring", "apple_aruco"])
def test_recorded_turns_are_told_apart_from_their_inverses(shared_data, name):
    cameras = [frame.camera for frame in load_dataset(shared_data / name)[0]]
    assert other_convention(cameras) is None
    inverted = changed(cameras, lambda R, t: (R.T, -R.T @ t))
    assert other_convention(inverted).startswith("camera -> object: give")
    flipped = changed(cameras, lambda R, t: (FLIP @ R, FLIP @ t))
    assert other_convention(flipped).startswith("of a camera that looks along -z")


@pytest.mark.parametrize("offset", [(3e3, 4e3, 10), (5e5, 5.2e6, 300)])
def test_a_recorded_turn_in_map_coordinates_passes(shared_data, offset):
    cameras = [frame.camera for frame in load_dataset(shared_data / "oxford_dino")[0]]
    assert other_convention(changed(cameras, lambda R, t: (R, t - R @ offset))) is None
