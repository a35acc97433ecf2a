"""Inside and outside of an outline, against a disc."""

import numpy as np
from spheres import Sphere, unit

from occ_recon_ros.geometry import Silhouette

SPHERE = Sphere(np.array([0.0, 0.1, 0.0]), 0.2)
C = np.array([1.3, 0.0, 0.3])


def test_distance_to_a_round_outline():
    silhouette = Silhouette(SPHERE.contours(C, 1000))
    axis = unit(SPHERE.centre - C)
    rim = np.arcsin(0.2 / np.linalg.norm(SPHERE.centre - C))
    x = unit(np.cross(axis, [0, 0, 1.0]))
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * rim, 3000)
    around = rng.uniform(0, 2 * np.pi, 3000)[:, None]
    out = np.cos(around) * x + np.sin(around) * np.cross(axis, x)
    ray = np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * out
    found = silhouette.outside(C + rng.uniform(0.5, 3, 3000)[:, None] * ray)
    # On the plane at distance 1, as the class measures.
    expected = np.tan(angle) - np.tan(rim)
    near = np.abs(expected) < 0.002
    assert near.sum() > 20
    np.testing.assert_allclose(found[near], expected[near], atol=3e-6)
    around_it = expected < 0.5 * np.tan(rim)
    np.testing.assert_allclose(found[around_it], expected[around_it], atol=0.05 * np.tan(rim))
    assert (found > 0.9 * expected)[~around_it].all()
    assert (np.sign(found) == np.sign(expected))[np.abs(expected) > 1e-5].all()


def test_unknown_points_stay_unknown():
    silhouette = Silhouette(SPHERE.contours(C, 500))
    behind = C - unit(SPHERE.centre - C)
    found = silhouette.outside(np.array([[np.nan, 0, 0], behind, SPHERE.centre]))
    assert np.isnan(found[:2]).all()
    assert found[2] < 0
