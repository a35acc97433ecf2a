"""How far a closed body goes on above and below what was seen of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_turns import exact_turn

from occ_recon_ros.evaluation.ends import Ends, ends_of
from occ_recon_ros.geometry import RimReconstructor, Status
from occ_recon_ros.surface.closing import ClosingSettings, close_surface


def rims_between(low, high, count=12, away=3.0, up=2.0):
    """Rims on a cylinder, seen from a ring of cameras above."""
    for angle in 2 * np.pi * np.arange(count) / count:
        aside = np.array([np.cos(angle), np.sin(angle), 0.0])
        heights = np.linspace(low, high, 200)[:, None] * [0.0, 0.0, 1.0]
        status = np.full(200, Status.GOOD)
        yield SimpleNamespace(
            centre=away * aside + [0, 0, up],
            points=0.3 * aside + heights,
            status=status,
        )


CYLINDER = np.array([[0.3, 0, -1.0], [0.3, 0, 1.0], [-0.3, 0, 0.0], [0, 0.3, 0.5]])


def moved(rims, R, t):
    for rim in rims:
        yield SimpleNamespace(
            centre=R @ rim.centre + t, points=rim.points @ R.T + t, status=rim.status
        )


@pytest.mark.parametrize("turn", [0, 1])
def test_ends_are_told_from_the_side_of_the_cameras_wherever_the_object_is(turn):
    R = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0] if turn else np.eye(3)
    t = turn * np.array([40.0, -7.0, 3.0])
    ends = ends_of(CYLINDER @ R.T + t, [*moved(rims_between(-0.8, 0.9), R, t)])
    found = ends.above, ends.below, ends.height
    # A five-hundredth of the points at either end may be wrong.
    np.testing.assert_allclose(found, (0.1, 0.2, 2.0), atol=0.005)


def test_points_that_are_wrong_or_astray_bound_nothing():
    rims = [*rims_between(-0.8, 0.9)]
    rims[0].points[:2] += [0, 0, 5.0]
    rims[1].points[50:100] -= [0, 0, 5.0]
    rims[1].status[50:100] = Status.OUTSIDE
    ends = ends_of(CYLINDER, rims)
    np.testing.assert_allclose((ends.above, ends.below), (0.1, 0.2), atol=0.01)


def test_of_few_points_or_cameras_on_a_line_nothing_is_said():
    rims = [*rims_between(-0.8, 0.9)]
    assert ends_of(CYLINDER, rims[:2]) is None
    on_a_line = [
        SimpleNamespace(**{**vars(r), "centre": np.array([k, 0, 1.0])}) for k, r in enumerate(rims)
    ]
    assert ends_of(CYLINDER, on_a_line) is None
    for rim in rims:
        rim.status[5:] = Status.OUTSIDE
    assert ends_of(CYLINDER, rims) is None


@pytest.mark.parametrize(
    ("above", "below", "told", "doubted"),
    [
        (0.09, 0.09, False, False),
        (0.11, -0.2, True, False),
        (0.0, 0.11, True, False),
        (0.24, 0.25, True, False),
        (0.26, 0.25, True, True),
        (0.6, -0.2, True, True),
    ],
)
def test_a_tenth_of_the_height_is_told_and_half_of_it_doubted(above, below, told, doubted):
    ends = Ends(above, below, 1.0)
    assert (bool(ends.said()), ends.doubtful) == (told, doubted)
    if told:
        assert f"{1e3 * above:.3g} mm above and {1e3 * max(below, 0.0):.3g} mm below" in ends.said()
        assert ("volume_kind=plane" in ends.advice()) == (below > 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "elevation", "doubted"),
    [("mug", 0.2, False), ("mug", 1.1, True), ("figure", 1.1, False)],
)
def test_flat_ends_that_all_views_look_down_on_are_told_from_pointed_ones(name, elevation, doubted):
    truth, _, contours = exact_turn(name, 36, elevation)
    reconstructor = RimReconstructor()
    rims = {rim.stamp_ns: rim for view in contours for rim in reconstructor.add(view)}
    rims |= {rim.stamp_ns: rim for rim in reconstructor.finish()}
    body = close_surface(contours, [*rims.values()], ClosingSettings(cells=64)).vertices
    ends = ends_of(np.asarray(body), [*rims.values()])
    true = np.asarray(truth.mesh(48).vertices)
    assert (bool(ends.said()), ends.doubtful) == (doubted, doubted)
    assert (np.ptp(body[:, 2]) > 1.1 * np.ptp(true[:, 2])) == doubted
    # No view sees along more than there is.
    assert ends.above > body[:, 2].max() - true[:, 2].max() - 1e-3
    assert ends.below > true[:, 2].min() - body[:, 2].min() - 1e-3
