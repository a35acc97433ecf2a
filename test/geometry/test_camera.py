"""Pixels to rays and back, held against OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera

K = np.array([[800.0, 0.5, 310.0], [0, 790.0, 250.0], [0, 0, 1]])
R = Rotation.from_rotvec([0.3, -2.0, 0.4]).as_matrix()
t = np.array([0.02, -0.05, 1.1])
MODELS = {
    "none": [],
    "plumb_bob": [-0.21, 0.08, 1e-3, -2e-3, 0.01],
    "rational_polynomial": [0.3, -0.1, 1e-3, 5e-4, 0.02, 0.35, -0.05, 0.01],
    "equidistant": [0.02, -0.01, 0.003, -0.001],
}


def camera(model="none", **changes):
    values = {"K": K, "width": 640, "height": 480, "R_camera_object": R, "t_camera_object": t}
    return Camera(**{**values, "D": np.array(MODELS[model]), "distortion": model, **changes})


@pytest.mark.parametrize("model", MODELS)
def test_projection_agrees_with_opencv(model):
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (50, 3))
    skewless = K * np.array([[1, 0, 1], [1, 1, 1], [1, 1, 1]])
    D = np.array(MODELS[model])
    if model == "equidistant":
        rvec = cv2.Rodrigues(R)[0]
        expected = cv2.fisheye.projectPoints(points[:, None], rvec, t, skewless, D)[0]
    else:
        expected = cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, skewless, D)[0]
    found = camera(model, K=skewless).project(points)
    np.testing.assert_allclose(found, expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_a_pixel_returns_through_its_viewing_direction(model):
    u, v = np.meshgrid(np.linspace(-20, 660, 15), np.linspace(-20, 500, 15))
    uv = np.column_stack([u.ravel(), v.ravel()])
    view = camera(model)
    T = view.viewing_directions(uv)
    np.testing.assert_allclose(np.linalg.norm(T, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(view.project(view.centre + 0.7 * T), uv, atol=1e-8)


@given(st.floats(0.1, 5), st.integers(0, 639), st.integers(0, 479))
def test_a_point_and_its_ray_agree(depth, u, v):
    view = camera("plumb_bob")
    X = view.centre + depth * view.viewing_directions(np.array([[u, v]]))
    np.testing.assert_allclose(view.project(X), [[u, v]], atol=1e-7)


def test_points_behind_the_camera_have_no_image():
    view = camera()
    behind = view.centre - R[2]
    assert np.isnan(view.project(behind[None])).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"K": np.zeros((3, 3))}, "focal"),
        ({"K": np.eye(4)}, "shape"),
        ({"K": K * np.nan}, "finite"),
        ({"D": np.array([np.inf])}, "finite"),
        ({"distortion": "magic"}, "magic"),
        ({"R_camera_object": 2 * R}, "rotation"),
        ({"R_camera_object": np.diag([1.0, 1, -1])}, "rotation"),
        ({"t_camera_object": np.array([0, np.nan, 1])}, "finite"),
    ],
)
def test_a_bad_camera_is_refused_with_the_reason(change, says):
    with pytest.raises(ValueError, match=says):
        camera(**change)


@pytest.mark.parametrize("model", MODELS)
def test_many_points_are_projected_as_few_are(model):
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (4000, 3))  # some behind the camera
    one = camera(model)
    few = np.concatenate([one.project(part) for part in np.split(points, 8)])
    assert np.isnan(few).any()
    np.testing.assert_allclose(one.project(points), few, rtol=1e-9, atol=1e-9)
