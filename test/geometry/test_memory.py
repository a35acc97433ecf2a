"""A scan that goes on and on: bounded memory, and rims as good as before."""

import numpy as np
from spheres import Sphere, ring

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)


def contours_at(angles, n=120):
    return [SPHERE.contours(C, n, stamp_ns=k + 1) for k, C in enumerate(ring(np.radians(angles)))]


def settings(frames_kept):
    return RimSettings(baseline=0.15, frames_kept=frames_kept)


def depth_error(rim, contours):
    good = rim.status == Status.GOOD
    depth = np.einsum("nk,nk->n", rim.points - contours.centre, contours.T)
    return np.abs(depth - SPHERE.depth(contours.centre))[good]


def test_three_turns_hold_no_more_frames_than_are_allowed():
    contours = contours_at(3.0 * np.arange(360))
    reconstructor, all_kept = RimReconstructor(settings(40)), RimReconstructor(settings(1000))
    held, rims, expected = [], [], []
    for k, c in enumerate(contours):
        rims += reconstructor.add(c)
        held.append(len(reconstructor.centres))
        if k < 130:
            expected += all_kept.add(c)
    print(f"at most {max(held)} of {len(contours)} frames held")
    # Those kept, and at either end those that wait or are partners: 3 x 40 at the very most.
    assert max(held) <= 40 + 4 * 8 + 10
    assert max(held[240:]) == max(held[120:240])
    assert len(all_kept.centres) == 130
    # A rim for each frame, from the same partners.
    stamps = [r.stamp_ns for r in rims]
    assert stamps == list(range(stamps[0], stamps[0] + len(stamps)))
    assert len(stamps) > 360 - 2 * 9
    for rim, other in zip(rims, expected, strict=False):
        np.testing.assert_allclose(rim.points, other.points, atol=1e-9)
        np.testing.assert_array_equal(rim.prev_stamp_ns, other.prev_stamp_ns)


def test_the_turn_still_closes_and_turning_back_still_works():
    there_and_back = np.concatenate([3.0 * np.arange(121), 358 - 3.0 * np.arange(60)])
    contours = contours_at(there_and_back)
    reconstructor = RimReconstructor(settings(30))
    rims = {r.stamp_ns: r for c in contours for r in reconstructor.add(c)}
    assert len(reconstructor.centres) < 80
    waiting = set(range(1, len(contours) + 1)) - set(rims)
    owed = {r.stamp_ns: r for r in reconstructor.finish()}
    assert waiting <= set(owed)
    rims.update(owed)
    assert sorted(rims) == list(range(1, len(contours) + 1))
    for stamp, rim in rims.items():
        assert (rim.status == Status.GOOD).mean() > 0.6
        assert np.median(depth_error(rim, contours[stamp - 1])) < 5e-3


def test_a_camera_that_shakes_for_long_fills_no_memory():
    rng = np.random.default_rng(0)
    shaking = 0.05 * rng.standard_normal(400)
    contours = contours_at(np.concatenate([shaking, 3.0 * np.arange(1, 40)]), n=60)
    reconstructor = RimReconstructor(settings(20))
    held, rims = [], []
    for c in contours:
        rims += reconstructor.add(c)
        held.append(len(reconstructor.centres))
    assert max(held) <= 3 * 20 + 2
    # Once it turns, there is a rim a frame again.
    assert {r.stamp_ns for r in rims} >= set(range(405, 430))
