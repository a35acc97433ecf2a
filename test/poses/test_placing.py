"""Corrected cameras stay in the object frame of the given ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.poses.placing import held_in_place
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

SETTINGS = TurntableSettings(frames=24, step=2 * np.pi / 24, width=640, height=480, focal_px=800.0)
CAMERAS = turntable_cameras(SETTINGS)
MUG = make_object("mug")


def moved(camera, turn, shift, scale):
    """The camera of an object that is turned, moved and scaled with it."""
    centre = scale * turn @ camera.centre + shift
    R = camera.R_camera_object @ turn.T
    return replace(camera, R_camera_object=R, t_camera_object=-R @ centre)


@pytest.fixture(scope="module")
def contours():
    return [MUG.exact_contours(camera, stamp_ns=k) for k, camera in enumerate(CAMERAS)]


def worst_px(cameras, truth):
    """How far the true surface is seen from where it is, in the worst view."""
    points = np.asarray(MUG.mesh().vertices)
    off = [
        np.abs(a.project(points) - b.project(points)).max()
        for a, b in zip(cameras, truth, strict=True)
    ]
    return max(off)


def test_place_turn_and_scale_are_those_of_the_given_cameras(contours):
    turn = Rotation.from_rotvec([0.02, -0.05, 0.3]).as_matrix()
    away = [moved(camera, turn, np.array([0.05, -0.1, 0.02]), 0.85) for camera in CAMERAS]
    assert worst_px(away, CAMERAS) > 20
    assert worst_px(held_in_place(away, CAMERAS, contours), CAMERAS) < 0.2


def test_cameras_that_are_in_place_stay_there(contours):
    assert worst_px(held_in_place(CAMERAS, CAMERAS, contours), CAMERAS) < 0.2


def test_too_little_surface_moves_nothing(contours):
    few = [contours[0], *[None] * (len(CAMERAS) - 1)]
    assert held_in_place(CAMERAS, CAMERAS, few) == CAMERAS
