"""What is taken off a body that views see past, and what stays though it looks dark."""

import numpy as np
import pytest
from test_joint_evidence import BALL, GRID, saying, views  # noqa: F401

from occ_recon_ros.imaging.joint.carving import pared
from occ_recon_ros.imaging.joint.occupancy import Sight

POINTS = GRID.centres()
ACROSS, HEIGHT = np.linalg.norm(POINTS[:, :2], axis=1), np.abs(POINTS[:, 2])
SPOOL = np.where(HEIGHT < 0.05, ACROSS < 0.035, (ACROSS < 0.075) & (HEIGHT < 0.08))


def left(views, body, nats):  # noqa: F811
    """Of all voxels, those that stay of a body, and where each view is overruled."""
    at = np.flatnonzero(body)
    sights = [Sight.of(GRID, view, n, POINTS[at]) for view, n in zip(views, nats, strict=True)]
    stay, held = pared(sights)
    out = np.zeros(len(body), np.bool_)
    out[at[stay]] = True
    return out, held


def nowhere(points, k):
    return np.zeros(len(points), np.bool_)


def test_what_fills_a_hollow_is_taken_off_and_no_more(views):  # noqa: F811
    filled = (ACROSS < 0.075) & (HEIGHT < 0.08)
    body, _ = left(views, filled, saying(views, SPOOL, nowhere))
    assert body[SPOOL].mean() > 0.98
    assert body[(ACROSS > 0.055) & (HEIGHT < 0.03)].mean() < 0.02


@pytest.mark.parametrize("darkened", [[3], [3, 4, 5]])
def test_a_dark_side_stays_that_others_see_lit(views, darkened):  # noqa: F811
    def dark(points, k):
        right = views[k].camera.R_camera_object[0]
        return points @ right > 0.03 if k in darkened else nowhere(points, k)

    body, held = left(views, BALL, saying(views, BALL, dark))
    assert body[BALL].mean() > 0.97
    assert all(held[k].any() for k in darkened)


def test_a_side_that_none_sees_lit_goes(views):  # noqa: F811
    def dark(points, k):
        return points[:, 2] > 0.04

    body, _ = left(views, BALL, saying(views, BALL, dark))
    assert body[BALL & (POINTS[:, 2] > 0.06)].mean() < 0.5
