"""The pencil of epipolar planes: the same as the paper's formulas on rays in space."""

import numpy as np
import pytest
from spheres import Sphere, general_path, ring

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.correspondence import Pencil
from occ_recon_ros.geometry.quadric import crossed_candidates, crossing, solve

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def views(path, n=400):
    centres = path(0.4 + np.radians([0, 10, 20]))
    return [SPHERE.contours(C, n, stamp_ns=k + 1) for k, C in enumerate(centres)]


def correspondents(here, there, rows):
    rays = [SPHERE.correspondent(here.centre, here.T[k], here.N[k], there.centre) for k in rows]
    return np.array([T for T, _ in rays]), np.array([N for _, N in rays])


@pytest.mark.parametrize("path", [ring, general_path])
def test_crossing_in_the_plane_is_crossing_in_space(path):
    here, there, _ = views(path)
    pencil = Pencil(here, there)
    found = crossed_candidates(pencil)
    rows = found.candidates.sample
    assert len(np.unique(rows)) > 380
    # Each candidate's ray in space: across the baseline it lies as the sample's does.
    e = (there.centre - here.centre) / pencil.baseline
    across = here.T[rows] - (here.T[rows] @ e)[:, None] * e
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    T_i = found.cos[:, None] * e + found.sin[:, None] * across
    T_i /= np.linalg.norm(T_i, axis=1, keepdims=True)
    expected = crossing(here.centre, here.T[rows], here.N[rows], there.centre, T_i)
    clear = expected.cos_b > 0.1  # a frontier point is as far from its plane as errors make it
    for name in ("d", "a", "sin", "cos_b", "d_other"):
        one, two = getattr(found.cross, name)[clear], getattr(expected, name)[clear]
        np.testing.assert_allclose(one, two, rtol=1e-4, atol=1e-7)
    ray = np.arccos(np.einsum("nk,nk->n", here.T[rows], T_i))
    _, N_i = correspondents(here, there, rows)
    normal = np.arccos(np.einsum("nk,nk->n", here.N[rows], N_i))
    np.testing.assert_allclose(found.turned[clear], np.maximum(normal - ray, 0)[clear], atol=1e-3)


@pytest.mark.parametrize("path", [ring, general_path])
def test_between_samples_the_outline_is_followed_to_second_order(path):
    errors = []
    for n in (200, 400):
        here, there, _ = views(path, n)
        pencil = Pencil(here, there)
        found = crossed_candidates(pencil)
        T_i, _ = correspondents(here, there, found.candidates.sample)
        axis = (there.centre - here.centre) / pencil.baseline
        expected = np.arccos(T_i @ axis)
        np.testing.assert_allclose(np.hypot(found.cos, found.sin), 1, atol=1e-6)
        alpha = np.arctan2(found.sin, found.cos)
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
