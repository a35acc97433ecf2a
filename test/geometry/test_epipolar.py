"""Epipolar correspondence against the closed form of a sphere."""

import numpy as np
import pytest
from spheres import Sphere, general_path, ring, unit

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.correspondence import Candidates, Pencil
from occ_recon_ros.geometry.quadric import crossed_candidates

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def views(path=ring, step=10.0, n=800):
    C, other = path(0.5 + np.radians([0, step]))
    return SPHERE.contours(C, n), SPHERE.contours(other, n, stamp_ns=2)


def epipolar_candidates(pencil, rows=None) -> Candidates:
    return crossed_candidates(pencil, rows).candidates


def in_screen_frame(T, C):
    forward = unit(SPHERE.centre - C)
    x = unit(np.cross(forward, [0.2, 0.1, 1.0]))
    return T @ np.stack([x, np.cross(forward, x)]).T


@pytest.mark.parametrize("path", [ring, general_path])
@pytest.mark.parametrize("step", [1.0, 10.0, 40.0])
def test_the_one_candidate_is_the_correspondent(path, step):
    here, there = views(path, step)
    found = epipolar_candidates(Pencil(here, there))
    assert (np.diff(found.sample) > 0).all()
    assert len(found) > 0.98 * len(here)
    directions = there.directions_at(found.row, found.fraction)
    # The defining equation (T x T_i).(C - C_i) = 0 ...
    volume = np.cross(here.T[found.sample], directions) @ (here.centre - there.centre)
    assert np.abs(volume).max() < 2e-6  # a pixel is 6e-4
    # ... and the side, from the closed form.
    T_i = dict(zip(found.sample.tolist(), directions, strict=True))
    for k in found.sample[::37]:
        expected, _ = SPHERE.correspondent(here.centre, here.T[k], here.N[k], there.centre)
        near = np.abs(here.N[k] @ unit(there.centre - here.centre))
        assert np.linalg.norm(T_i[k] - expected) < (5e-6 if near > 0.1 else 1e-3)


def test_no_sample_beyond_the_frontier_point_is_matched_to_the_far_side():
    here, there = views()
    found = epipolar_candidates(Pencil(here, there))
    # The order rule: normals of correspondents never oppose each other.
    N_i = there.normals_at(found.row, found.fraction)
    assert (np.einsum("nk,nk->n", here.N[found.sample], N_i) > 0.8).all()


def test_reversing_both_loops_changes_nothing():
    here, there = views(n=400)
    found = epipolar_candidates(Pencil(here, there))

    def reverse(c):
        T, N, uv = (np.ascontiguousarray(part[::-1]) for part in (c.T, c.N, c.uv))
        return Contours(c.stamp_ns, c.frame_id, c.centre, T, N, uv, c.loop, c.sigma)

    back = epipolar_candidates(Pencil(reverse(here), reverse(there)))
    both, i, j = np.intersect1d(found.sample, 399 - back.sample, return_indices=True)
    assert len(both) > 390
    T_i = there.directions_at(found.row, found.fraction)
    T_back = reverse(there).directions_at(back.row, back.fraction)
    np.testing.assert_allclose(T_i[i], T_back[j], atol=1e-6)


def test_two_bodies_give_two_candidates():
    other_sphere = Sphere(np.array([0.0, 0.55, 0.0]), 0.2)
    C, C_i = ring(np.radians([0.0, 10.0]))

    def both(C, stamp):
        a, b = SPHERE.contours(C, 300, stamp), other_sphere.contours(C, 300, stamp)
        frame = [np.concatenate([getattr(a, k), getattr(b, k)]) for k in ("T", "N")]
        uv = 1600 * in_screen_frame(frame[0], C)
        loop = np.repeat(np.array([4, 9], np.uint16), 300)
        return Contours(stamp, "object", C, *frame, uv, loop, np.full(600, 1e-9))

    here, there = both(C, 1), both(C_i, 2)
    found = epipolar_candidates(Pencil(here, there))
    count = np.bincount(found.sample, minlength=600)
    assert count.max() == 2
    two = count[found.sample] == 2
    assert two.sum() > 600
    loops = there.loop[found.row][two].reshape(-1, 2)
    assert (np.sort(loops, axis=1) == [4, 9]).all()


def test_a_camera_that_moved_along_a_ray_is_said():
    C = np.array([1.3, 0.0, 0.2])
    here = SPHERE.contours(C, 400)
    there = SPHERE.contours(C + 0.3 * here.T[7], 400, stamp_ns=2)
    pencil = Pencil(here, there)
    assert np.flatnonzero(pencil.along_ray).tolist() == [7]
    assert 7 not in epipolar_candidates(pencil).sample


def test_the_epipole_inside_the_outline_is_no_trouble():
    C = np.array([1.4, 0.02, 0.05])
    here = SPHERE.contours(C, 500)
    there = SPHERE.contours(C + 0.1 * (SPHERE.centre - C), 500, stamp_ns=2)
    found = epipolar_candidates(Pencil(here, there))
    assert np.bincount(found.sample, minlength=500).tolist().count(1) >= 498
    T_i = there.directions_at(found.row, found.fraction)
    volume = np.cross(here.T[found.sample], T_i) @ (here.centre - there.centre)
    assert np.abs(volume).max() < 2e-6


def test_the_same_centre_has_no_candidates():
    here, _ = views()
    pencil = Pencil(here, here)
    assert len(epipolar_candidates(pencil)) == 0
    assert pencil.along_ray.all()


def test_only_the_samples_asked_for_are_looked_up():
    here, there = views(n=300)
    pencil, asked = Pencil(here, there), np.arange(300) % 7 == 0
    every, some = epipolar_candidates(pencil), epipolar_candidates(pencil, asked)
    of_asked = every.take(asked[every.sample])
    for name in ("sample", "row", "fraction"):
        np.testing.assert_array_equal(getattr(some, name), getattr(of_asked, name))
