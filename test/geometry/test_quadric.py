"""Depth and curvature from three rays: the general case and each special one."""

import numpy as np
import pytest
from scipy.optimize import brentq
from spheres import Sphere, general_path, ring, unit

from occ_recon_ros.geometry import Status
from occ_recon_ros.geometry.quadric import crossing, solve, solve_at_partner

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def crossings(sphere, centres, theta):
    """Exact crossings of one ray of the middle centre with both partners'."""
    T, N = sphere.ray(centres[1], theta)
    rays = [sphere.correspondent(centres[1], T, N, C) for C in (centres[0], centres[2])]
    says = [
        crossing(centres[1], T[None], N[None], C, T_i[None])
        for C, (T_i, _) in zip((centres[0], centres[2]), rays, strict=True)
    ]
    return T, N, rays, says


@pytest.mark.parametrize("path", [ring, general_path])
def test_depth_error_falls_with_the_square_of_the_step_or_faster(path):
    errors = []
    for step in np.radians([10, 5, 2.5]):
        centres = path(0.4 + np.array([-step, 0, step]))
        found = []
        for theta in np.linspace(0.1, 6.1, 24):
            _, _, _, says = crossings(SPHERE, centres, theta)
            solution = solve(*says)
            if solution.status[0] == Status.GOOD:
                found.append(
                    (
                        solution.depth[0] - SPHERE.depth(centres[1]),
                        solution.curvature[0] - 1 / SPHERE.radius,
                    )
                )
        assert len(found) > 18
        errors.append(np.median(np.abs(found), axis=0))
    errors = np.array(errors)
    # The parabola is wrong from the second order of the angle on: halving the step
    # divides both errors by four (METHOD.md: the bias of the depth is D^2 h''' / 6).
    assert (errors[:-1] / errors[1:] > 3.3).all()
    assert errors[-1, 0] < 1e-4 * SPHERE.radius
    assert errors[-1, 1] < 1e-3 / SPHERE.radius


def test_curvature_has_the_sign_of_the_outward_normal():
    centres = ring(np.radians([-5, 0, 5]))
    T, N = SPHERE.ray(centres[1], 0.7)
    _, _, _, says = crossings(SPHERE, centres, 0.7)
    assert solve(*says).curvature[0] == pytest.approx(1 / SPHERE.radius, rel=0.01)
    # A bowl seen from inside: the rays touch on the other side of the surface.
    inside = [crossing(centres[1], T[None], -N[None], *pair) for pair in partner_rays(centres, 0.7)]
    assert solve(*inside).curvature[0] == pytest.approx(-1 / SPHERE.radius, rel=0.01)


def partner_rays(centres, theta):
    T, N = SPHERE.ray(centres[1], theta)
    for C in (centres[0], centres[2]):
        yield C, SPHERE.correspondent(centres[1], T, N, C)[0][None]


def test_triple_point():
    # All centres lie in the plane that touches the sphere at its top: one point is on
    # all three rims.
    sphere = Sphere(np.zeros(3), 0.2)
    centres = ring(np.radians([-10, 0, 10]), height=0.2)
    top = np.array([0, 0, 0.2])
    T, N = unit(top - centres[1]), np.array([0.0, 0, 1])
    says = [crossing(centres[1], T[None], N[None], C, unit(top - C)[None]) for C in centres[::2]]
    solution = solve(*says)
    assert solution.status[0] == Status.DOUBLE
    assert solution.depth[0] == pytest.approx(sphere.depth(centres[1]), rel=1e-12)
    assert np.isnan(solution.curvature[0])


@pytest.mark.parametrize("which", [0, 2])
def test_double_point_takes_the_depth_of_the_partner_that_sees_it(which):
    centres = general_path(np.radians([-12, 0, 9]))
    C, C_i = centres[1], centres[which]

    def tangent(theta):  # the plane that touches the sphere holds the baseline
        return SPHERE.ray(C, theta)[1] @ (C_i - C)

    grid = np.linspace(0, 2 * np.pi, 50)
    k = np.flatnonzero(np.diff(np.sign([tangent(t) for t in grid])))[0]
    theta = brentq(tangent, grid[k], grid[k + 1], xtol=1e-15)
    T, N = SPHERE.ray(C, theta)
    P = C + SPHERE.depth(C) * T
    says = []
    for c in centres[::2]:
        T_c = unit(P - c) if (c == C_i).all() else SPHERE.correspondent(C, T, N, c)[0]
        says.append(crossing(C, T[None], N[None], c, T_c[None]))
    solution = solve(*says)
    assert solution.status[0] == Status.DOUBLE
    assert solution.depth[0] == pytest.approx(SPHERE.depth(C), rel=1e-9)


def test_same_slopes_are_solved_by_way_of_the_neighbour():
    centres = general_path(0.3 + np.radians([-8, 0, 5]))

    def difference(theta):
        _, _, _, (before, after) = crossings(SPHERE, centres, theta)
        return float(before.a[0] - after.a[0])

    # Where one a is zero the other's sign jumps, so look for a root that is not there.
    grid = np.linspace(0, 2 * np.pi, 400)
    values = np.array([difference(t) for t in grid])
    roots = []
    for k in np.flatnonzero(np.diff(np.sign(values))):
        theta = brentq(difference, grid[k], grid[k + 1], xtol=1e-15)
        if abs(difference(theta)) < 1e-9:
            roots.append(theta)
    roots = [t for t in roots if abs(crossings(SPHERE, centres, t)[3][0].a[0]) > 1e-4]
    assert roots
    for theta in roots:
        T, _, rays, (before, after) = crossings(SPHERE, centres, theta)
        solution = solve(before, after)
        assert solution.status[0] == Status.ILL_CONDITIONED
        assert np.isnan(solution.depth[0])
        filled = solve_at_partner(
            solution,
            solution.ill_conditioned,
            after,
            (centres[2], rays[1][0][None], rays[1][1][None]),
            (centres[1], T[None]),
            (centres[0], rays[0][0][None]),
        )
        assert filled.status[0] == Status.ILL_CONDITIONED
        assert filled.depth[0] == pytest.approx(SPHERE.depth(centres[1]), rel=0.01)


def test_motion_along_the_ray_is_said():
    C = np.array([1.3, 0, 0.1])
    T, N = SPHERE.ray(C, 1.0)
    ahead = C + 0.2 * T
    other = ring(0.2)
    T_i = SPHERE.correspondent(C, T, N, other)[0]
    along = crossing(C, T[None], N[None], ahead, T[None])
    usual = crossing(C, T[None], N[None], other, T_i[None])
    for says in ((along, usual), (usual, along)):
        solution = solve(*says)
        assert solution.status[0] == Status.MOTION_ALONG_RAY
        assert np.isnan(solution.depth[0])


def test_same_sign_slopes_of_general_motion_are_right():
    # Both partners on one side: methods that take sides fail here, this one must not.
    centres = ring(np.radians([6, 0, 13]))
    _, _, _, says = crossings(SPHERE, centres, 0.5)
    assert np.sign(says[0].a[0]) == np.sign(says[1].a[0])
    solution = solve(*says)
    assert solution.status[0] == Status.GOOD
    assert solution.depth[0] == pytest.approx(SPHERE.depth(centres[1]), rel=2e-3)
