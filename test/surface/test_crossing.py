"""A sheet that crosses itself is found out, and brought apart."""

import numpy as np
import pytest
import trimesh

from occ_recon_ros.surface.crossing import crossing_triangles, uncrossed, unfolded
from occ_recon_ros.surface.fairing import mean_of_neighbours


def dented(bottom):
    """A unit ball whose top is pushed in, down to ``bottom``; its bottom is at -1."""
    ball = trimesh.creation.icosphere(4)
    x = np.array(ball.vertices)
    top = x[:, 2] > 0.8
    x[top, 2] -= (1 - bottom) * (x[top, 2] - 0.8) / 0.2
    return np.array(ball.vertices), x, np.array(ball.faces)


def test_a_dent_crosses_where_it_comes_through_the_other_side():
    _, x, faces = dented(bottom=-1.3)
    middles = x[faces[crossing_triangles(x, faces)]].mean(axis=1)
    assert len(middles) > 4
    assert middles[:, 2].max() < -0.6  # the two sheets meet near the bottom alone


@pytest.mark.parametrize("bottom", [0.9, 0.0, -0.9])
def test_a_sheet_near_another_is_no_crossing(bottom):
    _, x, faces = dented(bottom)
    assert not len(crossing_triangles(x, faces))


def test_sheets_come_apart_towards_where_they_were_and_the_rest_stays():
    ball, x, faces = dented(bottom=-1.3)
    apart = uncrossed(x, faces, ball)
    assert not len(crossing_triangles(apart, faces))
    top, bottom = x[:, 2] != ball[:, 2], ball[:, 2] < -0.8
    # From above, the way is in through the dent and out through the bottom.
    assert apart[top, 2].min() > apart[bottom, 2].min()
    assert np.array_equal(apart[~(top | bottom)], x[~(top | bottom)])


def test_a_fold_is_smoothed_out():
    ball = trimesh.creation.icosphere(3)
    x, faces = np.array(ball.vertices), np.array(ball.faces)
    corner = faces[0, 0]
    x[corner] = 2 * x[faces[faces[:, 0] != corner][0, 0]] - x[corner]
    spread = trimesh.Trimesh(x, faces, process=False).face_adjacency_angles
    assert spread.max() > 2.1
    smooth = unfolded(x, faces, mean_of_neighbours(faces, len(x)))
    assert trimesh.Trimesh(smooth, faces, process=False).face_adjacency_angles.max() < 2.1
