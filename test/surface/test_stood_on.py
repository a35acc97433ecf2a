"""A body that stands on a plane ends there."""

import numpy as np
import pytest
import trimesh

from occ_recon_ros.surface.bodies import stood_on

NORMAL = np.array([0.6, 0.0, 0.8])
BALL = trimesh.creation.icosphere(subdivisions=5, radius=1.0)


def test_what_lies_beneath_the_plane_is_taken_off_and_no_more():
    lifted = BALL.copy()
    lifted.vertices = stood_on(BALL.vertices, -0.5 * NORMAL, NORMAL)
    cap = np.pi * 0.5**2 * (3 - 0.5) / 3
    assert lifted.is_watertight
    assert (lifted.vertices @ NORMAL).min() == pytest.approx(-0.5)
    assert lifted.volume == pytest.approx(4 / 3 * np.pi - cap, rel=2e-3)


@pytest.mark.parametrize("height", [-1.5, 1.5])
def test_a_body_beside_the_plane_stays_as_it_is(height):
    # All beneath: then the plane is not the one on which it stands.
    stays = stood_on(BALL.vertices, height * NORMAL, NORMAL)
    np.testing.assert_array_equal(stays, BALL.vertices)
