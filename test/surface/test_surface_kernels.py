"""The compiled loops of carving and closing against the plainest form of what they do."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.compiled import compiled
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface.cone import Cone


@pytest.fixture
def view() -> Contours:
    """Of a body with two loops, with a gap in the outline."""
    camera = turntable_cameras(TurntableSettings(width=320, height=240))[0]
    exact = make_object("mug").exact_contours(camera)
    kept = np.arange(len(exact)) % len(exact) > 25
    parts = {name: getattr(exact, name)[kept] for name in ("T", "N", "uv", "loop", "sigma")}
    return dataclasses.replace(exact, **parts)


def test_how_far_outside_of_a_cone_points_are(view):
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (2000, 3))
    points[::50] = 3 * view.centre  # behind the camera
    cone = Cone(view)
    local = (points - cone.centre) @ cone.axes.T
    at = (local[:, :2] / local[:, 2:] - cone.low) / cone.pixel
    near = np.clip(at, 0, np.array(cone.image.shape[::-1]) - 1.0)
    expected = map_coordinates(cone.image, near.T[::-1], order=1, output=float)
    expected += np.where(expected > 0, np.linalg.norm(at - near, axis=1), 0)
    expected *= cone.pixel * local[:, 2]
    expected[local[:, 2] <= 0] = -np.inf
    assert np.isinf(expected).sum() == 40
    np.testing.assert_allclose(cone.outside(points), expected, rtol=1e-4, atol=1e-7)


def test_pixels_near_the_outline_hold_their_distance_from_its_sides(view):
    cone = Cone(view)
    xy = cone.pixels_of(view.centre + view.T)
    a, b = xy[view.linked], xy[view.next_row[view.linked]]
    v, u = np.nonzero((np.abs(cone.image) < 2) & ~cone.unknown)
    points = np.column_stack([u, v])[::7]
    along = b - a
    part = ((points[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
    foot = a + np.clip(part, 0, 1)[..., None] * along
    distance = np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)
    gap = ~view.linked
    ends = np.concatenate([xy[gap], xy[view.next_row[gap]]])
    away = np.linalg.norm(points[:, None] - ends, axis=2).min(axis=1)
    sides = (distance < 3) & (away > 6)  # not along the chord over the gap
    assert sides.sum() > 300
    off = np.abs(np.abs(cone.image[v, u])[::7] - distance)[sides]
    assert (off < 1e-5).mean() > 0.98  # in sharp corners a side beyond the next may be nearest


def test_a_step_towards_samples():
    """Implicit moving least squares: weights fall with the distance, planes bend with the sheet."""
    rng = np.random.default_rng(1)
    away = rng.normal(size=(400, 3))
    points = away / np.linalg.norm(away, axis=1, keepdims=True)
    weights, rows = rng.random(400), rng.integers(0, 401, (100, 24))
    x = 1.02 * points[:100]
    step = compiled("surface.kernels").projected
    found = step(x, points[:100], rows, points, points, weights, 0.5, 0.5)
    for k in range(0, 100, 9):
        near = rows[k][rows[k] < 400]
        near = near[points[near] @ points[k] > 0.5]
        to = x[k] - points[near]
        w = weights[near] * np.exp(-0.5 * (to**2).sum(axis=1) / 0.5**2)
        total, mean = w.sum(), (w[:, None] * points[near]).sum(axis=0) / w.sum()
        height = (to * points[near]).sum(axis=1) + to @ mean / np.linalg.norm(mean)
        aside = np.linalg.norm((w[:, None] * to).sum(axis=0)) / total
        expected = total, mean, 0.5 * (w * height).sum() / total, aside
        for one, two in zip((part[k] for part in found), expected, strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-12)
