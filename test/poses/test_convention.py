"""Poses of another convention are known by where their views look."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.dataset import load_dataset
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.convention import (
    OF_TRANSFORMS,
    OTHER_CONVENTIONS,
    QUATERNION_ORDERS,
    from_colmap,
    from_opengl,
    made_unit,
    other_convention,
)

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
    assert other_convention(inverted)[0].startswith("camera -> object: give")
    assert other_convention(flipped)[0].startswith("of a camera that looks along -z")
    assert other_convention(both)[0].startswith("camera -> object, of a camera")


def one_side(seed=0):
    """Cameras in front of an object, whose world is that of one who stands beside them."""
    rng = np.random.default_rng(seed)
    stand = Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix()
    cameras = []
    for a, b in rng.uniform(-0.5, 0.5, (20, 2)):
        z = -np.array([np.sin(a), np.sin(b), -1.0])
        x = np.cross([0, 1.0, 0], z / np.linalg.norm(z))
        x /= np.linalg.norm(x)
        z /= np.linalg.norm(z)
        R = np.stack([x, np.cross(z, x), z]) @ stand
        cameras.append(Camera(K, 320, 240, R, [0, 0, 1.2] - R @ stand.T @ [0.1, 0.05, 1.1]))
    return cameras


INVERSE, OPENGL, BOTH = OTHER_CONVENTIONS


@pytest.mark.parametrize(
    ("written", "meant", "apart"),
    [
        ([INVERSE], INVERSE, False),
        ([OPENGL], OPENGL, True),
        ([OPENGL, INVERSE], BOTH, False),
    ],
)
def test_of_ways_that_all_look_at_a_place_that_is_named_where_axes_meet(written, meant, apart):
    cameras = one_side()
    assert other_convention(cameras) is None
    for way in written:
        cameras = [OTHER_CONVENTIONS[way](camera) for camera in cameras]
    assert other_convention(cameras) == (meant, apart)


def in_another_order(R, order):
    """The rotation of a quaternion whose numbers are taken for those of another order; -1: x y z w
    for w x y z, 1: the other way."""
    return Rotation.from_quat(np.roll(Rotation.from_matrix(R).as_quat(), order)).as_matrix()


@pytest.mark.parametrize("order", [-1, 1])
def test_quaternions_in_another_order_are_put_right(order):
    """x y z w read as w x y z: what is given as x is y, and w is what was given as z."""
    cameras = turn(offset=(0.3, -0.4, 0.1))
    ways = [*QUATERNION_ORDERS.items()]
    as_it_is, inverted = ways[:2] if order == -1 else ways[2:]
    to_camera = changed(cameras, lambda R, t: (in_another_order(R, order), t))
    to_object = changed(
        cameras,
        lambda R, t: ((S := in_another_order(R.T, order).T), S @ R.T @ t),
    )
    for (_, change), given in ((as_it_is, to_camera), (inverted, to_object)):
        for camera, right in zip(given, cameras, strict=True):
            found = change(camera)
            np.testing.assert_allclose(found.R_camera_object, right.R_camera_object, atol=1e-9)
            np.testing.assert_allclose(found.t_camera_object, right.t_camera_object, atol=1e-9)
    assert other_convention(to_object) == (inverted[0], True)
    assert other_convention(to_camera) is None  # that only outlines tell


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.3, -0.4, 0.1)])
@pytest.mark.parametrize("way", OF_TRANSFORMS)
def test_what_transform_matrix_may_be_instead_is_named(way, offset):
    right, given = turn(offset=offset), []
    for camera in right:
        T = np.eye(4)  # world -> camera, OpenCV
        T[:3, :3], T[:3, 3] = camera.R_camera_object, camera.t_camera_object
        flip = np.diag([1.0, -1, -1, 1])
        T = flip @ T if "(OpenGL)" in way else T
        R, t = from_opengl(T if way.startswith("world") else np.linalg.inv(T))
        given.append(replace(camera, R_camera_object=R, t_camera_object=t))
    assert other_convention(given, OF_TRANSFORMS)[0] == way
    for camera, meant in zip(given, right, strict=True):
        found = OF_TRANSFORMS[way](camera)
        np.testing.assert_allclose(found.R_camera_object, meant.R_camera_object, atol=1e-12)
        np.testing.assert_allclose(found.t_camera_object, meant.t_camera_object, atol=1e-12)


def test_axes_that_meet_where_the_cameras_all_stand_are_no_better():
    """The inverse of a turn about the object frame's z through its origin stands still."""
    beside = turn()
    aside = Rotation.from_rotvec([0, 0.1, 0]).as_matrix()  # looks past the axis
    given = changed(beside, lambda R, t: (aside @ R, aside @ t))
    assert other_convention(given) is None


def test_cameras_side_by_side_that_look_ahead_are_not_named():
    rng = np.random.default_rng(1)
    for seed in range(20):
        R = Rotation.random(random_state=seed).as_matrix()
        shaken = Rotation.from_rotvec(rng.normal(0, 0.02, (12, 3))).as_matrix()
        places = rng.uniform(-1, 1, (12, 3)) * [1, 1, 0]
        given = [Camera(K, 320, 240, S @ R, -S @ C) for S, C in zip(shaken, places, strict=True)]
        assert other_convention(given) is None


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
    assert other_convention(inverted)[0].startswith("camera -> object: give")
    flipped = changed(cameras, lambda R, t: (FLIP @ R, FLIP @ t))
    assert other_convention(flipped)[0].startswith("of a camera that looks along -z")


@pytest.mark.parametrize("offset", [(3e3, 4e3, 10), (5e5, 5.2e6, 300)])
def test_a_recorded_turn_in_map_coordinates_passes(shared_data, offset):
    cameras = [frame.camera for frame in load_dataset(shared_data / "oxford_dino")[0]]
    assert other_convention(changed(cameras, lambda R, t: (R, t - R @ offset))) is None


UNIT = np.array([0.1, -0.5, 0.7, 0.5])  # of length 1


@pytest.mark.parametrize("length", [0.951, 0.9979, 1.0019, 1.049])
def test_quaternions_near_length_1_are_rotations(length):
    R, t = from_colmap(length * UNIT, np.array([1.0, 2, 3]))
    np.testing.assert_allclose(R, from_colmap(UNIT, t)[0], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("length", [0.0, 0.949, 1.051])
def test_quaternions_far_from_length_1_are_none(length):
    with pytest.raises(ValueError, match=f"must have length 1, got {length:.3g}"):
        from_colmap(length * UNIT, np.zeros(3))


def test_quaternions_that_are_refused_or_rounded_are_not_said_to_be_made_unit():
    lengths = np.array([0.949, 0.951, 0.9979, 0.9981, 1, 1.0019, 1.0021, 1.049, 1.051])
    said = made_unit(lengths[:, None] * UNIT)
    assert said.startswith("the quaternions of 4 of 9 images differ from length 1 by up to 4.9 %")
    assert made_unit(np.array([[0.949], [0.9981], [1.0019], [1.051]]) * UNIT) == ""
    assert made_unit(np.zeros((0, 4))) == ""
