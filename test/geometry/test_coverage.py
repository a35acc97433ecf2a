"""The angle that a camera has gone around."""

import numpy as np
import pytest

from occ_recon_ros.geometry.coverage import angle_covered


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
