"""The angle that a camera has gone around."""

import numpy as np
import pytest

from occ_recon_ros.geometry.coverage import (
    angle_covered,
    follow_each_other,
    order_of_neighbours,
    rings_go_around,
    step_over_gap,
    steps_between,
    widest_gap,
)


def centres(degrees, wobble=0.0):
    """On a circle somewhere in space, about a tilted axis."""
    a = np.deg2rad(degrees)
    rng = np.random.default_rng(0)
    circle = np.column_stack([np.cos(a), np.sin(a), np.zeros(len(a))])
    tilt = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return list((circle + rng.normal(0, wobble, circle.shape)) @ tilt + [3, -2, 1])


@pytest.mark.parametrize(
    ("degrees", "covered"),
    [
        (range(0, 360, 10), 360),
        (range(360, 0, -10), 360),
        (range(90, 450, 20), 360),  # not from 0, and over the seam of arctan2
        (range(0, 350, 10), 340),  # a frame was lost beside the seam
        (range(5, 355, 10), 340),
        (range(0, 181, 5), 180),
        (range(0, 41, 1), 40),
        (range(0, 721, 10), 720),
    ],
)
def test_a_turntable(degrees, covered):
    found = np.rad2deg(angle_covered(centres(np.array(degrees))))
    assert found == pytest.approx(covered, abs=1e-6)


def test_lost_frames_in_the_middle_change_nothing():
    degrees = np.delete(np.arange(0, 360, 10), [5, 6, 7, 20])
    assert np.rad2deg(angle_covered(centres(degrees))) == pytest.approx(360, abs=1e-6)


@pytest.mark.parametrize(
    ("degrees", "gap"),
    [
        (range(0, 360, 10), 0),
        (range(0, 360, 90), 0),
        (range(0, 345, 5), 0),  # as a seam of a few frames
        (np.delete(np.arange(0, 360, 10), [5, 6]), 30),
        (np.delete(np.arange(0, 360, 18), [8, 9, 10, 11]), 90),
        (np.delete(np.arange(0, 340, 20), [8, 9, 10]), 80),  # more than at the seam
        (np.delete(np.arange(0, 720, 10), [20, 21, 22, 23, 56, 57, 58, 59, 60]), 50),  # two turns
        (np.delete(np.arange(0, 720, 10), [20, 21, 22, 23]), 0),
        (range(0, 181, 5), 180),
    ],
)
def test_the_widest_gap_is_told_wherever_it_is(degrees, gap):
    assert np.rad2deg(widest_gap(centres(np.array(degrees)))) == pytest.approx(gap, abs=1e-6)


@pytest.mark.parametrize(
    ("degrees", "views"),
    [
        (np.delete(np.arange(0, 360, 30), 7), (6, 7)),
        (np.delete(np.arange(360, 0, -30), 7), (6, 7)),
        (np.delete(np.arange(90, 450, 10), [20, 21]), (19, 20)),
        (np.delete(np.arange(0, 720, 10), [20, 21, 22, 23, 56, 57, 58, 59, 60]), (19, 20)),
        (np.delete(np.arange(0, 360, 30), 11), None),  # beside the seam
        (range(0, 360, 10), None),
        ([*range(0, 181, 5), *range(178, 0, -5)], None),  # there and back
        (np.random.default_rng(2).permutation(np.arange(0, 270, 10)), None),  # in no order
    ],
)
def test_a_step_over_the_gap_is_told_where_the_camera_went_on_behind_it(degrees, views):
    assert step_over_gap(centres(np.array(degrees))) == views


@pytest.mark.parametrize("step", [5, 10, 20])
def test_a_hole_in_the_middle_is_no_whole_turn_at_any_time(step):
    for first in range(step, 200, step):
        degrees = [*range(0, first, step), *range(first + 120, 360, step)]
        for k in range(3, len(degrees) + 1):
            assert np.rad2deg(angle_covered(centres(np.array(degrees[:k])))) < 300


def test_a_table_that_stands_between_its_steps_is_gone_around_all_the_same():
    degrees = np.repeat(np.arange(0, 360, 20), 5) + np.tile([0, 0.01, 0, 0.02, 0], 18)
    assert np.rad2deg(angle_covered(centres(degrees))) == pytest.approx(360, abs=1e-6)
    half = np.rad2deg(angle_covered(centres(degrees[:45])))
    assert half == pytest.approx(160, abs=0.1)


@pytest.mark.parametrize(("end", "covered"), [(360, 360), (270, 260), (180, 170)])
def test_photographs_in_no_order(end, covered):
    degrees = np.random.default_rng(2).permutation(np.arange(0, end, 10))
    assert np.rad2deg(angle_covered(centres(degrees))) == pytest.approx(covered, abs=1e-6)


def test_a_camera_held_by_hand():
    found = np.rad2deg(angle_covered(centres(np.arange(0, 91, 3), wobble=0.002)))
    assert found == pytest.approx(90, abs=3)


@pytest.mark.parametrize("C", [[], [(0, 0, 0)] * 2, [(0, 0, 0)] * 9, [(k, 0, 0) for k in range(9)]])
def test_no_circle_is_no_angle(C):
    assert angle_covered([np.array(c, float) for c in C]) == 0
    assert widest_gap([np.array(c, float) for c in C]) == 0


def rings(*elevation_views, end=360.0):
    """Centres about an object at several elevations, degrees, ring by ring."""
    found = []
    for elevation, views in elevation_views:
        around = np.deg2rad(np.arange(views) * end / views + 3 * elevation)
        up = np.deg2rad(elevation)
        ring = [np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), 0 * around + np.sin(up)]
        found.append(np.column_stack(ring))
    return np.concatenate(found)


def test_several_rings_go_all_around_though_they_are_near_each_other_from_above():
    four = rings((10, 12), (35, 12), (60, 8), (-25, 8))
    assert np.rad2deg(angle_covered(four)) == pytest.approx(360)
    assert follow_each_other(four)
    assert widest_gap(four) == 0
    around = np.rad2deg(np.arctan2(four[:, 1], four[:, 0])) % 360
    assert np.rad2deg(widest_gap(four[np.abs(around - 200) > 40])) > 70


@pytest.mark.parametrize("more", [[27, 118, 209, 300], [27, 118], range(10, 350, 45)])
def test_views_between_those_of_a_whole_turn_leave_it_whole(more):
    assert rings_go_around(centres([*range(0, 360, 45), *more]))


def test_rings_go_around_by_the_steps_along_them():
    C = np.concatenate(
        [np.roll(rings((up, 26)), 8 * k, axis=0) for k, up in enumerate((-20, -10, 0, 10, 20))]
    )
    # From above their views are 2 and 5 degrees apart, and from the middle 10; in them 14.
    around = np.abs(np.rad2deg(np.arctan2(C[:, 1], C[:, 0])))
    assert rings_go_around(C[around > 9])  # a gap of 19 degrees
    assert not rings_go_around(C[around > 12])  # of 25


@pytest.mark.parametrize("end", [300, 270, 180])
def test_a_part_of_a_turn_goes_not_around_in_any_order(end):
    degrees = np.arange(0, end, 10)
    for order in (degrees, np.random.default_rng(2).permutation(degrees), [*degrees, *degrees + 5]):
        assert not rings_go_around(centres(order))


def test_positions_all_over_a_sphere_go_all_around():
    centres = np.random.default_rng(0).normal(size=(60, 3))
    centres /= np.linalg.norm(centres, axis=1)[:, None]
    assert np.rad2deg(angle_covered(centres)) == pytest.approx(360)
    assert not follow_each_other(centres)


def test_several_rings_over_a_third_of_a_turn_are_a_third():
    third = rings((5, 12), (15, 12), (25, 12), end=120.0) @ np.diag([1.0, 1.0, 0.3])
    assert np.rad2deg(angle_covered(third)) < 240


def test_leaps_around_a_ring_are_no_further_turns():
    degrees = 10 * (7 * np.arange(36) % 36)
    assert np.rad2deg(angle_covered(centres(degrees))) == pytest.approx(360, abs=1e-6)
    assert not follow_each_other(centres(degrees))


@pytest.mark.parametrize(
    "degrees",
    [
        np.arange(0, 360, 10),
        np.arange(0, 360, 72),
        np.arange(0, 720, 30) + np.repeat([0, 15], 12),  # the second turn between the first's
        np.arange(0, 1080, 40) + np.random.default_rng(1).normal(0, 0.3, 27),  # three, nearly alike
        np.repeat(np.arange(0, 360, 30), 5) + np.tile([0, 0.01, 0, 0.02, 0], 12),
        137.5 / 10 * np.arange(400),  # of many turns there are neighbours all over
    ],
)
def test_views_in_the_order_of_a_turn_follow_each_other(degrees):
    assert follow_each_other(centres(degrees))


def test_views_in_no_order_do_not_follow_each_other():
    degrees = np.random.default_rng(2).permutation(np.arange(0, 360, 10))
    assert not follow_each_other(centres(degrees))
    assert np.rad2deg(steps_between(centres(degrees))[1]) == pytest.approx(10)


@pytest.mark.parametrize(("count", "step"), [(3, 10), (4, 17), (5, 5), (8, 10)])
def test_steps_of_a_short_arc_are_known(count, step):
    arc = np.array(centres(step * np.arange(count)))
    arc += np.random.default_rng(3).normal(0, 1e-4, arc.shape) * np.linalg.norm(arc[0])
    assert np.rad2deg(steps_between(arc)) == pytest.approx([step, step], rel=0.1)


def test_a_camera_that_is_much_nearer_once_moves_no_middle():
    ring = rings((20, 24))
    ring[7] *= 0.3
    assert np.rad2deg(steps_between(ring)) == pytest.approx([15, 15], abs=3)


@pytest.mark.parametrize("end", [360, 120])
def test_views_in_no_order_are_put_in_that_of_the_turn(end):
    degrees = np.random.default_rng(2).permutation(np.arange(0, end, 10))
    order = order_of_neighbours(centres(degrees))
    assert sorted(order) == list(range(len(degrees)))
    steps = np.diff(np.unwrap(np.deg2rad(degrees[order])))
    assert np.abs(np.rad2deg(steps)) == pytest.approx(10)


def test_views_in_no_order_all_over_a_sphere_are_put_beside_their_neighbours():
    C = np.random.default_rng(0).normal(size=(60, 3))
    assert follow_each_other(C[order_of_neighbours(C)])


@pytest.mark.parametrize("C", [[], [(0, 0, 0)] * 2, [(k, 0, 0) for k in range(9)]])
def test_views_on_a_line_keep_their_order(C):
    assert order_of_neighbours(np.array(C, float)).tolist() == list(range(len(C)))
