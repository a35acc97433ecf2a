"""What views say of voxels and of outlines, on bodies and images made by hand."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.imaging.joint.edges import without_edge
from occ_recon_ros.imaging.joint.evidence import small_view
from occ_recon_ros.imaging.joint.occupancy import occupied
from occ_recon_ros.imaging.joint.space import Grid
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

SIZE = 72
GRID = Grid(np.full(3, -0.12), 0.01, (24, 24, 24))
BLANK = np.zeros((SIZE, SIZE, 3), np.uint8)
EVERYWHERE = np.ones((SIZE, SIZE), np.bool_)


@pytest.fixture(scope="module")
def views():
    rig = TurntableSettings(
        frames=16, step=np.deg2rad(22.5), width=SIZE, height=SIZE, focal_px=150.0
    )
    return [small_view(BLANK, camera, EVERYWHERE, None) for camera in turntable_cameras(rig)]


def saying(views, body, dark):
    """Nats of each view: 3 where a ray meets the body, -2 where that looks as the backdrop too."""
    points = GRID.centres()
    corners = np.stack(np.meshgrid(*[(-0.25, 0.25)] * 3), axis=-1).reshape(-1, 3) * GRID.size
    out = []
    for k, view in enumerate(views):
        nats = np.full((SIZE, SIZE), -2.0, np.float32)
        for inside, says in ((body, 3.0), (body & dark(points, k), -2.0)):
            fine = (points[inside][:, None] + corners).reshape(-1, 3)
            uv = np.rint(view.camera.project(fine)).astype(int)
            nats[uv[:, 1], uv[:, 0]] = says
        out.append(nats)
    return out


def found(views, nats):
    allowed = np.ones(GRID.shape, np.bool_)
    return occupied(GRID, views, nats, allowed, solid=0.1)[0].ravel()


BALL = np.linalg.norm(GRID.centres(), axis=1) < 0.08


def test_dark_places_seen_from_some_sides_do_not_carve(views):
    def dark(points, k):
        lower = (points[:, 0] > 0.03) & (np.abs(points[:, 2]) < 0.02)
        return lower if 2 <= k <= 3 else np.zeros(len(points), np.bool_)

    body = found(views, saying(views, BALL, dark))
    assert body[BALL].mean() > 0.97
    far = np.linalg.norm(GRID.centres(), axis=1) > 0.105
    assert not body[far].any()


def test_what_some_views_see_through_is_open(views):
    points = GRID.centres()
    window = (np.abs(points[:, 1]) < 0.04) & (np.abs(points[:, 2]) < 0.04)
    wall = (np.abs(points[:, 0]) < 0.02) & (np.abs(points) < 0.08).all(axis=1)
    body = found(views, saying(views, wall & ~window, lambda p, k: np.zeros(len(p), np.bool_)))
    assert body[wall & window].mean() < 0.2
    assert body[wall & ~window].mean() > 0.9


def test_an_outline_off_the_edge_is_told_from_one_on_it(views):
    disc = cv2.circle(np.zeros((200, 200), np.uint8), (100, 100), 50, 1, -1)
    noise = np.random.default_rng(0).normal(0, 2, (200, 200, 3))
    image = np.clip(30 + 120 * disc[..., None] + noise, 0, 255).astype(np.uint8)
    shadow = cv2.rectangle(disc.copy(), (120, 120), (180, 150), 1, -1)
    seen = small_view(image, views[0].camera, np.ones((200, 200), np.bool_), None)
    right, wrong = without_edge([seen, seen], [disc > 0, shadow > 0])
    assert right < 0.01
    assert 0.2 < wrong < 0.5


def test_outlines_that_came_with_the_views_are_not_looked_at(views):
    given = np.zeros((SIZE, SIZE), np.bool_)
    given[20:40, 20:40] = True
    seen = small_view(BLANK, views[0].camera, EVERYWHERE, given)
    assert without_edge([seen], [given]).tolist() == [0.0]


def test_an_outline_along_the_border_of_the_picture_has_no_sides(views):
    whole = np.ones((SIZE, SIZE), np.bool_)
    seen = small_view(BLANK, views[0].camera, EVERYWHERE, None)
    assert without_edge([seen], [whole]).tolist() == [0.0]
