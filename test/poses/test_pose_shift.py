"""Poses of the images after or before, from an image on, are told by the outlines of all."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.poses.pose_shift import placed_as, pose_shift
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

VIEWS = 14


def uneven(name, spacing_px):
    """Views of a turn in uneven steps: outlines and cameras."""
    settings = TurntableSettings(frames=40, step=2 * np.pi / 40, elevation=0.4)
    steps = np.array([0, 2, 6, 8, 12, 14, 17, 20, 23, 26, 28, 32, 34, 38])
    cameras = turntable_cameras(settings)
    cameras = [cameras[k] for k in steps]
    shown = make_object(name)
    return [shown.exact_contours(c, spacing_px, k + 1) for k, c in enumerate(cameras)], cameras


@pytest.fixture(scope="module")
def seen():
    return uneven("figure", 1.5)


def as_of(cameras, numbers):
    return [
        placed_as(camera, cameras[k % VIEWS]) for camera, k in zip(cameras, numbers, strict=True)
    ]


@pytest.mark.parametrize(("first", "by"), [(6, 1), (6, -1), (9, 2), (4, -2)])
def test_a_shift_from_an_image_on_is_found(seen, first, by):
    contours, cameras = seen
    given = as_of(cameras, [k if k < first else k + by for k in range(VIEWS)])
    found = pose_shift(contours, given)
    assert (found.first, found.by) == (first, by)
    for k, of in enumerate(found.given):
        if of >= 0:
            np.testing.assert_array_equal(given[of].R_camera_object, cameras[k].R_camera_object)
    assert found.given.count(-1) == abs(by)


@pytest.mark.parametrize("by", [1, -2])
def test_a_shift_of_all_is_found_where_steps_are_uneven(seen, by):
    contours, cameras = seen
    found = pose_shift(contours, as_of(cameras, [k + by for k in range(VIEWS)]))
    assert (found.first, found.by) == (0, by)
    assert -1 not in found.given


def test_right_poses_and_poses_that_are_otherwise_wrong_are_left(seen):
    contours, cameras = seen
    assert pose_shift(contours, cameras) is None
    assert pose_shift(contours, cameras[::-1]) is None
    exchanged = as_of(cameras, [0, 1, 9, 3, 4, 5, 6, 7, 8, 2, *range(10, VIEWS)])
    assert pose_shift(contours, exchanged) is None
    kick = Rotation.from_rotvec([0, 0, np.deg2rad(10)]).as_matrix()
    kicked = [
        c if k < 6 else replace(c, R_camera_object=c.R_camera_object @ kick)
        for k, c in enumerate(cameras)
    ]
    assert pose_shift(contours, kicked) is None
    assert pose_shift([*contours[:5], *[None] * 9], cameras) is None


def test_a_body_of_revolution_tells_nothing():
    contours, cameras = uneven("sphere", 8.0)
    assert pose_shift(contours, as_of(cameras, [k + (k > 6) for k in range(VIEWS)])) is None
