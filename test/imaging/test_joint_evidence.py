"""What views say of voxels and of outlines, on bodies and images made by hand."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from traced import solution

from occ_recon_ros.imaging.joint.colours import COUNT
from occ_recon_ros.imaging.joint.edges import keeps_to_edges, without_edge
from occ_recon_ros.imaging.joint.evidence import likelihood
from occ_recon_ros.imaging.joint.judge import judge, outline_support
from occ_recon_ros.imaging.joint.models import Models, learn
from occ_recon_ros.imaging.joint.occupancy import occupied
from occ_recon_ros.imaging.joint.plane import Ground, plane_at
from occ_recon_ros.imaging.joint.small_view import small_view
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


def solved(views, nats):
    """What is made of what views say."""
    body, total = occupied(GRID, views, nats, np.ones(GRID.shape, np.bool_), solid=0.1)
    return solution(GRID, body, total, 0.1, nats)


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


@pytest.mark.parametrize(
    "spoil", ["bitten", "grown", "moved", "with a part beside", "finer but bitten"]
)
def test_of_two_masks_the_one_on_the_edges_of_its_image_is_told(spoil):
    disc = cv2.circle(np.zeros((200, 200), np.uint8), (100, 100), 50, 255, -1)
    noise = np.random.default_rng(0).normal(0, 2, (200, 200, 3))
    image = np.clip(30 + 0.5 * disc[..., None] + noise, 0, 255).astype(np.uint8)
    mask, other = disc, disc.copy()
    if spoil == "bitten":
        other[60:100, 90:] = 0
    elif spoil == "finer but bitten":
        # By hand a pixel is nothing; a bite is.
        mask = cv2.erode(disc, np.ones((3, 3), np.uint8))
        other[60:100, 90:] = 0
    elif spoil == "grown":
        other = cv2.dilate(disc, np.ones((15, 15), np.uint8))
    elif spoil == "moved":
        other = np.roll(disc, 6, axis=1)
    else:
        other[130:170, 130:180] = 255
    assert keeps_to_edges(image, mask, other)
    assert not keeps_to_edges(image, other, mask)
    assert not keeps_to_edges(image, mask, mask)


@pytest.mark.parametrize("dark_room", [False, True])
def test_what_hides_a_print_is_of_the_object_in_any_colour(views, dark_room):
    # White paper to the left of a grey room; the object is red and black, of which red is known.
    white, grey, red, black = (
        np.array(c) for c in ((230,) * 3, (120,) * 3, (40, 40, 200), (25,) * 3)
    )
    image = np.empty((SIZE, SIZE, 3), np.uint8)
    image[:, : SIZE // 2], image[:, SIZE // 2 :] = white, grey
    spread = np.where(np.arange(SIZE) < SIZE // 2, 3.0, np.inf) * np.ones((SIZE, 1))
    shows = image.astype(np.float32)
    image[:8, : SIZE // 2] = black  # another part of the print, as it is known to be
    shows[:8, : SIZE // 2] = black
    if dark_room:
        image[60:, SIZE // 2 :] = black
    image[20:30, 10:50] = red
    image[30:40, 10:50] = black
    known = shows, spread.astype(np.float32)
    seen = small_view(image, views[0].camera, EVERYWHERE, None, known)
    inside = np.zeros((SIZE, SIZE), np.bool_)
    inside[20:30, 10:50] = True
    outside = ~cv2.dilate(inside.astype(np.uint8), np.ones((25, 25), np.uint8)).astype(np.bool_)
    models = learn([seen], [inside], [outside], None, None)
    nats = likelihood(seen, models, 0, outside)
    at_print, off_print = nats[:, 2 : SIZE // 2 - 2], nats[:, SIZE // 2 + 2 :]
    assert at_print[22:28, 12:].min() > 1
    assert at_print[32:38, 12:].min() > 1
    assert at_print[:6].max() < -1
    assert at_print[44:].max() < -1
    assert off_print[44:].max() < -1
    if dark_room:
        return
    # The print's own black is none of the room's: before the room black is no backdrop.
    assert off_print[32:38, : 50 - SIZE // 2 - 4].min() > -1


def test_an_outline_beside_which_nothing_tells_is_not_called_wrong(views):
    inside = np.zeros((SIZE, SIZE), np.bool_)
    inside[25:45, 25:45] = True
    nats = np.where(inside, 3.0, -3.0).astype(np.float32)
    shows = np.full((SIZE, SIZE, 3), 120, np.float32)
    for spread, support in ((3.0, 1.0), (25.0, np.nan)):
        known = shows, np.full((SIZE, SIZE), spread, np.float32)
        seen = small_view(BLANK, views[0].camera, EVERYWHERE, None, known)
        found, touches = outline_support(seen, nats, inside)
        assert np.array_equal(found, support, equal_nan=True)
        assert touches == 0


def test_a_view_of_which_the_print_tells_nothing_is_judged_by_the_others(views):
    shows = np.full((SIZE, SIZE, 3), 120, np.float32)
    seen = []
    for k, view in enumerate(views):
        known = shows, np.full((SIZE, SIZE), 25.0 if k == 3 else 3.0, np.float32)
        seen.append(small_view(BLANK, view.camera, EVERYWHERE, None, known))
    nats = saying(seen, BALL, lambda p, k: np.zeros(len(p), np.bool_))
    judged = judge(seen, solved(seen, nats), [n > 0 for n in nats])
    reports, belief, warnings = judged.views, judged.belief, judged.doubts
    assert [k for k, report in enumerate(reports) if report.bad] == []
    assert reports[3].support == np.median([report.support for report in reports])
    assert belief > 0.9
    assert warnings == []


def test_of_what_the_share_is_that_something_before_the_object_takes_is_said(views):
    """It may be larger than the object."""
    nats = saying(views, BALL, lambda p, k: np.zeros(len(p), np.bool_))
    seen = []
    for k, view in enumerate(views):
        shown = np.full((SIZE, SIZE, 3), 90, np.uint8)
        shown[nats[k] > 0] = 200
        if k == 3:  # a hand
            shown[SIZE // 2 :] = (40, 40, 220)
        seen.append(small_view(shown, view.camera, EVERYWHERE, None))
    reports = judge(seen, solved(seen, nats), [n > 0 for n in nats]).views
    assert [k for k, report in enumerate(reports) if report.bad] == [3]
    assert re.search(r"no other view shows \(\d+% of the object's area\)$", reports[3].why)


def test_a_side_of_the_object_that_few_views_see_is_no_hand(views):
    nats = saying(views, BALL, lambda p, k: np.zeros(len(p), np.bool_))
    seen = []
    for k, view in enumerate(views):
        shown = np.full((SIZE, SIZE, 3), 90, np.uint8)
        shown[nats[k] > 0] = 200
        if k == 3:  # a label
            shown[(nats[k] > 0) & (np.arange(SIZE)[:, None] > SIZE // 2)] = (40, 40, 220)
        seen.append(small_view(shown, view.camera, EVERYWHERE, None))
    reports = judge(seen, solved(seen, nats), [n > 0 for n in nats]).views
    assert not any(report.bad for report in reports)


@pytest.mark.parametrize(
    ("goes_on", "found", "doubtful"),
    [(False, 1.0, False), (True, 1.0, True), (True, 0.6, True), (True, 0.15, False)],
)
def test_masks_that_end_at_an_edge_of_the_room_are_doubtful(views, goes_on, found, doubtful):
    """A column, still and round, whose lower end lies on the edge of a table, or is its own; masks
    that came with some views say nothing of those that were found, nor a few of these of all."""
    came = round((1 - found) * len(views))
    at = GRID.centres()
    column = (np.hypot(at[:, 0], at[:, 1]) < 0.05) & (np.abs(at[:, 2]) < 0.05)
    nats = saying(views, column, lambda p, k: np.zeros(len(p), np.bool_))
    shown = np.full((SIZE, SIZE, 3), 90, np.uint8)
    if goes_on:
        shown[np.flatnonzero((nats[0] > 0).any(axis=1))[-1] + 1 :] = 60
    shown[nats[0] > 0] = 200
    masks = [n > 0 for n in nats]
    given = [mask if k < came else None for k, mask in enumerate(masks)]
    pairs = zip(views, given, strict=True)
    seen = [small_view(shown, view.camera, EVERYWHERE, own) for view, own in pairs]
    judged = judge(seen, solved(seen, nats), masks)
    belief, warnings = judged.belief, judged.doubts
    assert any("an edge of the room" in doubt for doubt in warnings) == doubtful
    assert (belief <= 0.65) == doubtful


@pytest.mark.parametrize(("below", "hangs"), [(0.0, False), (0.06, False), (0.12, True)])
def test_what_hangs_over_the_ground_has_lost_what_carries_it(views, below, hangs):
    nats = saying(views, BALL, lambda p, k: np.zeros(len(p), np.bool_))
    unknown = np.zeros((SIZE, SIZE, 3), np.float32), np.full((SIZE, SIZE), np.inf, np.float32)
    models = Models(np.zeros(COUNT), np.zeros(COUNT), [[unknown] for _ in views])
    found = replace(solved(views, nats), models=models)
    for normal in np.eye(3):
        plane = plane_at(-(0.075 + below) * normal, normal, 0.2)
        judged = judge(views, replace(found, ground=Ground(plane, [], 0.0)), [n > 0 for n in nats])
        assert any("hangs over the ground" in doubt for doubt in judged.doubts) == hangs
        assert (judged.belief <= 0.65) == hangs
