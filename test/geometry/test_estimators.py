"""Estimators of depth against closed forms, the noise they are told of, and each other."""

import numpy as np
import pytest
from spheres import Sphere, general_path, ring, unit

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.estimators import ESTIMATORS, MANY_FRAMES, Rays

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)
FEW = [0.4, 0.23, 0.57]  # the view, the partner before, the one after
MANY = [*FEW, 0.3, 0.35, 0.45, 0.5]
THETA = np.linspace(0.1, 6.1, 30)


def rays(path, angles, sigma=1e-4, theta=THETA):
    """Exact rays of a view and its correspondents in the partners."""
    C, *others = path(np.asarray(angles))
    T, N = SPHERE.ray(C, theta)
    of = [[SPHERE.correspondent(C, t, n, c) for t, n in zip(T, N, strict=True)] for c in others]
    partners = [
        Rays(c, np.array([r[0] for r in pair]), np.array([r[1] for r in pair]), 0 * theta + sigma)
        for c, pair in zip(others, of, strict=True)
    ]
    return Rays(C, T, N, 0 * theta + sigma), partners


def offset(rays_, angle):
    """The rays turned outwards by an angle each, (n,)."""
    return Rays(rays_.centre, unit(rays_.T + angle[:, None] * rays_.N), rays_.N, rays_.sigma)


@pytest.mark.parametrize("path", [ring, general_path])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_exact_rays_give_depth_and_curvature(name, path):
    view, partners = rays(path, MANY if name in MANY_FRAMES else FEW)
    found = ESTIMATORS[name](view, partners)
    # A circle through one epipolar plane is right for a linear motion only.
    tolerance = 1e-3 if name == "circle_epipolar" else 1e-5
    assert (found.status == Status.GOOD).all()
    assert np.abs(found.depth - SPHERE.depth(view.centre)).max() < tolerance
    np.testing.assert_allclose(found.curvature, 1 / 0.2, rtol=50 * tolerance + 0.02)
    assert (found.depth_sigma > 0).all()


def test_over_two_partners_many_frames_are_the_paper():
    view, partners = rays(general_path, FEW)
    noise = np.random.default_rng(0).normal(0, 1e-4, (3, len(THETA)))
    view, *partners = (offset(r, e) for r, e in zip([view, *partners], noise, strict=True))
    paper, ours = (ESTIMATORS[n](view, partners) for n in ("osculating_quadric", "multi_frame"))
    np.testing.assert_allclose(ours.depth, paper.depth, rtol=1e-6)
    np.testing.assert_allclose(ours.curvature, paper.curvature, rtol=1e-6)
    np.testing.assert_allclose(ours.depth_sigma, paper.depth_sigma, rtol=0.05)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_swapping_the_partners_changes_nothing(name):
    view, partners = rays(ring, MANY)
    a = ESTIMATORS[name](view, partners)
    b = ESTIMATORS[name](view, [partners[1], partners[0], *partners[:1:-1]])
    np.testing.assert_allclose(a.depth, b.depth, rtol=1e-6)
    np.testing.assert_allclose(a.curvature, b.curvature, rtol=1e-4)
    np.testing.assert_allclose(a.depth_sigma, b.depth_sigma, rtol=1e-3)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_errors_scatter_as_predicted(name):
    # One ray, seen many times in a plane, so that errors across the contour stay in it.
    sphere = Sphere(np.zeros(3), 0.2)
    rng = np.random.default_rng(2)
    trials, sigma = 3000, 5e-5
    views = []
    for C in ring(np.array(MANY if name in MANY_FRAMES else FEW), height=0.0):
        out = unit(np.cross([0, 0, 1.0], C))
        cos = np.sqrt(1 - (0.2 / 1.3) ** 2)
        T = -cos * unit(C) + 0.2 / 1.3 * out
        N = cos * out + 0.2 / 1.3 * unit(C)
        T = unit(T + sigma * rng.standard_normal((trials, 1)) * N)
        views.append(Rays(C, T, np.tile(N, (trials, 1)), np.full(trials, sigma)))
    found = ESTIMATORS[name](views[0], views[1:])
    error = found.depth - sphere.depth(views[0].centre)
    assert np.std(error / found.depth_sigma) == pytest.approx(1, abs=0.15)
    assert abs(np.mean(error)) < 0.15 * np.std(error)


@pytest.mark.parametrize("name", MANY_FRAMES)
def test_more_frames_are_better_and_lost_correspondents_do_no_harm(name):
    view, partners = rays(ring, MANY)
    lost = partners[3]
    T = lost.T.copy()
    T[::2] = np.nan
    fewer = [*partners[:3], Rays(lost.centre, T, lost.N, lost.sigma), *partners[4:]]
    three, some, all_of_them = (
        ESTIMATORS[name](view, p).depth_sigma for p in (partners[:2], fewer, partners)
    )
    assert (some < three).all()
    assert (all_of_them <= some * (1 + 1e-9)).all()
    assert (all_of_them[::2] < some[::2]).all()
    np.testing.assert_allclose(all_of_them[1::2], some[1::2], rtol=1e-9)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_motion_along_the_ray_is_said(name):
    view, partners = rays(ring, FEW, theta=np.array([1.0]))
    along = Rays(view.centre + 0.2 * view.T[0], view.T, view.N, view.sigma)
    found = ESTIMATORS[name](view, [along, partners[1]])
    assert found.status[0] == Status.MOTION_ALONG_RAY
    assert np.isnan(found.depth[0])


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_triple_point_has_no_curvature(name):
    # All centres lie in the plane that touches the sphere at its top.
    centres = ring(np.radians([0, -10, 10]), height=0.2)
    top = np.array([[0, 0, 0.2]])
    view, *partners = (
        Rays(C, unit(top - C), np.array([[0, 0, 1.0]]), np.array([1e-4])) for C in centres
    )
    found = ESTIMATORS[name](view, partners)
    assert np.isnan(found.curvature[0])
    assert found.status[0] in (Status.DOUBLE, Status.ILL_CONDITIONED)


def test_partners_on_one_side_leave_the_paper_right_and_the_circles_wrong():
    centres = np.array([[1.3, 0, 0.1], [1.29, -0.18, 0.3], [1.29, 0.18, 0.3]])

    def path(_):
        return centres

    view, partners = rays(path, FEW, theta=np.linspace(0, 6.2, 400))
    slopes = []
    for p in partners:
        turn = np.einsum("nk,nk->n", p.T, view.N)
        slopes.append(turn)
    same = (slopes[0] * slopes[1] > 0) & (np.abs(slopes[1] - slopes[0]) > 0.05)
    assert same.sum() > 40
    error = {}
    for name in ("osculating_quadric", "circle_epipolar", "circle_radial"):
        off = ESTIMATORS[name](view, partners).depth[same] - SPHERE.depth(view.centre)
        assert np.isfinite(off).mean() > 0.9
        error[name] = np.nanmedian(np.abs(off))
    assert error["osculating_quadric"] < 0.1 * error["circle_radial"]
    assert error["osculating_quadric"] < 0.1 * error["circle_epipolar"]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_reconstructor_uses_the_estimator_that_is_set(name):
    step = np.radians(2.5)
    contours = [
        SPHERE.contours(C, 1200, stamp_ns=k + 1, sigma=1e-5)
        for k, C in enumerate(ring(step * np.arange(9)))
    ]
    rims = {}
    for estimator in ("osculating_quadric", name):
        reconstructor = RimReconstructor(RimSettings(estimator=estimator, frames=3))
        (rims[estimator],) = [r for c in contours for r in reconstructor.add(c)]
    rim, paper = rims[name], rims["osculating_quadric"]
    good = rim.status == Status.GOOD
    assert good.mean() > 0.85
    depth = np.einsum("nk,nk->n", rim.points - contours[4].centre, contours[4].T)
    error = np.abs(depth - SPHERE.depth(contours[4].centre))[good]
    assert np.median(error) < 1e-3
    if name == "multi_frame":
        assert (rim.depth_sigma[good] < 1.01 * paper.depth_sigma[good]).mean() > 0.99
        assert np.median(rim.depth_sigma[good] / paper.depth_sigma[good]) < 0.95
