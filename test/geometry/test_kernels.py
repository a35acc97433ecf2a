"""The compiled loops against the plainest form of what they do."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from occ_recon_ros.geometry import Contours, Silhouette, frontier, matching
from occ_recon_ros.geometry.belief import BELIEVED, object_radius
from occ_recon_ros.geometry.compiled import compiled
from occ_recon_ros.geometry.correspondence import Pencil
from occ_recon_ros.geometry.matching import Partner
from occ_recon_ros.geometry.quadric import SAME, Crossing, solve
from occ_recon_ros.geometry.silhouette import Silhouettes
from occ_recon_ros.geometry.warming import warm_up
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras


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


def test_nearest_cells():
    rng = np.random.default_rng(2)
    for shape, share in (((40, 61), 0.02), ((33, 20), 0.3), ((1, 9), 0.2), ((12, 1), 0.2)):
        blocked = rng.random(shape) < share
        blocked[0, -1] = True
        i, j = np.indices(shape)
        distance, where = compiled("geometry.outline_kernels").nearest_cells(blocked)
        assert blocked.ravel()[where].all()
        np.testing.assert_allclose(
            distance, np.hypot(where // shape[1] - i, where % shape[1] - j), atol=1e-12
        )
        np.testing.assert_allclose(distance, distance_transform_edt(~blocked))


def test_a_point_far_enough_outside_of_one_outline_is_not_held_against_another(views):
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (2000, 3))
    several = Silhouettes([Silhouette(view) for view in views[:4]])
    each = several.ordered(np.array([2, 0, 3])).outside_px(points)
    for k, row in zip((2, 0, 3), each, strict=True):
        px = Silhouette(views[k]).outside(points) / views[k].radians_per_pixel
        np.testing.assert_allclose(row, px)
    first_out = np.argmax(each > 5, axis=0)
    until = np.arange(3)[:, None] <= np.where((each > 5).any(axis=0), first_out, 2)
    expected = np.fmax.reduce(np.where(until, each, -np.inf), axis=0)
    found = several.ordered(np.array([2, 0, 3])).worst_px(points, 5.0)
    np.testing.assert_array_equal(found, expected)
    assert 100 < (found > 5).sum() < 1900
    without = several.without(several.members[1])
    np.testing.assert_array_equal(without.worst_px(points, np.inf), several.ordered(
        np.array([0, 2, 3])).worst_px(points, np.inf))  # fmt: skip


def test_the_first_depth_inside_of_all_outlines_is_taken(views):
    view, several = views[1], Silhouettes([Silhouette(view) for view in views[2:5]])
    depth = np.random.default_rng(5).normal(1.0, 0.1, (4, len(view)))
    depth[0, ::5] = -1.0
    first = several.first_inside(view.centre, view.T, depth, 0.5)
    points = view.centre + depth[..., None] * view.T
    worst = np.stack([several.worst_px(each, np.inf) for each in points])
    fit = (worst <= 0.5) & (depth > 0)
    np.testing.assert_array_equal(first, np.where(fit.any(axis=0), np.argmax(fit, axis=0), -1))
    assert len(np.unique(first)) == 5


def test_the_cheapest_of_all_possible_pairs_is_chosen(views):
    """All pairs of some samples one by one, as ``matching`` says."""
    view, before, after = views[1], *(Partner.of(views[1], views[k]) for k in (0, 2))
    pose, one, two = 0.25 * view.radians_per_pixel, before.cross, after.cross
    size = object_radius(view, one.d[before.usable])
    rows, i, j = matching.choose_pairs(view, before, after, 0.0)
    chosen = dict(zip(rows.tolist(), zip(i, j, strict=True), strict=True))
    (own0, their0), (own1, their1) = ([c.d * np.sqrt(1 - c.sin**2), -c.d_other] for c in (one, two))
    own0, their0, own1, their1 = (
        lever / (c.cos_b * c.sin)
        for lever, c in ((own0, one), (their0, one), (own1, two), (their1, two))
    )
    rivals = 0
    for s in range(0, len(view), 3):
        pairs = []
        for m in before.usable[before.candidates.sample[before.usable] == s]:
            for k in after.usable[after.candidates.sample[after.usable] == s]:
                gap, slope = one.d[m] - two.d[k], two.a[k] - one.a[m]
                q = gap / slope  # 1 / (2 k_t)
                variance = (own0[m] - own1[k]) ** 2 * (view.sigma[s] ** 2 + pose**2)
                variance += their0[m] ** 2 * (before.sigma[m] ** 2 + pose**2)
                variance += their1[k] ** 2 * (after.sigma[k] ** 2 + pose**2)
                left = gap - slope * np.clip(q, -0.05 * size, size)
                if left**2 > BELIEVED**2 * variance:
                    continue
                turned = np.array([before.crossed.turned[m], after.crossed.turned[k]])
                cost = np.square(turned / 0.35).sum()
                if abs(slope) > SAME * (abs(one.a[m]) + abs(two.a[k])):
                    cost += np.log1p(((8 if q < 0 else 2) * q / size) ** 2)
                pairs.append((cost, (m, k)))
        rivals += len(pairs) > 1
        assert chosen.get(s) == (min(pairs)[1] if pairs else None)
    assert rivals > 10


def test_the_nearest_candidate_is_that_of_the_least_angle(views):
    rng = np.random.default_rng(3)
    view, partner = views[1], Partner.of(views[1], views[2])
    depth, q = rng.normal(1.0, 0.05, len(view)), rng.normal(0.05, 0.02, len(view))
    depth[::7], q[3::7] = np.nan, np.nan
    found = matching.nearest(partner, depth, q)
    assert 0.05 < (found >= 0).mean() < 0.95
    assert (found[::7] < 0).all()
    assert (found[3::7] < 0).all()
    candidates, other = partner.candidates, views[2]
    T = other.directions_at(candidates.row, candidates.fraction)
    away = view.centre + depth[:, None] * view.T - other.centre
    distance = np.linalg.norm(away, axis=1)
    miss = np.linalg.norm(T - (away / distance[:, None])[candidates.sample], axis=1)
    for s in np.flatnonzero(found >= 0):
        mine = candidates.sample == s
        assert candidates.sample[found[s]] == s
        assert miss[found[s]] <= miss[mine].min() + 1e-6
        turn = np.arccos(T[found[s]] @ view.T[s])
        blur = 2 * other.radians_per_pixel
        assert miss[found[s]] <= blur + 2 * turn**2 * abs(q[s]) / distance[s] + 1e-6


def test_depth_and_curvature_are_the_formulas_of_the_paper():
    rng = np.random.default_rng(4)
    (d0, d1), (a0, a1) = rng.normal(1, 0.1, (2, 4000)), rng.normal(0, 1, (2, 4000))
    a0[::5], a1[::7], a1[3::11], d0[::13] = 0, 0, a0[3::11] * 1.01, np.nan
    rest = np.zeros(4000)
    found = solve(Crossing(d0, a0, rest, rest, rest), Crossing(d1, a1, rest, rest, rest))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth, k_t = (d0 * a1 - d1 * a0) / (a1 - a0), (a1 - a0) / (2 * (d0 - d1))
    along, zero = np.isnan(d0), (a0 == 0).astype(int) + (a1 == 0)
    same = ~along & (zero < 2) & (np.abs(a1 - a0) <= SAME * (np.abs(a0) + np.abs(a1)))
    depth = np.select([along | same, zero == 2], [np.nan, (d0 + d1) / 2], depth)
    status = np.select([along, zero > 0, same], [5, 1, 2], 0)
    np.testing.assert_array_equal(found.status, status)
    np.testing.assert_allclose(found.depth, depth)
    np.testing.assert_allclose(found.curvature, np.where(along | same | (zero == 2), np.nan, k_t))
    assert (np.bincount(status, minlength=6)[[0, 1, 2, 5]] > 100).all()


def test_an_angle_turns_back_where_its_parabola_does():
    """Loop by loop, with a fit of NumPy's about each sample."""
    cameras = turntable_cameras(TurntableSettings(frames=8, step=0.17, width=480, height=360))
    contours, *others = (make_object("figure").exact_contours(camera) for camera in cameras)
    offsets, expected, found = np.arange(-6, 7), [], []
    for phi in (Pencil(contours, other).here.phi for other in others):
        found.append(frontier._turns(contours, phi))
        for rows in contours.by_loop(np.arange(len(phi))):
            last = -2
            for k in range(len(rows)):
                near = rows[(k + offsets) % len(rows)]
                over = [phi[rows[(k + s) % len(rows)]] for s in (6, -6, 7, -5)]
                step = np.diff(phi[near])
                if (over[0] - over[1]) * (over[2] - over[3]) > 0 or (np.abs(step) > 1.5).any():
                    continue
                c2, c1, _ = fit = np.polyfit(offsets, phi[near], 2)
                at, way = -c1 / (2 * c2), np.sign(step[6:]).sum() - np.sign(step[:6]).sum()
                if contours.linked[near].all() and abs(at) <= 1 and way * np.sign(c2) >= 9:
                    if last != k - 1:
                        row, angle = rows[0] + (k + at) % len(rows), np.polyval(fit, at)
                        expected.append((row, angle, -np.sign(c2)))
                    last = k
    assert len(expected) > 20
    found = np.concatenate(found, axis=1)
    np.testing.assert_allclose(found, np.transpose(expected), atol=1e-7)


def test_warming_up_compiles_what_rims_need():
    warm_up()
    outline, loops = compiled("geometry.outline_kernels"), compiled()
    used = [outline.nearest_cells, outline.outside, outline.worst, outline.first_inside]
    used += [loops.cheapest_pairs, loops.propagated, loops.nearest, loops.pencil_view]
    used += [loops.turns, loops.solved, loops.on_rays, loops.crossed_candidates]
    used += [outline.on_plane, outline.placed, outline.filled, loops.tangent_planes]
    assert [len(loop.signatures) for loop in used] == [1] * 16  # and views need no others
