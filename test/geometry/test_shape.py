"""Gaussian and mean curvature on rims against closed forms of analytic objects."""

from dataclasses import replace

import numpy as np
import pytest
from curvature import principal_curvatures
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Rim, RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.geometry.shape import second_order_shape
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

CAMERAS = turntable_cameras(TurntableSettings(frames=3, step=0.14, elevation=0.3))


def true_rim(body, contours):
    depth, k_t = body.exact_depth(contours)
    n = len(contours)
    return Rim(
        contours.stamp_ns,
        contours.frame_id,
        contours.centre,
        contours.centre + depth[:, None] * contours.T,
        contours.N,
        k_t,
        np.zeros(n),
        contours.loop,
        np.full(n, np.nan),
        np.where(np.isfinite(contours.sigma), Status.GOOD, Status.NO_CORRESPONDENT).astype(
            np.uint8
        ),
    )


@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "torus", "gourd", "wavy"])
def test_an_exact_rim_has_the_true_curvatures(name):
    body = make_object(name)
    contours = body.exact_contours(CAMERAS[1], 0.5)
    rim = true_rim(body, contours)
    found = second_order_shape(contours, rim, reach=4)
    k_min, k_max = principal_curvatures(body, rim.points)
    scale = 0.5 * (np.abs(k_min) + np.abs(k_max))
    for value, truth, unit in (
        (found.gauss, k_min * k_max, scale**2),
        (found.mean, 0.5 * (k_min + k_max), scale),
        (found.principal[0], k_min, scale),
    ):
        error = np.abs(value - truth) / unit
        assert np.isfinite(error).mean() > 0.95
        assert np.nanmedian(error) < 2e-3
        assert np.nanquantile(error, 0.95) < 0.05


def test_the_rim_is_conjugate_to_the_ray():
    body = make_object("ellipsoid")
    contours = body.exact_contours(CAMERAS[1], 0.5)
    rim = true_rim(body, contours)
    found = second_order_shape(contours, rim)
    _, S = body.shape(rim.points)
    along = np.cross(contours.N, contours.T)
    cos, sin = np.cos(found.theta)[:, None], np.sin(found.theta)[:, None]
    tangent = cos * contours.T + sin * along
    step = rim.points[contours.next_row] - rim.points[contours.previous_row]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    assert np.einsum("nk,nk->n", tangent, step).min() > 0.999
    mixed = np.einsum("ni,nij,nj->n", contours.T, S, tangent)
    assert np.median(np.abs(mixed)) < 0.01 * np.median(np.abs(rim.curvature))
    k_s = np.einsum("ni,nij,nj->n", tangent, S, tangent)
    np.testing.assert_allclose(np.median(found.k_s / k_s), 1, atol=1e-3)


def test_a_reconstructed_torus_has_hyperbolic_points_where_it_is_saddle_shaped():
    body = make_object("torus")
    cameras = turntable_cameras(TurntableSettings(frames=3, step=0.14, elevation=0.9))
    contours = [body.exact_contours(v, 0.5, stamp_ns=k + 1) for k, v in enumerate(cameras)]
    reconstructor = RimReconstructor(RimSettings(baseline=0.07))
    (rim,) = [r for c in contours for r in reconstructor.add(c)]
    found = second_order_shape(contours[1], rim)
    known = np.isfinite(found.gauss)
    assert known.mean() > 0.6
    k_min, k_max = principal_curvatures(body, rim.points[known])
    truth = k_min * k_max
    assert (truth < 0).sum() > 50
    clear = np.abs(truth) > 100
    assert (np.sign(found.gauss[known]) == np.sign(truth))[clear].mean() > 0.98
    assert np.median(np.abs(found.gauss[known] / truth - 1)) < 0.05


@settings(max_examples=10, deadline=None)
@given(turn=st.tuples(*[st.floats(-3, 3)] * 3), scale=st.floats(0.1, 10))
def test_shape_moves_and_scales_with_the_scene(turn, scale):
    body = make_object("ellipsoid")
    contours = body.exact_contours(CAMERAS[1], 4.0)
    rim = true_rim(body, contours)
    R = Rotation.from_rotvec(turn).as_matrix()
    a = second_order_shape(contours, rim)
    b = second_order_shape(
        replace(
            contours,
            centre=scale * R @ contours.centre,
            T=contours.T @ R.T,
            N=contours.N @ R.T,
        ),
        replace(rim, points=scale * rim.points @ R.T, curvature=rim.curvature / scale),
    )
    np.testing.assert_allclose(b.gauss * scale**2, a.gauss, rtol=1e-6)
    np.testing.assert_allclose(b.mean * scale, a.mean, rtol=1e-6)
    np.testing.assert_allclose(b.theta, a.theta, rtol=1e-6)


def test_points_that_are_not_good_have_no_shape():
    body = make_object("sphere")
    contours = body.exact_contours(CAMERAS[1])
    rim = true_rim(body, contours)
    status = rim.status.copy()
    status[50:90] = Status.OUTSIDE
    found = second_order_shape(contours, replace(rim, status=status))
    assert np.isnan(found.mean[50:90]).all()
    assert np.isfinite(found.mean[100:]).all()


def test_wrong_arguments_are_refused():
    body = make_object("sphere")
    contours = body.exact_contours(CAMERAS[1])
    rim = true_rim(body, contours)
    with pytest.raises(ValueError, match="reach"):
        second_order_shape(contours, rim, reach=0)
    with pytest.raises(ValueError, match="one frame"):
        second_order_shape(body.exact_contours(CAMERAS[1], 2.0), rim)


@pytest.mark.parametrize(
    ("count", "most", "chosen"),
    [(0, 9, []), (1, 9, [0]), (3, 9, [0, 1, 2]), (101, 3, [0, 50, 100])],
)
def test_of_many_some_are_chosen_evenly_and_of_none_none(count, most, chosen):
    assert evenly(count, most).tolist() == chosen
