"""The compiled loops do what their NumPy forms do."""

import dataclasses

import numpy as np
import pytest

from occ_recon_ros.geometry import (
    Contours,
    RimReconstructor,
    Silhouette,
    matching,
    outline_map,
    quadric,
    silhouette,
)
from occ_recon_ros.geometry.compiled import compiled
from occ_recon_ros.geometry.matching import Partner, choose_pairs
from occ_recon_ros.geometry.warming import warm_up
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

MODULES = (matching, outline_map, quadric, silhouette)


@pytest.fixture(scope="module")
def views() -> list[Contours]:
    """Of a body with two loops and a limb before it, noisy, and with a gap in the outline."""
    cameras = turntable_cameras(TurntableSettings(frames=8, step=0.17, width=480, height=360))
    rng = np.random.default_rng(0)
    seen = []
    for k, camera in enumerate(cameras):
        exact = make_object("mug").exact_contours(camera, stamp_ns=k + 1)
        T = exact.T + rng.normal(0, 1e-4, exact.T.shape)
        T /= np.linalg.norm(T, axis=1, keepdims=True)
        kept = np.arange(len(T)) % len(T) > 25
        sigma = np.where(np.arange(len(T)) % 97 == 0, np.inf, 1e-4)
        parts = {"T": T, "N": exact.N, "uv": exact.uv, "loop": exact.loop, "sigma": sigma}
        seen.append(dataclasses.replace(exact, **{k: v[kept] for k, v in parts.items()}))
    return seen


@pytest.fixture
def numpy_only(monkeypatch: pytest.MonkeyPatch):
    """Call to go on without compiled loops."""

    def go() -> None:
        for module in MODULES:
            monkeypatch.setattr(module, "compiled", lambda: None)

    return go


def test_the_loops_are_there():
    assert compiled() is not None


def test_raise_to_outline(views, numpy_only):
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.3, 0.3, (5000, 3))
    depth = rng.normal(1.0, 0.1, len(views[1]))
    points = np.concatenate([points, views[1].centre + depth[:, None] * views[1].T])
    points[::50] = np.nan
    points[25::50] = 3 * views[0].centre  # behind
    fast = Silhouette(views[1]).outside(points)
    numpy_only()
    slow = Silhouette(views[1]).outside(points)
    assert (np.abs(slow) < 1e-3).sum() > 300
    assert np.isnan(slow).sum() > 200
    np.testing.assert_allclose(fast, slow, rtol=1e-6, atol=1e-12)


def test_nearest_cells():
    rng = np.random.default_rng(2)
    for shape, share in (((40, 61), 0.02), ((33, 20), 0.3), ((1, 9), 0.2), ((12, 1), 0.2)):
        blocked = rng.random(shape) < share
        blocked[0, -1] = True
        away = []
        i, j = np.indices(shape)
        for find in (compiled().nearest_cells, outline_map.nearest_cells):
            distance, where = find(blocked)
            assert blocked.ravel()[where].all()
            np.testing.assert_allclose(
                distance, np.hypot(where // shape[1] - i, where % shape[1] - j)
            )
            away.append(distance)
        np.testing.assert_array_equal(*away)


def test_candidates_and_pairs(views, numpy_only):
    asked = np.arange(len(views[1])) % 3 > 0

    def found():
        before, after = (Partner.of(views[1], views[k], asked) for k in (0, 2))
        pairs = choose_pairs(views[1], before, after, 1e-5, lambda x: x[:, 2] * 0)
        return before, pairs

    fast, pairs = found()
    numpy_only()
    slow, others = found()
    assert (np.bincount(slow.candidates.sample) > 1).any()
    np.testing.assert_array_equal(fast.candidates.sample, slow.candidates.sample)
    np.testing.assert_array_equal(fast.candidates.row, slow.candidates.row)
    np.testing.assert_array_equal(fast.usable, slow.usable)
    for name in ("d", "a", "sin", "cos_b", "d_other"):
        one, two = getattr(fast.cross, name), getattr(slow.cross, name)
        np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-12)
    for name in ("turned", "cos", "sin"):
        one, two = getattr(fast.crossed, name), getattr(slow.crossed, name)
        np.testing.assert_allclose(one, two, atol=1e-9)
    assert len(pairs[0]) > 0.3 * len(views[1])
    for one, two in zip(pairs, others, strict=True):
        np.testing.assert_array_equal(one, two)


def test_nearest(views, numpy_only):
    rng = np.random.default_rng(3)
    partner = Partner.of(views[1], views[2])
    depth, q = rng.normal(1.0, 0.05, len(views[1])), rng.normal(0.05, 0.02, len(views[1]))
    depth[::7] = np.nan
    q[3::7] = np.nan
    fast = matching.nearest(partner, depth, q)
    numpy_only()
    slow = matching.nearest(partner, depth, q)
    assert 0.05 < (slow >= 0).mean() < 0.95
    np.testing.assert_array_equal(fast, slow)


def test_rims_are_the_same(views, numpy_only):
    def rims():
        reconstructor = RimReconstructor()
        found = [r for v in views for r in reconstructor.add(dataclasses.replace(v))]
        return found + reconstructor.finish()

    fast = rims()
    numpy_only()
    slow = rims()
    assert sum((r.status == 0).sum() for r in slow) > 1000
    assert len(fast) == len(slow)
    for one, two in zip(fast, slow, strict=True):
        np.testing.assert_array_equal(one.status, two.status)
        np.testing.assert_allclose(one.points, two.points, rtol=1e-7)
        np.testing.assert_allclose(one.prev, two.prev, rtol=1e-7)


def test_warming_up_compiles_what_rims_need():
    warm_up()
    loops = compiled()
    used = [loops.nearest_cells, loops.raise_to_outline, loops.crossed_candidates]
    used += [loops.contenders, loops.nearest]
    assert [len(loop.signatures) for loop in used] == [1] * 5  # and views need no others
