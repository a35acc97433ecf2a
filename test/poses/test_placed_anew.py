"""The pose of one view by the outlines of the others. The bodies are analytic."""

from dataclasses import replace

import numpy as np
import pytest
from exact_turns import exact_turn
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.poses.placed_anew import placed_anew, strays

VIEWS, K = 15, 6
AXIS = np.array([0.0, 0.0, 1.0])


def told(camera, deg, share=0.0, axis=AXIS):
    """A camera turned about an axis of the object, and shifted by a share of its distance."""
    R = camera.R_camera_object @ Rotation.from_rotvec(np.deg2rad(deg) * axis).as_matrix().T
    shift = share * np.linalg.norm(camera.t_camera_object) * np.array([0.8, 0.6, 0.0])
    return replace(camera, R_camera_object=R, t_camera_object=camera.t_camera_object + shift)


def apart(camera, truth):
    """Degrees, and shares of the distance, between two poses."""
    R = camera.R_camera_object @ truth.R_camera_object.T
    t = camera.t_camera_object - truth.t_camera_object
    away = np.linalg.norm(truth.t_camera_object)
    return np.rad2deg(Rotation.from_matrix(R).magnitude()), np.linalg.norm(t) / away


def spoilt(name, **wrong):
    """Cameras of a turn about an object, those that are told, and the contours with these."""
    _, cameras, contours = exact_turn(name, VIEWS, elevation=0.5, width=240)
    given = list(cameras)
    given[K] = told(given[K], **wrong)
    contours[K] = seen_by(given[K], contours[K])
    return cameras, given, contours


OTHERS = [k for k in range(VIEWS) if k != K]


def test_right_views_do_not_stray():
    _, cameras, contours = exact_turn("mug", VIEWS, elevation=0.5, width=240)
    assert strays(contours, cameras) == []


@pytest.mark.parametrize("wrong", [{"deg": 80.0}, {"deg": 2.0, "share": 0.02}])
def test_a_view_in_a_wrong_pose_is_found_and_placed_where_it_was(wrong):
    cameras, given, contours = spoilt("mug", **wrong)
    if "share" in wrong:  # the planes that touch an upright mug say nothing of its turns
        assert strays(contours, given) == [K]
    found = placed_anew(K, contours, given, OTHERS)
    deg, share = apart(found.camera, cameras[K])
    assert deg < 0.2
    assert share < 1e-3
    assert found.agrees
    assert found.untold is None
    assert found.predicted  # far off it is looked for where even steps have it
    assert np.rad2deg(found.turn) == pytest.approx(wrong["deg"], abs=0.2)


@pytest.mark.parametrize("even", [True, False])
def test_what_a_body_of_revolution_does_not_tell_is_as_the_neighbours_or_the_given_pose_say(even):
    cameras, given, contours = spoilt("bottle", deg=5.0, share=0.02)
    others = OTHERS if even else [k for k in OTHERS if k not in (1, 2, 4, 9, 10, 12)]
    if not even:
        given = [told(c, 8.0 * np.sin(3 * k)) if k != K else c for k, c in enumerate(given)]
        contours = [seen_by(c, own) for c, own in zip(given, contours, strict=True)]
    found = placed_anew(K, contours, given, others)
    assert found.agrees
    assert abs(found.untold @ cameras[K].R_camera_object @ AXIS) > 0.95
    assert found.predicted == even
    deg, share = apart(found.camera, cameras[K] if even else told(cameras[K], 5.0))
    assert deg < 1.0
    assert share < (2e-3 if even else 6e-3)


@pytest.mark.slow
def test_another_object_agrees_in_no_pose():
    _, given, contours = spoilt("mug", deg=0.0)
    contours[K] = exact_turn("figure", VIEWS, elevation=0.5, width=240)[2][K]
    found = placed_anew(K, contours, given, OTHERS)
    assert found is None or not found.agrees


def test_the_mask_of_another_image_is_no_wrong_pose():
    _, given, contours = spoilt("mug", deg=0.0)
    contours[K] = seen_by(given[K], contours[K + 2])  # 48 degrees on
    found = placed_anew(K, contours, given, OTHERS)
    assert found is None or not found.agrees


def test_few_others_place_nothing():
    _, given, contours = spoilt("mug", deg=3.0)
    assert placed_anew(K, contours, given, OTHERS[:5]) is None
