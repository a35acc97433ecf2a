"""Streaming reconstruction: frames in, rims out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from spheres import Sphere, general_path, ring

from occ_recon_ros.geometry import Contours, RimReconstructor, RimSettings, Status
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)
STEP = np.radians(10)


def frames(centres, n=500):
    return [SPHERE.contours(C, n, stamp_ns=k + 1) for k, C in enumerate(centres)]


def run(contours, baseline=0.17, finish=True):
    reconstructor = RimReconstructor(RimSettings(baseline=baseline))
    rims = [rim for c in contours for rim in reconstructor.add(c)]
    return rims + (reconstructor.finish() if finish else [])


def depth_errors(rim, contours):
    good = rim.status == Status.GOOD
    depth = np.einsum("nk,nk->n", rim.points - contours.centre, contours.T)
    return (depth - SPHERE.depth(contours.centre))[good]


def test_a_rim_appears_one_frame_late_and_has_a_row_for_each_sample():
    reconstructor = RimReconstructor()
    stamps = [[r.stamp_ns for r in reconstructor.add(c)] for c in frames(ring(STEP * np.arange(5)))]
    assert stamps == [[], [], [2], [3], [4]]
    contours = frames(ring(STEP * np.arange(3)))
    (rim,) = run(contours, finish=False)
    assert len(rim) == len(contours[1])
    assert (rim.loop == contours[1].loop).all()
    assert rim.normals is contours[1].N


@pytest.mark.parametrize("path", [ring, general_path])
def test_depth_error_falls_with_the_step(path):
    errors = []
    for step in np.radians([10, 5, 2.5]):
        # Uneven steps, for on a sphere the error of even ones cancels.
        contours = frames(path(0.4 + step * np.array([0, 1, 2.4])), n=6000)
        (rim,) = run(contours, baseline=0.7 * step, finish=False)
        assert (rim.status == Status.GOOD).mean() > 0.85
        errors.append(np.median(np.abs(depth_errors(rim, contours[1]))))
        print(f"{np.degrees(step):4.1f} deg: depth error {errors[-1]:.2e} m, k_t", end=" ")
        print(f"{np.nanmedian(rim.curvature):.4f} of {1 / 0.2:.0f} 1/m")
        assert np.nanmedian(rim.curvature) == pytest.approx(1 / 0.2, rel=step**2)
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 3
    assert errors[1] / errors[2] > 3


@settings(max_examples=10, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-2, 2)] * 3),
    scale=st.floats(0.1, 10),
)
def test_moving_and_scaling_the_scene_moves_and_scales_the_result(turn, shift, scale):
    R = Rotation.from_rotvec(turn).as_matrix()
    still = frames(general_path(STEP * np.arange(3)), n=300)
    moved = [
        replace(c, centre=scale * (R @ c.centre) + shift, T=c.T @ R.T, N=c.N @ R.T) for c in still
    ]
    (a,), (b,) = run(still, 0.12, finish=False), run(moved, 0.12, finish=False)
    size = 0.2
    np.testing.assert_array_equal(a.status, b.status)
    expected = scale * (a.points @ R.T) + shift
    good = a.status == Status.GOOD
    difference = np.linalg.norm(b.points - expected, axis=1)[good]
    assert difference.max() < 1e-6 * size * scale
    np.testing.assert_allclose(np.median(b.curvature[good] * scale), np.median(a.curvature[good]))


def test_a_mirrored_scene_gives_the_mirrored_rim():
    mirror = np.array([1.0, -1.0, 1.0])
    still = frames(general_path(STEP * np.arange(3)), n=300)
    mirrored = [
        Contours(
            c.stamp_ns,
            c.frame_id,
            c.centre * mirror,
            c.T[::-1] * mirror,
            c.N[::-1] * mirror,
            c.uv[::-1] * [-1, 1],
            c.loop,
            c.sigma,
        )
        for c in still
    ]
    (a,), (b,) = run(still, 0.12, finish=False), run(mirrored, 0.12, finish=False)
    good = (a.status == Status.GOOD) & (b.status[::-1] == Status.GOOD)
    assert good.mean() > 0.9
    np.testing.assert_allclose(b.points[::-1][good] * mirror, a.points[good], atol=2e-6)


def test_the_order_of_the_loops_does_not_matter():
    cameras = turntable_cameras(TurntableSettings(elevation=0.6))[:5]
    torus = make_object("torus")
    given = [torus.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(cameras)]
    rows = [np.roll(np.arange(len(c)), -c.loop_starts[1]) for c in given]
    columns = ("T", "N", "uv", "loop", "sigma")
    swapped = [
        replace(c, **{name: getattr(c, name)[order] for name in columns})
        for c, order in zip(given, rows, strict=True)
    ]
    assert all(len(c.loop_starts) == 3 for c in given + swapped)
    one, other = RimReconstructor(), RimReconstructor()
    for c, d in zip(given, swapped, strict=True):
        for rim, same in zip(one.add(c), other.add(d), strict=True):
            order = rows[rim.stamp_ns - 1]
            np.testing.assert_array_equal(rim.status[order], same.status)
            np.testing.assert_allclose(rim.points[order], same.points, rtol=0, atol=1e-11)


def test_a_full_turn_closes_with_a_rim_for_every_frame():
    contours = frames(ring(STEP * np.arange(36)))
    rims = run(contours)
    # The rims of later stamps gave some of them a few points more: these come again.
    assert [r.stamp_ns for r in rims[:36]] == [*range(2, 36), 36, 1]
    assert rims[35].prev_stamp_ns == 36
    assert rims[0].prev_stamp_ns == 1
    for rim in rims:
        assert (rim.status == Status.GOOD).mean() > 0.85
        assert np.median(np.abs(depth_errors(rim, contours[rim.stamp_ns - 1]))) < 2e-4
        assert np.isfinite(rim.prev).mean() > 0.97


def test_a_partial_turn_gives_its_end_frames_rims_from_one_side():
    contours = frames(ring(STEP * np.arange(8)))
    rims = {r.stamp_ns: r for r in run(contours)}
    assert sorted(rims) == list(range(1, 9))
    assert rims[1].prev_stamp_ns is None
    assert np.isnan(rims[1].prev).all()
    for stamp in (1, 8):
        assert (rims[stamp].status == Status.GOOD).mean() > 0.7
        assert np.median(np.abs(depth_errors(rims[stamp], contours[stamp - 1]))) < 5e-3


def test_prev_is_the_row_of_the_correspondent_in_the_frame_before():
    contours = frames(ring(STEP * np.arange(4)))
    rim = run(contours, finish=False)[1]
    before = contours[1]
    known = np.flatnonzero(np.isfinite(rim.prev))
    row = np.floor(rim.prev[known]).astype(int)
    f = (rim.prev[known] - row)[:, None]
    T_i = (1 - f) * before.T[row] + f * before.T[before.next_row[row]]
    for k, ray in list(zip(known, T_i, strict=True))[::29]:
        expected, _ = SPHERE.correspondent(
            contours[2].centre, contours[2].T[k], contours[2].N[k], before.centre
        )
        assert np.linalg.norm(ray - expected) < 1e-3


def test_fine_steps_keep_a_rim_a_frame_and_the_depth_of_the_baseline():
    contours = frames(ring(np.radians(0.5) * np.arange(100)), n=2000)
    rims = run(contours, finish=False)
    # Partners lie 20 frames away on either side.
    assert [r.stamp_ns for r in rims] == list(range(rims[0].stamp_ns, rims[-1].stamp_ns + 1))
    assert len(rims) >= 100 - 2 * 20
    for rim in rims[::10]:
        assert np.median(np.abs(depth_errors(rim, contours[rim.stamp_ns - 1]))) < 3e-4
        assert np.isfinite(rim.prev).mean() > 0.9


def test_pauses_and_uneven_steps_lose_nothing():
    angles = np.array([0, 7, 7, 7, 16, 30, 30, 41, 50.0])
    contours = frames(ring(np.radians(angles)))
    rims = run(contours, baseline=0.12)
    moved = {1, 2, 5, 6, 8, 9}
    assert {r.stamp_ns for r in rims} == moved
    for rim in rims:
        assert (rim.status == Status.GOOD).mean() > 0.85


def test_turning_back_still_gives_every_rim():
    angles = np.array([0, 10, 20, 30, 20.5, 10.5, 0.5, -9])
    contours = frames(ring(np.radians(angles)))
    rims = {r.stamp_ns: r for r in run(contours, baseline=0.15)}
    assert sorted(rims) == list(range(1, 9))
    for stamp, rim in rims.items():
        assert (rim.status == Status.GOOD).mean() > 0.8
        assert np.median(np.abs(depth_errors(rim, contours[stamp - 1]))) < 3e-3


def test_frames_out_of_order_are_refused():
    reconstructor = RimReconstructor()
    first, second, _ = frames(ring(STEP * np.arange(3)))
    reconstructor.add(second)
    with pytest.raises(ValueError, match="order"):
        reconstructor.add(first)


def test_an_empty_frame_is_passed_over():
    contours = frames(ring(STEP * np.arange(4)))
    none = replace(
        contours[1],
        T=np.zeros((0, 3)),
        N=np.zeros((0, 3)),
        uv=np.zeros((0, 2)),
        loop=np.zeros(0, np.uint16),
        sigma=np.zeros(0),
    )
    rims = run([contours[0], none, *contours[2:]], finish=False)
    assert [r.stamp_ns for r in rims] == [3]
    assert (rims[0].status == Status.GOOD).mean() > 0.85


def test_samples_that_may_make_no_surface_make_none():
    contours = frames(ring(STEP * np.arange(3)))
    sigma = contours[1].sigma.copy()
    sigma[100:140] = np.inf
    (rim,) = run([contours[0], replace(contours[1], sigma=sigma), contours[2]], finish=False)
    assert (rim.status[100:140] == Status.NO_CORRESPONDENT).all()
    assert (rim.status == Status.GOOD).mean() > 0.85


def test_errors_have_the_predicted_sigma():
    rng = np.random.default_rng(1)
    sigma = 1e-4
    scores = []
    for _ in range(20):
        contours = frames(ring(STEP * np.arange(3)), n=200)
        noisy = []
        for c in contours:
            # Smooth errors, as of a smoothed contour, so that its tangents stay right.
            phase, wave = rng.uniform(0, 6.3, 4), np.arange(1, 5)
            angle = np.linspace(0, 2 * np.pi, len(c), endpoint=False)
            error = sigma * np.sqrt(2 / 4) * np.cos(wave * angle[:, None] + phase).sum(axis=1)
            T = c.T + error[:, None] * c.N
            noisy.append(
                replace(c, T=T / np.linalg.norm(T, axis=1)[:, None], sigma=c.sigma * 0 + sigma)
            )
        (rim,) = run(noisy, finish=False)
        known = (rim.status == Status.GOOD) & (rim.depth_sigma < 0.01)
        depth = np.einsum("nk,nk->n", rim.points - contours[1].centre, noisy[1].T)
        scores.append(((depth - SPHERE.depth(contours[1].centre)) / rim.depth_sigma)[known])
    spread = np.std(np.concatenate(scores))
    assert 0.8 < spread < 1.25


def test_a_point_outside_another_silhouette_is_given_up():
    contours = frames(ring(STEP * np.arange(12)))
    # A dent in the sixth view: the points that it cuts off are wrong.
    cut = contours[5]
    dent = np.zeros(len(cut))
    dent[200:260] = -0.05 * np.sin(np.linspace(0, np.pi, 60))
    T = cut.T + dent[:, None] * cut.N
    contours[5] = replace(cut, T=T / np.linalg.norm(T, axis=1)[:, None])
    rims = {r.stamp_ns: r for r in run(contours)}
    assert (rims[10].status == Status.OUTSIDE).any()
    # A rim that was out before the dent came is corrected when the turn is finished.
    before = {r.stamp_ns: r for r in run(contours[:5], finish=False)}
    assert not (before[3].status == Status.OUTSIDE).any()
    assert (rims[3].status == Status.OUTSIDE).any()
    # Only points that were not good may be found anew, by other partners.
    good = before[3].status == Status.GOOD
    np.testing.assert_array_equal(rims[3].points[good], before[3].points[good])


def test_without_silhouettes_to_check_no_point_is_outside():
    settings = RimSettings(silhouette_checks=0)
    reconstructor = RimReconstructor(settings)
    rims = [rim for c in frames(ring(STEP * np.arange(6))) for rim in reconstructor.add(c)]
    rims += reconstructor.finish()
    assert {r.stamp_ns for r in rims} == set(range(1, 7))
    assert not any((rim.status == Status.OUTSIDE).any() for rim in rims)
