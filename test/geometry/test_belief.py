"""Belief in sigmas: covariances that are the scatter, and rules that hold at any step, size,
place, resolution and noise alike."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from occ_recon_ros.geometry import Camera, RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.belief import (
    Belief,
    depth_discontinuities,
    propagated,
    small_pieces,
)
from occ_recon_ros.geometry.contours import Contours
from occ_recon_ros.geometry.quadric import crossing, solve
from occ_recon_ros.geometry.viewing import contours_from_loops


def grazing(C, circle, error):
    """Rays in the plane z = 0 from C that touch a circle (x, y, r), turned by errors."""
    to = circle[:2] - C[:2]
    psi = np.arctan2(to[1], to[0]) + np.arcsin(circle[2] / np.hypot(*to)) + error
    zero = np.zeros_like(psi)
    return (
        np.stack([np.cos(psi), np.sin(psi), zero], axis=1),
        np.stack([-np.sin(psi), np.cos(psi), zero], axis=1),
    )


@pytest.mark.parametrize("angles", [(-10, 0, 10), (-3, 0, 12), (6, 0, 14)])
def test_the_covariance_of_depth_and_curvature_is_their_scatter(angles):
    angle = np.radians(angles)
    C = 1.3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    circle, sigma = np.array([0.01, -0.02, 0.2]), np.array([2e-5, 1e-5, 3e-5])
    rng = np.random.default_rng(3)
    errors = sigma[:, None] * rng.standard_normal((3, 20000))

    def solved(errors):
        T, N = grazing(C[1], circle, errors[1])
        partners = [grazing(C[k], circle, errors[k])[0] for k in (0, 2)]
        cross = [crossing(C[1], T, N, C[k], T_i) for k, T_i in zip((0, 2), partners, strict=True)]
        solution = solve(*cross)
        return cross, solution.depth, 0.5 / solution.curvature

    cross, _, q = solved(np.zeros((3, 1)))
    _, depths, qs = solved(errors)
    each = tuple(sigma[[1, 0, 2], None])
    predicted, by_pose, gain = propagated(*cross, q, each, 1e-5)
    scatter = np.cov(depths, qs)
    found = np.array([predicted.depth[0], predicted.q[0], predicted.both[0]])
    expected = np.array([scatter[0, 0], scatter[1, 1], scatter[0, 1]])
    np.testing.assert_allclose(found, expected, rtol=0.05)
    assert gain[0] > 0.5
    alike = tuple(np.full((3, 1), 1e-5))
    np.testing.assert_allclose(by_pose, propagated(*cross, q, alike, 0.0)[0].depth)


F = 1600.0


def sphere_views(step_deg, *, scale=1.0, place=(0.0, 0.0, 0.0), width=1600, noise_px=0.0):
    """Three views of a sphere whose outline has about a third of the width as its radius, with
    noise that is smooth over some 30 samples, as that of fitted contours is."""
    f = F * width / 1600
    radius, distance = 0.2 * scale, 1.3 * scale
    rng = np.random.default_rng(7)
    views = []
    for k, angle in enumerate(np.radians([-step_deg, 0, step_deg])):
        away = np.array([np.cos(angle), np.sin(angle), 0.2])
        centre = distance * away / np.linalg.norm(away)
        R = looking(-centre)
        camera = Camera(
            np.array([[f, 0, width / 2], [0, f, 0.4 * width], [0, 0, 1]]),
            width,
            int(0.8 * width),
            R,
            -R @ centre,
        )
        # The outline of a sphere ahead is a circle, exactly; another place is a rotation.
        rho = f * np.tan(np.arcsin(radius / distance))
        n = int(2 * np.pi * rho)
        theta = -np.linspace(0, 2 * np.pi, n, endpoint=False)
        kernel = np.hanning(51)
        kernel = kernel / np.linalg.norm(kernel)
        e = np.convolve(np.tile(rng.standard_normal(n), 3), kernel, "same")[n : 2 * n]
        r = rho + noise_px * e
        uv = np.stack([width / 2 + r * np.cos(theta), 0.4 * width + r * np.sin(theta)], axis=1)
        sigma = np.full(n, max(noise_px, 1e-3))
        contours = contours_from_loops(camera, [uv], [0], [sigma], k + 1, "object")
        views.append(replace(contours, centre=contours.centre + place))
    return views, np.sqrt(distance**2 - radius**2)


def looking(forward):
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, [0, 0, 1.0])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def middle_rim(views, step_deg):
    baseline = float(np.radians(step_deg)) * 0.9
    reconstructor = RimReconstructor(RimSettings(baseline=baseline))
    (rim,) = [rim for c in views for rim in reconstructor.add(c)]
    return rim


STEPS = (1, 2, 5, 10, 20)
KINDS = {
    "as in the paper": {},
    "5 mm": {"scale": 0.0125},
    "5 m": {"scale": 12.5},
    "off centre": {"place": (11.0, -7.0, 3.0)},
    "320x240": {"width": 320},
    "4K": {"width": 3840},
}


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_all_steps_sizes_places_and_resolutions_behave_alike(kind, noise_px):
    for step in STEPS:
        noise = noise_px * (0.5 if kind == "320x240" else 1)  # a bend of 60 px is fitted closer
        views, depth = sphere_views(step, noise_px=noise, **KINDS[kind])
        rim = middle_rim(views, step)
        good = rim.status == Status.GOOD
        error = np.linalg.norm(rim.points - views[1].centre, axis=1) - depth
        score = (error / rim.depth_sigma)[good]
        print(f"{kind}, {step} deg, {noise_px} px: {good.mean():.0%} good, {score.std():.2f} sigma")
        assert good.mean() > 0.85
        if noise_px:
            assert 0.8 < score.std() < 1.25


def test_no_point_is_given_up_for_noise_that_its_sigma_tells_of():
    """At one degree noise of 0.3 px moves the radius of curvature by more than itself, and some
    points outside of silhouettes that are as noisy; no other is given up."""
    (clean, _), (noisy, _) = sphere_views(1.0), sphere_views(1.0, noise_px=0.3)
    share = [
        np.bincount(middle_rim(v, 1.0).status, minlength=6) / len(v[1]) for v in (clean, noisy)
    ]
    assert share[1][Status.GOOD] > share[0][Status.GOOD] - 0.11
    assert share[1][Status.NO_CORRESPONDENT] < share[0][Status.NO_CORRESPONDENT] + 0.02


def test_a_speck_far_off_does_not_make_the_object_larger():
    views, _ = sphere_views(10.0)
    plain = views[1]
    speck = 12
    T = plain.T[:1] + 0.4 * np.cross(plain.N[:1], plain.T[:1])
    T = np.repeat(T / np.linalg.norm(T), speck, axis=0)
    both = Contours(
        1, "object", plain.centre, np.vstack([plain.T, T]),
        np.vstack([plain.N, plain.N[:speck]]), np.vstack([plain.uv, plain.uv[:speck] + 600]),
        np.concatenate([plain.loop, np.full(speck, 1, np.uint16)]),
        np.concatenate([plain.sigma, plain.sigma[:speck]]),
    )  # fmt: skip
    assert both.angular_radius == pytest.approx(plain.angular_radius, rel=0.05)


@pytest.mark.parametrize(("q_sigma", "apart"), [(1e-6, True), (0.05, False)])
def test_a_jump_of_the_curvature_ends_a_piece_where_it_is_no_noise(q_sigma, apart):
    views, depth = sphere_views(10.0)
    view, n = views[1], len(views[1])
    q = np.full(n, 0.1)
    q[100:104] = 0.16
    good = np.ones(n, bool)
    known = Belief(np.full(n, 1e-12), np.full(n, q_sigma**2), np.zeros(n))
    points = view.centre + depth * view.T
    jumps = depth_discontinuities(points, np.full(n, depth), q, known, good, view)
    small = small_pieces(jumps, good, view)
    assert np.flatnonzero(small).tolist() == (list(range(100, 104)) if apart else [])


def test_the_nearest_row_stays_on_its_own_loop():
    view = sphere_views(10.0)[0][1]
    two = replace(view, loop=(np.arange(len(view)) >= 400).astype(np.uint16))
    position = np.array([398.6, 399.4, 399.6, len(view) - 0.6, len(view) - 0.4])
    assert two.nearest_row(position).tolist() == [399, 399, 0, len(view) - 1, 400]


def test_noise_makes_no_more_candidate_pairs_than_samples_can_use():
    """Outlines that flutter cross each epipolar plane many times: pairs stay a few a sample."""
    from occ_recon_ros.geometry.matching import Partner

    counts = []
    for noise in (0.0, 2.0):
        views, _ = sphere_views(10.0, width=3840)
        rng = np.random.default_rng(0)
        T = [c.T + noise / F * rng.standard_normal((len(c), 1)) * c.N for c in views]
        here, there = (replace(c, T=t / np.linalg.norm(t, axis=1, keepdims=True))
                       for c, t in zip(views[:2], T, strict=False))  # fmt: skip
        usable = Partner.of(here, there).usable
        sample = Partner.of(here, there).candidates.sample[usable]
        counts.append(np.bincount(sample).max())
    assert counts[1] > counts[0]
    assert counts[1] <= 8


def test_pieces_are_the_same_whatever_row_a_loop_begins_with():
    views, depth = sphere_views(10.0)
    view, n = views[1], len(views[1])
    rng = np.random.default_rng(1)
    for shift, length in product((0, 3, n - 2), (4, 20)):
        q = np.full(n, 0.1)
        q[(shift + np.arange(length)) % n] = 0.2
        good = rng.random(n) > -1
        known = Belief(*np.full((3, n), 1e-18))
        points = view.centre + depth * view.T
        jumps = depth_discontinuities(points, np.full(n, depth), q, known, good, view)
        assert small_pieces(jumps, good, view).sum() == (length if length < 6 else 0)
