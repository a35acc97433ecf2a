"""Scans that are short, stop, go back, go on, and end oddly; rims that come as they like."""

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rims import SPHERE_RADIUS
from scipy.spatial.transform import Rotation
from spheres import Sphere, ring

from occ_recon_ros.geometry import RimReconstructor, Status
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import Surface
from occ_recon_ros.surface.stamps import StampRuns

SPANS = (5, 15, 25, 35, 40, 50, 60, 75, 90)
STEPS = (1, 2.5, 5, 10, 15)


def views_of(angles, elevation=0.2, samples=60):
    """Contours of a sphere seen from angles, degrees, at an elevation, rad."""
    sphere = Sphere(np.zeros(3), SPHERE_RADIUS)
    centres = ring(np.radians(angles), np.cos(elevation), np.sin(elevation))
    return [sphere.contours(C, samples, stamp_ns=10 * (k + 1)) for k, C in enumerate(centres)]


@cache
def rims_of(angles, elevation=0.2, samples=60):
    """Rims of such views: those that come on the way, and those of the finish."""
    reconstructor, views = RimReconstructor(), views_of(angles, elevation, samples)
    return [rim for view in views for rim in reconstructor.add(view)], reconstructor.finish()


def take(surface, rims):
    """Add or revise; the number of triangles after each rim."""
    counts = []
    for rim in rims:
        (surface.revise if rim.stamp_ns in surface else surface.add)(rim)
        counts.append(len(surface))
    return counts


def layers(surface):
    """Mean number of triangles that rays from the middle meet, of rays that meet any."""
    rays = np.random.default_rng(0).normal(size=(600, 3))
    a, b, c = surface.whole().corners.astype(float).swapaxes(0, 1)
    sides = [rays @ np.cross(p, q).T > 1e-12 for p, q in ((a, b), (b, c), (c, a))]
    met = np.logical_and.reduce(sides).sum(axis=1)
    return met[met > 0].mean() if met.any() else 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "elevation"), [*((step, 0.2) for step in STEPS), (2.5, 1.0), (10, 1.0)]
)
def test_finishing_a_short_scan_takes_nothing_away(step, elevation):
    reconstructor, surface, before = RimReconstructor(), Surface(), 0
    spans = SPANS[:: 2 if step == 1 else 1]
    ends = {int(span // step): span for span in spans if span >= step}
    for k, view in enumerate(views_of(np.arange(0, SPANS[-1] + 1e-9, step), elevation)):
        before = max([before, *take(surface, reconstructor.add(view))])
        if k not in ends:
            continue
        # As a scan that ends here.
        ended, last = deepcopy(surface), deepcopy(reconstructor).finish()
        assert min(take(ended, last), default=before) >= before, ends[k]
        # Seen from all around two of them lie one on the other, left and right outline.
        assert layers(ended) < 1.03, ends[k]


@pytest.mark.parametrize(("frames", "elevation"), [(14, 0.35), (17, 0.35), (20, 1.0)])
def test_a_vase_turned_a_little_keeps_what_it_had(frames, elevation):
    size = {"width": 320, "height": 240, "focal_px": 400.0}
    step = np.radians(2.5)
    cameras = turntable_cameras(
        TurntableSettings(frames=frames, step=step, elevation=elevation, **size)
    )
    vase, reconstructor, surface = make_object("vase"), RimReconstructor(), Surface()
    views = [vase.exact_contours(camera, 2.0, 1 + k) for k, camera in enumerate(cameras)]
    before = take(surface, [rim for view in views for rim in reconstructor.add(view)])[-1]
    assert before > 500
    after = take(surface, reconstructor.finish())
    # What a silhouette refutes may go, and that is little.
    assert min(after) > 0.98 * before
    assert after[-1] > before


WALKS = {
    "stops": [*range(0, 50, 5), *[45] * 8],
    "stops and goes on": [*range(0, 50, 5), *[45] * 5, *range(50, 90, 5)],
    "goes back": [*range(0, 50, 5), *range(40, 5, -5)],
    "goes back and on": [*range(0, 50, 5), *range(40, 15, -5), *range(20, 90, 5)],
    "goes back in other steps": [*range(0, 60, 10), *range(46, 10, -7)],
    "goes back in finer steps": [*range(0, 60, 10), *range(48, 10, -2)],
    "goes back in coarser steps": [*range(0, 60, 2), *range(48, 10, -10)],
    "swings": [*range(0, 30, 3), *range(24, 0, -3), *range(3, 30, 3), *range(24, 0, -3)],
    "leaps back to its start": [*range(0, 60, 5), 0],
    "leaps to and fro": [0, 10, 20, 60, 10, 20, 30, 40, 0, 50, 60],
    "leaps and fills in": [0.0, 9.2, 24.2, 39.2, 54.2, 16.4],
    "shakes where it stands": [*range(0, 30, 3), *(27 + 0.02 * np.sin(range(20))), 30, 33, 36],
    "ends beyond the turn": [*range(0, 370, 10), 364, 374, 384],
    "a turn and a half": [*range(0, 550, 10)],
    "backwards": [*range(90, -1, -5)],
}


SEEN_FROM_ABOVE = ("stops and goes on", "goes back and on", "swings", "a turn and a half")


@pytest.mark.parametrize(
    ("walk", "elevation"),
    [*((walk, 0.2) for walk in WALKS), *((walk, 1.0) for walk in SEEN_FROM_ABOVE)],
)
def test_a_scan_may_end_oddly(walk, elevation):
    walk = WALKS[walk]
    on_the_way, last = rims_of(tuple(float(a) for a in walk), elevation)
    surface = Surface()
    before = max(take(surface, on_the_way), default=0)
    after = take(surface, last)
    assert (after[-1] if after else before) >= before
    span = max(walk) - min(walk)
    if span < 65 and walk != WALKS["leaps to and fro"]:
        # At its end a way may lie upon a part of one older step.
        assert layers(surface) < 1 + 13 / span


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_no_walk_loses_by_finishing(seed):
    rng = np.random.default_rng(seed)
    angles, step = [0.0], rng.choice(STEPS)
    for _ in range(rng.integers(1, 7)):
        count = int(rng.integers(1, 9))
        way = rng.choice([1, 1, -1, 0])
        angles += list(angles[-1] + way * step * np.arange(1, count + 1))
        if rng.random() < 0.3:
            angles.append(angles[-1] + rng.uniform(-3, 3) * step)
            step = rng.choice(STEPS)
    on_the_way, last = rims_of(tuple(angles), rng.choice([0.2, 1.0]))
    surface = Surface()
    before = max(take(surface, on_the_way), default=0)
    # Where steps lie between others, the ones may have a few triangles less than the others.
    assert ([before, *take(surface, last)])[-1] >= 0.99 * before


def moved(rim, rotation, offset, scale=1.0):
    return replace(
        rim,
        centre=scale * rotation.apply(rim.centre) + offset,
        points=scale * rotation.apply(rim.points) + offset,
        normals=rotation.apply(rim.normals),
    )


@cache
def swung():
    """The rims of a walk, and the surface that they make where they are."""
    walk = [*WALKS["swings"], *range(0, 380, 10), *range(386, 500, 5)]
    rims, surface = [r for part in rims_of(tuple(map(float, walk))) for r in part], Surface()
    take(surface, rims)
    return rims, surface


@settings(max_examples=3, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    offset=st.tuples(*[st.floats(-20, 20)] * 3),
    scale=st.sampled_from([0.01, 1.0, 50.0]),
)
def test_where_the_frame_has_its_origin_does_not_matter(turn, offset, scale):
    (rims, one), other = swung(), Surface()
    rotation, offset = Rotation.from_rotvec(turn), np.array(offset)
    take(other, [moved(rim, rotation, offset, scale) for rim in rims])
    assert len(other) == len(one)
    there = scale * rotation.apply(one.mesh().vertices) + offset
    np.testing.assert_allclose(other.mesh().vertices, there, atol=1e-9)


@pytest.mark.parametrize("offset", [0.5, 1.0, 10.0, 20.0])
def test_a_second_ring_of_views_leaves_the_first_as_it_is(offset):
    low, high = rims_of(tuple(range(0, 90, 5)), 0.2)[0], rims_of(tuple(range(0, 90, 5)), 0.5)[0]
    shift = 1000 * len(low)
    high = [
        replace(rim, stamp_ns=rim.stamp_ns + shift, prev_stamp_ns=rim.prev_stamp_ns + shift)
        for rim in high
    ]
    surface, alone = Surface(), Surface()
    for one in (low, high):
        take(surface, [moved(rim, Rotation.identity(), [offset, 0, 0]) for rim in one])
    take(alone, low)
    only = len(alone)
    alone.reset()
    take(alone, high)
    assert len(surface) == only + len(alone)


def test_a_strip_to_a_far_away_rim_sweeps_out_nothing():
    rims, _ = rims_of(tuple(range(0, 60, 5)))
    surface = Surface()
    before = take(surface, rims)[-1]
    first, last = rims[0], rims[-1]
    rows = np.arange(len(first), dtype=float)
    take(surface, [replace(first, stamp_ns=999, prev_stamp_ns=last.stamp_ns, prev=rows)])
    assert len(surface) == before
    assert layers(surface) < 1.01


@settings(max_examples=8, deadline=None)
@given(st.permutations(range(30)))
def test_the_order_in_which_rims_come_does_not_matter(order):
    rims = {rim.stamp_ns: rim for part in rims_of(tuple(range(0, 360, 12))) for rim in part}
    rims = list(rims.values())
    one, other = Surface(), Surface()
    take(one, rims)
    take(other, [rims[k] for k in order])
    corners = [np.sort(s.whole().corners.reshape(-1, 9), axis=0) for s in (one, other)]
    np.testing.assert_array_equal(*corners)


def test_each_rim_may_come_twice_and_some_not_at_all():
    rims, last = rims_of(tuple(range(0, 360, 10)))
    surface, whole = Surface(), Surface()
    take(whole, rims + last)
    kept = [rim for rim in rims + last if rim.stamp_ns not in (50, 120, 130)]
    take(surface, [rim for rim in kept for _ in range(2)])
    assert len(surface) == pytest.approx(len(whole) * 31 / 36, rel=0.02)


def test_a_rim_that_is_mostly_hidden_does_not_take_the_place_of_a_whole_one():
    rims, last = rims_of(tuple(range(0, 360, 10)))
    surface, stamps = Surface(), 10_000
    before = take(surface, rims + last)[-1]
    for rim in rims:
        status = rim.status.copy()
        status[: 2 * len(status) // 3] = Status.OUTSIDE
        again = replace(rim, stamp_ns=rim.stamp_ns + stamps, status=status)
        if rim.prev_stamp_ns is not None:
            again = replace(again, prev_stamp_ns=rim.prev_stamp_ns + stamps)
        take(surface, [again])
    assert len(surface) == before


def test_a_rim_that_names_itself_as_the_one_before_is_refused():
    rim = rims_of(tuple(range(0, 60, 10)))[0][0]
    with pytest.raises(ValueError, match="before itself"):
        Surface().add(replace(rim, prev_stamp_ns=rim.stamp_ns))


def test_a_revised_rim_may_be_joined_to_another_than_before():
    """The first rim of a turn, which had none before it, when the turn has closed."""
    rims = {rim.stamp_ns: rim for part in rims_of(tuple(range(0, 360, 10))) for rim in part}
    first = rims[10]
    assert first.prev_stamp_ns == 360
    whole, other = Surface(), Surface()
    take(whole, rims.values())
    nowhere = np.full(len(first), np.nan)
    take(other, [replace(first, prev_stamp_ns=None, prev=nowhere), *rims.values()])
    assert len(other) == len(whole)
    take(other, [replace(first, prev_stamp_ns=None, prev=nowhere)])
    assert len(other) == pytest.approx(len(whole) * 35 / 36, rel=0.01)


def test_lone_rims_without_end_take_no_more_room():
    rim, surface = rims_of(tuple(range(0, 60, 10)))[0][0], Surface()
    for k in range(2500):
        surface.add(replace(rim, stamp_ns=1000 + k, prev_stamp_ns=10**6 + k))
        if k == 1500:
            size = surface.nbytes
    assert len(surface._placed) <= 1001
    assert surface.nbytes < 2.5 * size


def test_what_is_over_is_kept_as_few_intervals():
    over, there = StampRuns(), set(range(1000))
    for stamp in np.random.default_rng(0).permutation(990):
        there.remove(stamp)
        over.add(int(stamp), there)
        assert len(over) <= len(there) + 1
        assert stamp in over
        assert not any(s in over for s in list(there)[:5])
    assert len(over) == 1
    assert 989 in over
    assert 990 not in over
