"""The axis of a turntable from analytic outlines alone."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import real_frames
from scipy.spatial.transform import Rotation
from test_refinement import outlines

from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.poses.refine_tangencies import HullView
from occ_recon_ros.poses.turn_axis import _Solved, find_turn_axis
from occ_recon_ros.poses.turn_views import State, Turn, TurnView
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

VIEWS = 12
ANGLES = 2 * np.pi / VIEWS * np.arange(VIEWS)
SMALL = TurntableSettings(
    frames=VIEWS, step=2 * np.pi / VIEWS, width=640, height=480, focal_px=800.0
)


def turn(elevation_deg=25.0, roll_deg=0.0, way=1, aside=0.0):
    """Cameras, turned about their optical axis, then aside (rad)."""
    held = Rotation.from_euler("zy", [np.deg2rad(roll_deg), aside]).as_matrix()
    rig = replace(SMALL, elevation=np.deg2rad(elevation_deg), step=way * SMALL.step)
    return [
        replace(
            c, R_camera_object=held @ c.R_camera_object, t_camera_object=held @ c.t_camera_object
        )
        for c in turntable_cameras(rig)
    ]


def off_deg(found, cameras):
    """How far the axis that was found points from the true one, in the camera, whichever end."""
    a, b = (some[0].R_camera_object[:, 2] for some in (found.cameras, cameras))
    return np.rad2deg(np.arccos(min(1.0, abs(a @ b))))


@cache
def seen(name, noise_px=0.1, **rig):
    cameras = turn(**rig)
    return cameras, outlines(make_object(name), cameras, noise_px)


def nowhere(camera, focal_px=None):
    """The lens alone."""
    K = camera.K.copy()
    if focal_px is not None:
        K[[0, 1], [0, 1]] = focal_px
    return replace(camera, K=K, R_camera_object=np.eye(3), t_camera_object=np.zeros(3))


@pytest.mark.parametrize(
    "rig", [{}, {"roll_deg": 90.0, "elevation_deg": 45.0, "way": -1, "aside": 0.05}]
)
def test_a_known_camera_finds_the_axis_whichever_way_the_table_turns(rig):
    cameras, contours = seen("gourd", **rig)
    found = find_turn_axis(contours, nowhere(cameras[0]), ANGLES, distance=2.0)
    assert off_deg(found, cameras) < 0.3
    assert found.doubts == ()
    R = cameras[0].R_camera_object
    assert found.elevation_deg == pytest.approx(np.rad2deg(np.arcsin(-R[2, 2])), abs=0.3)
    # As far away as was said, the object's middle at height 0, z upwards in the image.
    for given, camera in zip(cameras, found.cameras, strict=True):
        assert np.linalg.norm(camera.centre[:2]) == pytest.approx(2.0)
        assert camera.R_camera_object[1, 2] < 1e-2
        off = camera.project(np.zeros((1, 3)))[0] - given.project(np.zeros((1, 3)))[0]
        assert np.linalg.norm(off) < 20
    turns = [
        Rotation.from_matrix(some[0].R_camera_object.T @ some[1].R_camera_object).as_rotvec()[2]
        for some in (cameras, found.cameras)
    ]
    assert abs(turns[0]) == pytest.approx(abs(turns[1]))


@pytest.mark.slow
def test_the_focal_length_is_found_too():
    cameras, contours = seen("gourd")
    guess = nowhere(cameras[0], 1.2 * SMALL.width)
    found = find_turn_axis(contours, guess, ANGLES, np.inf)
    assert found.cameras[0].K[0, 0] == pytest.approx(SMALL.focal_px, rel=0.03)
    assert 0 < found.focal < 0.05
    assert off_deg(found, cameras) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("told", [0.8, 1.1])
def test_how_far_the_table_turned_is_found_where_it_is_not_known(told):
    cameras, contours = seen("gourd")
    guess = nowhere(cameras[0], 1.2 * SMALL.width)
    found = find_turn_axis(contours, guess, told * ANGLES, np.inf, rate_sigma=0.1)
    assert told * found.rate == pytest.approx(1.0, abs=3e-3)
    assert off_deg(found, cameras) < 0.5
    assert found.doubts == ()


@pytest.mark.slow
def test_half_a_turn_tells_little_of_how_far_it_was():
    cameras, contours = seen("gourd")
    some = slice(0, 8)
    found = find_turn_axis(contours[some], nowhere(cameras[0]), ANGLES[some], rate_sigma=0.1)
    (doubt,) = found.doubts
    assert "by how much the table turned to" in doubt
    with_rate_known = find_turn_axis(contours[some], nowhere(cameras[0]), ANGLES[some])
    assert with_rate_known.doubts == ()
    assert with_rate_known.rate == 1.0


@pytest.mark.slow
def test_where_the_body_is_round_the_rest_of_its_outline_tells():
    # The planes that touch a mug's outlines do so at its rims: alike however high the camera.
    cameras, contours = seen("mug", elevation_deg=45.0)
    assert off_deg(find_turn_axis(contours, nowhere(cameras[0]), ANGLES), cameras) < 0.5


@pytest.mark.slow
def test_a_body_of_revolution_is_refused():
    cameras, contours = seen("bottle")
    some = slice(0, 9)
    with pytest.raises(ValueError, match="body of revolution"):
        find_turn_axis(contours[some], nowhere(cameras[0]), ANGLES[some])


@pytest.mark.slow
def test_images_in_another_order_are_refused():
    cameras, contours = seen("gourd")
    some = slice(0, 8)
    shuffled = np.random.default_rng(0).permutation(ANGLES[some])
    with pytest.raises(ValueError, match="fit no turn in such steps"):
        find_turn_axis(contours[some], nowhere(cameras[0]), shuffled)


def test_a_fit_that_is_bad_is_blamed_on_order_and_steps_before_the_body():
    turn = SimpleNamespace(size=400.0)
    cases = {0.5: "do not tell how the camera sees the axis: a body of", 4.0: "in its order by"}
    for apart_px, words in cases.items():
        for ahead, rotation_deg in ((0.9, 1.0), (5.0, 7.0)):
            found = _Solved(turn, None, apart_px, None, ahead, (rotation_deg, 0.0, 0.0))
            assert words in found.wrong
    assert _Solved(turn, None, 4.0, None, 5.0, (1.0, 0.0, 0.0)).wrong is None


def test_two_ways_to_see_a_turn_that_fit_alike_are_told():
    # A focal length that is not known makes up for another height of the camera.
    cameras, contours = seen("gourd")
    views = [
        TurnView(c, HullView.of(c, cameras[0]), float(a))
        for c, a in zip(contours, ANGLES, strict=True)
    ]
    turns = Turn(views, nowhere(cameras[0]), (0.0,), 0.7, 0.0)
    best, other = (
        State(Rotation.from_euler("x", 90 + down, degrees=True).as_matrix(), np.log(factor))
        for down, factor in ((9.0, 1.0), (15.5, 1.5))
    )
    said = _Solved(turns, best, 0.2, other, 0.3, (0.1, 0.003, 0.0)).wrong
    focal = cameras[0].K[0, 0]
    assert f"down by 9.0 degrees with a focal length of {focal:.0f} px" in said
    assert f"down by 15.5 degrees with a focal length of {1.5 * focal:.0f} px" in said
    assert "--camera-info" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "focal_sigma", "doubts"),
    [
        ("vase", 0.0, ["fit a turn in equal steps to 1.0 px only", "tell the axis to"]),
        ("gourd", np.inf, ["fit a turn in equal steps to 1.0 px only", "tell the focal length to"]),
    ],
)
def test_outlines_that_tell_little_are_a_doubt(name, focal_sigma, doubts):
    cameras, contours = seen(name, 1.0)
    found = find_turn_axis(contours, nowhere(cameras[0]), ANGLES, focal_sigma)
    for words, doubt in zip(doubts, found.doubts, strict=True):
        assert words in doubt


def test_few_outlines_are_refused():
    cameras, contours = seen("gourd")
    with pytest.raises(ValueError, match="7 images can be used"):
        find_turn_axis(contours[:7], nowhere(cameras[0]), ANGLES[:7])


def test_a_recorded_turn_finds_the_axis_of_its_calibration(shared_data):
    frames = list(real_frames(shared_data / "oxford_dino"))[::2]
    cameras = [camera for _, _, camera in frames]
    tracker = ContourTracker(ContourSettings(refine="none"))
    contours = [
        tracker.process(image, nowhere(camera), k + 1, "object", mask)
        for k, (image, mask, camera) in enumerate(frames)
    ]
    angles = np.deg2rad(20.0) * np.arange(len(frames))  # about: 9.89 to 10.08 an image
    found = find_turn_axis(contours, nowhere(cameras[0]), angles)
    assert off_deg(found, cameras) < 0.3
    assert found.doubts == ()
