"""Frontier points: known on a sphere, and a measure of the error of poses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from spheres import Sphere, general_path, ring, unit

from occ_recon_ros.geometry import RimReconstructor, Status
from occ_recon_ros.geometry.correspondence import Pencil
from occ_recon_ros.geometry.frontier import frontier_points

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def views(path, n=1500):
    C, C_i = path(0.4 + np.radians([0, 10]))
    return SPHERE.contours(C, n), SPHERE.contours(C_i, n, stamp_ns=2)


@pytest.mark.parametrize("path", [ring, general_path])
def test_a_sphere_has_two_where_the_planes_touch_it(path):
    here, there = views(path)
    found = frontier_points(Pencil(here, there))
    assert len(found) == 2
    # On the sphere, with the normal across both rays: a point of both rims.
    away = found.points - SPHERE.centre
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.2, rtol=1e-4)
    for c in (here, there):
        ray = unit(found.points - c.centre)
        assert np.abs(np.einsum("nk,nk->n", ray, unit(away))).max() < 1e-3
    pixel = here.radians_per_pixel
    assert np.abs(found.error).max() < 0.01 * pixel


@pytest.mark.parametrize("tilt_px", [0.5, -2.0])
def test_a_wrong_pose_shows_as_the_error(tilt_px):
    here, there = views(ring)
    # The second camera is believed to look higher or lower than it did.
    side = unit(np.cross(there.T.mean(axis=0), [0, 0, 1]))
    R = Rotation.from_rotvec(tilt_px / 1600 * side).as_matrix()
    wrong = replace(there, T=there.T @ R.T, N=there.N @ R.T)
    found = frontier_points(Pencil(here, wrong))
    assert len(found) == 2
    np.testing.assert_allclose(np.abs(found.error) * 1600, abs(tilt_px), rtol=0.1)


def test_views_from_one_centre_have_none():
    here, _ = views(ring)
    assert len(frontier_points(Pencil(here, here))) == 0


def test_parallel_rays_meet_nowhere():
    """As in a camera that moved aside and saw the very same outline."""
    contours = Sphere(np.zeros(3), 0.1).contours(ring([0.0])[0], 400, stamp_ns=1)
    moved = replace(contours, centre=contours.centre + np.array([0.0, 0.1, 0.0]), stamp_ns=2)
    assert len(frontier_points(Pencil(contours, moved)).row) == 0


def test_noise_makes_no_crowd_of_them():
    here, there = views(ring)
    rng = np.random.default_rng(0)

    def shake(c):
        T = c.T + 0.1 / 1600 * rng.standard_normal((len(c), 1)) * c.N
        return replace(c, T=unit(T))

    assert len(frontier_points(Pencil(shake(here), shake(there)))) <= 2


def test_the_reconstructor_reports_them_and_what_they_say_of_the_poses():
    centres = ring(np.radians(10) * np.arange(8))
    contours = [SPHERE.contours(C, 1000, stamp_ns=k + 1) for k, C in enumerate(centres)]
    exact = RimReconstructor()
    rims = [rim for c in contours for rim in exact.add(c)]
    assert exact.pose_error_px < 0.01
    for rim, C in zip(rims, centres[1:], strict=False):
        shared = np.flatnonzero(rim.status == Status.DOUBLE)
        assert len(shared) == 2
        depth = np.linalg.norm(rim.points[shared] - C, axis=1)
        np.testing.assert_allclose(depth, SPHERE.depth(C), rtol=1e-3)
    shaken = RimReconstructor()
    rng = np.random.default_rng(5)
    for c in contours:
        R = Rotation.from_rotvec(2 / 1600 * rng.standard_normal(3)).as_matrix()
        shaken.add(replace(c, T=c.T @ R.T, N=c.N @ R.T))
    assert 0.7 < shaken.pose_error_px < 6
