"""CameraInfo and PoseStamped against the sensor's own geometry and OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation

from msg_adapters import decode_camera, decode_pose, encode_camera_info, encode_pose
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.pose import CameraPose

HERE = CameraPose(np.eye(3), np.zeros(3))
POINTS = np.random.default_rng(5).uniform([-0.3, -0.2, 0.9], [0.3, 0.2, 1.4], (40, 3))


def camera(D=(), distortion="none"):
    return Camera(
        K=[[900.0, 0, 331], [0, 905, 255], [0, 0, 1]],
        width=640,
        height=480,
        R_camera_object=Rotation.from_euler("xyz", [0.3, -2.0, 1.0]).as_matrix(),
        t_camera_object=[0.2, -0.1, 1.3],
        D=np.array(D),
        distortion=distortion,
    )


def info_of(**changes):
    info = encode_camera_info(camera(), 0, "camera")
    for name, value in changes.items():
        setattr(info, name, value)
    return info


@pytest.mark.parametrize(
    ("D", "model"),
    [
        ((), "none"),
        ((-0.2, 0.1, 0.001, -0.002, 0.03), "plumb_bob"),
        ((-0.2, 0.1, 0.001, -0.002, 0.03, 0.1, -0.05, 0.01), "rational_polynomial"),
        ((0.1, 0.2, 0, 0, 0.1, 0.2, 0.1, 0, 0.01, 0, -0.01, 0), "rational_polynomial"),
        ((0.05, -0.01, 0.003, -0.001), "equidistant"),
        ((0.0, 0.0, 0.0, 0.0), "equidistant"),
    ],
)
def test_a_camera_comes_back_through_its_two_messages(D, model):
    sent = camera(D, model)
    info = encode_camera_info(sent, 4, "camera")
    pose = encode_pose(sent, 4, "turntable")
    info = deserialize_message(serialize_message(info), type(info))
    pose = deserialize_message(serialize_message(pose), type(pose))
    got = decode_camera(info, decode_pose(pose))
    np.testing.assert_allclose(got.K, sent.K)
    np.testing.assert_allclose(got.centre, sent.centre, atol=1e-12)
    np.testing.assert_allclose(got.R_camera_object, sent.R_camera_object, atol=1e-12)
    assert (got.width, got.height) == (640, 480)
    world = POINTS @ sent.R_camera_object - sent.t_camera_object @ sent.R_camera_object
    np.testing.assert_allclose(got.project(world), sent.project(world), atol=1e-9)


@pytest.mark.parametrize(
    ("D", "model"),
    [
        ((-0.2, 0.1, 0.001, -0.002), "plumb_bob"),
        ((-0.2, 0.1, 0.001, -0.002, 0.03), "plumb_bob"),
        ((-0.2, 0.1, 0.001, -0.002, 0.03, 0.1, -0.05, 0.01), "rational_polynomial"),
        ((0.05, -0.01, 0.003, -0.001), "equidistant"),
        ((0.0, 0.0, 0.0, 0.0), "equidistant"),
    ],
)
def test_distortion_is_that_of_opencv(D, model):
    got = decode_camera(info_of(d=list(D), distortion_model=model), HERE)
    zero = np.zeros(3)
    if model == "equidistant":
        uv = cv2.fisheye.projectPoints(POINTS[None], zero, zero, got.K, np.array(D))[0]
    else:
        uv = cv2.projectPoints(POINTS, zero, zero, got.K, np.array(D))[0]
    np.testing.assert_allclose(got.project(POINTS), uv.reshape(-1, 2), atol=1e-6)


@settings(max_examples=50)
@given(
    bx=st.sampled_from([0, 1, 2, 3]),
    by=st.sampled_from([0, 1, 2, 4]),
    x0=st.integers(0, 100),
    y0=st.integers(0, 100),
)
def test_binning_and_region_keep_every_pixel_on_its_ray(bx, by, x0, y0):
    info = info_of(binning_x=bx, binning_y=by)
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = x0, y0, 480, 360
    got, whole = decode_camera(info, HERE), decode_camera(info_of(), HERE)
    bx, by = max(bx, 1), max(by, 1)
    assert (got.width, got.height) == (480 // bx, 360 // by)
    # A binned pixel is the mean of the sensor pixels it covers.
    column, row = 7, 11
    u = x0 + column * bx + np.arange(bx).mean()
    v = y0 + row * by + np.arange(by).mean()
    ray = got.viewing_directions([[column, row]])
    np.testing.assert_allclose(ray, whole.viewing_directions([[u, v]]), atol=1e-12)


def test_a_region_of_zeros_is_the_whole_sensor():
    got = decode_camera(info_of(), HERE)
    np.testing.assert_array_equal(got.K, camera().K)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"k": np.zeros(9)}, r"not calibrated: K\[0\] is 0"),
        ({"k": np.full(9, np.nan)}, "K is not finite"),
        ({"d": [np.inf] * 5}, "D is not finite"),
        ({"d": [0.1] * 3}, "needs 4 or 5 coefficients"),
        ({"d": [0.1] * 14, "distortion_model": "rational_polynomial"}, "tilted"),
        ({"d": [0.1], "distortion_model": "magic"}, "'magic' is not supported"),
        ({"d": [0.1] * 5, "distortion_model": ""}, "'' is not supported"),
        ({"d": [46.6, -3690.0, 0.4, 2.4, 0.0]}, "distortion folds back within the image"),
        ({"width": 0}, "width and height are 0x480"),
        ({"binning_x": 1000}, "at binning 1000x1"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused_with_the_reason(changes, says):
    with pytest.raises(ValueError, match=says):
        decode_camera(info_of(**changes), HERE)


def test_a_region_outside_the_sensor_is_refused():
    info = info_of()
    info.roi.x_offset, info.roi.width, info.roi.height = 600, 100, 100
    with pytest.raises(ValueError, match="outside"):
        decode_camera(info, HERE)


def test_an_uncalibrated_pinhole_without_a_model_name_is_no_error():
    got = decode_camera(info_of(distortion_model="", d=[]), HERE)
    assert got.distortion == "none"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"x": np.nan}, "not finite"),
        ({"w": np.inf}, "not finite"),
        ({"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}, "length 1, got 0"),
        ({"w": 1e300}, "length 1"),
    ],
)
def test_a_bad_quaternion_is_refused(changes, says):
    msg = encode_pose(camera(), 0, "turntable")
    for name, value in changes.items():
        setattr(msg.pose.orientation, name, value)
    with pytest.raises(ValueError, match=says):
        decode_pose(msg)


@pytest.mark.parametrize(("z", "says"), [(np.nan, "not finite"), (-1e300, "m from the origin")])
def test_a_position_that_is_nowhere_is_refused(z, says):
    msg = encode_pose(camera(), 0, "turntable")
    msg.pose.position.z = float(z)
    with pytest.raises(ValueError, match=says):
        decode_pose(msg)


def test_a_message_and_its_camera_share_no_numbers():
    seen = camera()
    info = encode_camera_info(seen, 0, "camera")
    info.k[:], info.p[:] = 0.0, 0.0
    assert seen.K[0, 0] == 900.0
    info = encode_camera_info(seen, 0, "camera")
    read = decode_camera(info, HERE)
    info.k[:] = 0.0
    assert read.K[0, 0] == 900.0
