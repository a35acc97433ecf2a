"""The compiled loops of carving and closing do what their NumPy forms do."""

import dataclasses

import numpy as np
import pytest

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.compiled import compiled
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import closing, cone
from occ_recon_ros.surface.cone import Cone
from occ_recon_ros.surface.sweep import Samples


@pytest.fixture
def view() -> Contours:
    """Of a body with two loops, with a gap in the outline."""
    camera = turntable_cameras(TurntableSettings(width=320, height=240))[0]
    exact = make_object("mug").exact_contours(camera)
    kept = np.arange(len(exact)) % len(exact) > 25
    parts = {name: getattr(exact, name)[kept] for name in ("T", "N", "uv", "loop", "sigma")}
    return dataclasses.replace(exact, **parts)


def test_a_cone_and_how_far_outside_of_it_points_are(view, monkeypatch):
    assert compiled("surface") is not None
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (2000, 3))
    points[::50] = 3 * view.centre  # behind the camera
    fast = Cone(view)
    outside = fast.outside(points)
    monkeypatch.setattr(cone, "compiled", lambda package: None)
    slow = Cone(view)
    assert (np.abs(slow.image) < 1).sum() > 500
    assert slow.unknown.any()
    np.testing.assert_allclose(fast.image, slow.image, rtol=1e-6)
    np.testing.assert_allclose(outside, slow.outside(points), rtol=1e-5, atol=1e-9)


def test_a_step_towards_samples(monkeypatch):
    rng = np.random.default_rng(1)
    away = rng.normal(size=(400, 3))
    normals = away / np.linalg.norm(away, axis=1, keepdims=True)
    samples = Samples(normals, normals, rng.random(400))
    x, rows = 1.02 * normals[:100], rng.integers(0, 401, (100, 24))
    fast = closing._step(x, normals[:100], rows, samples, 0.5)
    monkeypatch.setattr(closing, "compiled", lambda package: None)
    slow = closing._step(x, normals[:100], rows, samples, 0.5)
    known = slow[0] > 1e-3
    assert known.sum() > 50
    for one, two in zip(fast, slow, strict=True):
        np.testing.assert_allclose(one[known], two[known], rtol=1e-9, atol=1e-12)
