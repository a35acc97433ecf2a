"""A sheet of markers under the object is found by whoever has the poses alone."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import CHARUCO, GRID, photograph, view
from scipy.spatial.transform import Rotation

from occ_recon_ros.poses.board import BoardSpec
from occ_recon_ros.poses.found_board import find_board
from occ_recon_ros.poses.marker_grid import grid_of

APRIL = BoardSpec("aruco_grid", 4, 3, marker_m=0.04, gap_m=0.012, dictionary="DICT_APRILTAG_36h11")
LEGACY = replace(CHARUCO, rows=8, legacy=True, first_id=3)
TURN = Rotation.from_rotvec([0.9, -1.3, 0.4]).as_matrix()


def around(n=6, **more):
    return [view(2 * np.pi * k / n, 0.85, 0.55, 700.0, (640, 480), **more) for k in range(n)]


def shown(board, cameras, hide=lambda camera: None):
    each = enumerate(cameras)
    return [photograph(board, c, hide=hide(c), seed=k, samples=2) for k, c in each]


def found_in(images, cameras):
    return find_board(len(images), lambda some: ((images[k], cameras[k]) for k in some))


def hidden(camera, radius_m=0.03):
    """Where a disc lies in the middle of the board."""
    v, u = np.mgrid[: camera.height, : camera.width]
    middle, beside = camera.project(np.array([[0, 0, 0.0], [radius_m, 0, 0]]))
    return np.hypot(u - middle[0], v - middle[1]) < np.linalg.norm(beside - middle)


@pytest.mark.parametrize(
    "board", [GRID, pytest.param(CHARUCO, marks=pytest.mark.slow), LEGACY, APRIL]
)
@pytest.mark.parametrize(
    "unit",
    [pytest.param(0.01, marks=pytest.mark.slow), 1.0, pytest.param(30.0, marks=pytest.mark.slow)],
)
def test_the_sheet_lies_where_and_as_it_was_printed(board, unit):
    at = np.array([0.3, -2.0, 0.7]) * unit
    cameras = around()
    images = shown(board, cameras, hidden)
    moved = [
        replace(
            c,
            R_camera_object=c.R_camera_object @ TURN.T,
            t_camera_object=unit * c.t_camera_object - c.R_camera_object @ TURN.T @ at,
        )
        for c in cameras
    ]
    found = found_in(images, moved)
    assert found.board.kind == board.kind
    assert (found.board.columns, found.board.rows) == (board.columns, board.rows)
    assert (found.board.first_id, found.board.legacy) == (board.first_id, board.legacy)
    assert found.board.marker_m / found.board.pitch_m == pytest.approx(
        board.marker_m / board.pitch_m, rel=0.01
    )
    assert found.scale * found.board.pitch_m == pytest.approx(unit * board.pitch_m, rel=2e-3)
    for given, here in zip(cameras, map(found.camera, moved), strict=True):
        own = here.project(found.board.corners)
        assert np.abs(own - given.project(board.corners)).max() < 0.5


@pytest.mark.slow
def test_a_view_whose_pose_is_off_is_placed_by_its_markers():
    cameras = around(8)
    images = shown(GRID, cameras)
    rng = np.random.default_rng(0)
    off = [replace(c, t_camera_object=c.t_camera_object + rng.normal(0, 2e-3, 3)) for c in cameras]
    found = found_in(images, off)
    for image, true, given in zip(images, cameras, off, strict=True):
        seen = found.seen_by(image, given)
        assert np.abs(seen.project(found.board.corners) - true.project(GRID.corners)).max() < 0.7
    # Where it is as good as its markers it stays as it is.
    found = found_in(images, cameras)
    assert np.array_equal(found.seen_by(images[0], cameras[0]).K, cameras[0].K)
    assert np.array_equal(
        found.seen_by(images[0], cameras[0]).t_camera_object,
        found.camera(cameras[0]).t_camera_object,
    )


def test_without_markers_there_is_no_sheet():
    rng = np.random.default_rng(0)
    cameras = around()
    images = [rng.integers(0, 256, (480, 640), np.uint8) for _ in cameras]
    assert found_in(images, cameras) is None


def test_one_marker_is_no_sheet():
    one = BoardSpec("aruco_grid", 1, 1, marker_m=0.06, gap_m=0.01, dictionary="DICT_4X4_50")
    cameras = around()
    assert found_in(shown(one, cameras), cameras) is None


def test_markers_on_top_of_the_object_are_no_sheet_under_it():
    cameras = around(at=(0, 0, -0.12))
    assert found_in(shown(GRID, cameras), cameras) is None


def test_a_sheet_that_does_not_turn_with_the_cameras_is_none():
    cameras = around()
    assert found_in(shown(GRID, cameras[:1]) * len(cameras), cameras) is None


def quads_of(board):
    """Numbers of the markers of a board, and (m, 4, 2) their corners, x right and y up."""
    corners = board.from_sheet(board.sheet_markers.reshape(-1, 2))
    return board.marker_ids, corners[:, :2].reshape(-1, 4, 2)


def test_markers_that_are_counted_down_the_columns_are_no_sheet_of_rows():
    ids, quads = quads_of(GRID)
    down = np.arange(len(ids)).reshape(GRID.rows, GRID.columns).T.ravel()
    assert grid_of(np.sort(ids), quads, GRID.dictionary, 0.04) is not None
    assert grid_of(np.sort(ids), quads[down], GRID.dictionary, 0.04) is None


def test_some_markers_are_never_seen_and_one_is_misread():
    ids, quads = quads_of(GRID)
    seen = np.setdiff1d(np.arange(len(ids)), [11, 12, 16, 17, 21])
    names = ids[seen].copy()
    names[-1] = 3  # seen elsewhere
    names[3] = 94
    grid = grid_of(names, quads[seen], GRID.dictionary, 0.04)
    assert (grid.board.columns, grid.board.rows) == (5, 7)
