"""The pencil of epipolar planes: the same as the paper's formulas on rays in space."""

from dataclasses import replace

import numpy as np
import pytest
from spheres import Sphere, general_path, ring

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.correspondence import Candidates, Pencil, epipolar_candidates
from occ_recon_ros.geometry.quadric import candidate_crossings, crossing, solve

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def views(path, n=400):
    centres = path(0.4 + np.radians([0, 10, 20]))
    return [SPHERE.contours(C, n, stamp_ns=k + 1) for k, C in enumerate(centres)]


def correspondents(here, there, rows):
    rays = [SPHERE.correspondent(here.centre, here.T[k], here.N[k], there.centre) for k in rows]
    return np.array([T for T, _ in rays]), np.array([N for _, N in rays])


@pytest.mark.parametrize("path", [ring, general_path])
def test_crossing_in_the_plane_is_crossing_in_space(path):
    here, there, _ = views(path, n=60)
    rows = np.arange(60)
    T_i, N_i = correspondents(here, there, rows)
    expected = crossing(here.centre, here.T, here.N, there.centre, T_i)
    # The correspondents as the other contour's samples, so that each is at its own place.
    pencil = Pencil(here, replace(there, T=T_i, N=N_i))
    np.testing.assert_allclose(pencil.there.phi, pencil.here.phi, atol=1e-12)
    found, turned = candidate_crossings(pencil, Candidates(rows, rows, np.zeros(60)))
    for name in ("d", "a", "sin", "cos_b", "d_other"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-8, atol=1e-12
        )
    ray = np.arccos(np.einsum("nk,nk->n", here.T, T_i))
    normal = np.arccos(np.einsum("nk,nk->n", here.N, N_i))
    np.testing.assert_allclose(turned, np.maximum(normal - ray, 0), atol=1e-7)


@pytest.mark.parametrize("path", [ring, general_path])
def test_between_samples_the_outline_is_followed_to_second_order(path):
    errors = []
    for n in (200, 400):
        here, there, _ = views(path, n)
        pencil = Pencil(here, there)
        found = epipolar_candidates(pencil)
        T_i, _ = correspondents(here, there, found.sample)
        axis = (there.centre - here.centre) / pencil.baseline
        expected = np.arccos(T_i @ axis)
        cos, sin = pencil.rays(found.row, found.fraction)
        np.testing.assert_allclose(np.hypot(cos, sin), 1, atol=1e-6)
        alpha = np.arctan2(sin, cos)
        errors.append(np.median(np.abs(alpha - expected)))
    print(f"{path.__name__}: median {errors[1]:.1e} rad off the outline")
    # A chord would be off by up to 4.6e-6 rad at 400 samples.
    assert errors[1] < 1e-7
    assert errors[0] / errors[1] > 5


@pytest.mark.parametrize("path", [ring, general_path])
def test_depth_is_that_of_the_exact_correspondents(path):
    here, there, beyond = views(path, 1000)
    reconstructor = RimReconstructor(RimSettings(baseline=0.12))
    (rim,) = [rim for c in (here, there, beyond) for rim in reconstructor.add(c)]
    rows = np.flatnonzero(rim.status == Status.GOOD)
    cross = [
        crossing(
            there.centre, there.T[rows], there.N[rows], c.centre, correspondents(there, c, rows)[0]
        )
        for c in (here, beyond)
    ]
    depth = np.einsum("nk,nk->n", rim.points[rows] - there.centre, there.T[rows])
    error = np.abs(depth - solve(*cross).depth)
    assert np.median(error) < 1e-8
    assert error.max() < 3e-5
