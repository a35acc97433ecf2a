"""The analytic solids: their distances, normals, curvatures and meshes."""

import numpy as np
import pytest
from curvature import principal_curvatures
from scipy.spatial import cKDTree

from occ_recon_ros.scene import OBJECTS, make_object
from occ_recon_ros.scene.catalogue import sphere

MANY_PARTS = ("mug", "figure")


@pytest.mark.parametrize("name", OBJECTS)
def test_the_surface_is_at_distance_zero_and_its_normal_measures_distance(name):
    scene_object = make_object(name)
    points, normals = scene_object.surface_samples(60)
    assert np.abs(scene_object.distance(points)).max() < 1e-12
    # Outwards and inwards by less than any radius of curvature, where no other part is.
    for offset in (2e-4, -2e-4):
        moved = points + offset * normals
        distance = scene_object.distance(moved)
        # Another part may be nearer, or deeper around the point, but none is farther.
        assert (distance - offset).max() < 1e-12
        agrees = np.abs(distance - offset) < 1e-12
        assert agrees.mean() > (0.96 if name in MANY_PARTS else 0.9999)


@pytest.mark.parametrize("name", OBJECTS)
def test_the_distance_is_that_of_the_nearest_of_many_surface_points(name):
    scene_object = make_object(name)
    dense, _ = scene_object.surface_samples(400)
    points = np.random.default_rng(1).uniform(-0.15, 0.15, (1000, 3))
    nearest, spacing = cKDTree(dense).query(points)[0], 3e-3
    distance = scene_object.distance(points)
    # Never beyond a surface point, and short of the nearest one by its spacing at most.
    # Far off, where two places are nearly as near, it may take the other one.
    outside, near = distance > 0, nearest < 0.01
    beyond = np.abs(distance) - nearest
    assert beyond[outside].max() < 2e-5
    assert beyond[outside & near].max() < 1e-9
    assert beyond[outside].min() > -spacing
    assert ((distance < 0) == scene_object.inside(points)).all()
    if name not in MANY_PARTS:
        assert beyond.max() < 2e-5


@pytest.mark.parametrize("name", OBJECTS)
def test_curvatures_are_those_of_finite_differences_of_the_distance(name):
    scene_object = make_object(name)
    points, _ = scene_object.surface_samples(24)
    # The Laplacian of the distance is the sum of the principal curvatures.
    h = 1e-5
    steps = h * np.concatenate([np.eye(3), -np.eye(3)])
    around = scene_object.distance((points[:, None] + steps).reshape(-1, 3)).reshape(-1, 6)
    centre = scene_object.distance(points)
    laplacian = (around.sum(1) - 6 * centre) / h**2
    k_min, k_max = principal_curvatures(scene_object, points)
    agrees = np.abs(laplacian - (k_min + k_max)) < 1e-2 + 1e-3 * np.abs(k_max)
    assert (k_min <= k_max).all()
    assert agrees.mean() > (0.97 if name in MANY_PARTS else 0.9999)


def test_a_sphere_curves_by_its_radius_both_ways():
    ball = sphere(0.25, (0.1, -0.2, 0.3))
    points, _ = ball.surface_samples(30)
    np.testing.assert_allclose(principal_curvatures(ball, points), 4.0, atol=1e-7)
    np.testing.assert_allclose(ball.distance(np.array([[0.1, -0.2, 0.3]])), -0.25, atol=1e-12)


def test_the_torus_is_a_saddle_inside_and_round_outside():
    torus = make_object("torus")
    inside, outside = np.array([[0.045, 0, 0]]), np.array([[0.095, 0, 0]])
    np.testing.assert_allclose(
        np.ravel(principal_curvatures(torus, inside)), [-1 / 0.045, 1 / 0.025], rtol=1e-9
    )
    np.testing.assert_allclose(
        np.ravel(principal_curvatures(torus, outside)), [1 / 0.095, 1 / 0.025], rtol=1e-9
    )


@pytest.mark.parametrize("name", [name for name in OBJECTS if name not in MANY_PARTS])
def test_meshes_are_closed_outward_and_on_the_surface(name):
    scene_object = make_object(name)
    mesh = scene_object.mesh(120)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.euler_number == (0 if name == "torus" else 2)
    assert np.abs(scene_object.distance(np.asarray(mesh.vertices))).max() < 1e-12


def test_the_volume_of_a_mesh_tends_to_that_of_the_solid():
    assert make_object("torus").mesh(600).volume == pytest.approx(
        2 * np.pi**2 * 0.07 * 0.025**2, rel=1e-3
    )
    assert make_object("ellipsoid").mesh(600).volume == pytest.approx(
        4 / 3 * np.pi * 0.09 * 0.065 * 0.1, rel=1e-3
    )


def test_the_vase_is_elliptic_and_as_high_as_it_says():
    vase = make_object("vase")
    points, _ = vase.surface_samples(200)
    assert np.ptp(points[:, 2]) == pytest.approx(0.2, abs=1e-12)
    assert np.ptp(points[:, 0]) / np.ptp(points[:, 1]) == pytest.approx(0.075 / 0.06, rel=1e-9)


def test_an_unknown_object_is_refused_by_name():
    with pytest.raises(ValueError, match=r"unknown object .teapot.: .*vase"):
        make_object("teapot")
