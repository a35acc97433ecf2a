"""What tells the ground, what is lost beside a mask, and an object that is cut, from views of their
own kind."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scenes import looking_at
from traced import met, rays_of

from occ_recon_ros.imaging.joint import JointSegmenter, joint_masks
from occ_recon_ros.imaging.joint.edges import MANY_STEPS, StepsBeside
from occ_recon_ros.imaging.joint.plane import find_ground, ring_normal, standing_out
from occ_recon_ros.imaging.joint.small_view import small_view
from occ_recon_ros.imaging.joint.solve import Solution, Trial, joined, largest, looked_at
from occ_recon_ros.imaging.joint.space import Grid, fixation, silhouette
from occ_recon_ros.scene import (
    RenderSettings,
    TurntableSettings,
    make_object,
    render,
    turntable_cameras,
)

RIG = TurntableSettings(
    frames=10,
    step=2 * np.pi / 10,
    elevation=np.deg2rad(17),
    distance=1.0,
    width=240,
    height=180,
    focal_px=300.0,
)
SHAPE = RIG.height, RIG.width
EVERYWHERE = np.ones(SHAPE, np.bool_)
UPRIGHT = np.eye(3)
Y, X = np.mgrid[: RIG.height, : RIG.width]
DISC = ((X - 120) / 80) ** 2 + ((Y - 80) / 28) ** 2 < 1


def pattern(points, size=0.02):
    """(n,) grey levels of a texture in space."""
    return 120 + 50 * np.sin(points @ [1, 0.4, 0.2] / size) * np.cos(points @ [-0.3, 1, 0] / size)


def by_hand(turned):
    """Cameras that a hand carries around, in a frame that is turned (3, 3)."""
    rng, found = np.random.default_rng(4), []
    for k in range(12):
        around, up = 2 * np.pi * k / 12, np.deg2rad(rng.uniform(15, 50))
        way = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
        camera = looking_at(rng.uniform(0.9, 1.2) * way, 0.03 * rng.normal(size=3), focal_px=300.0)
        K = np.array([[300.0, 0, 120], [0, 300, 90], [0, 0, 1]])
        found.append(replace(camera, K=K, width=240, height=180))
    return [replace(c, R_camera_object=c.R_camera_object @ turned.T) for c in found]


def views_of(board_z=None, cameras=None, turned=UPRIGHT):
    """A long body of clouded skin over dark ground, with or without a pattern on that."""
    found, sizes = [], np.array([0.2, 0.05, 0.04])
    for camera in cameras or turntable_cameras(RIG):
        shown, camera = camera, replace(camera, R_camera_object=camera.R_camera_object @ turned)
        rays, centre = rays_of(camera), camera.centre
        grey = np.full(len(rays), 20.0)
        if board_z is not None:
            at = centre + ((board_z - centre[2]) / rays[:, 2])[:, None] * rays
            on = (np.abs(at[:, :2]) < 0.25).all(axis=1) & (rays[:, 2] < 0)
            grey[on] = pattern(at[on])
        away = met(camera, rays, sizes)
        hit = np.isfinite(away)
        grey[hit] = pattern(centre + away[hit, None] * rays[hit], 0.03)
        image = cv2.GaussianBlur(grey.reshape(SHAPE).astype(np.float32), (0, 0), 0.6)
        image = np.repeat(image[..., None].astype(np.uint8), 3, axis=2)
        found.append(small_view(image, shown, EVERYWHERE, None))
    return found


def ground_of(views):
    return find_ground(views, fixation([view.camera for view in views]), 0.3)


@cache
def on_a_board():
    """Views of the body over a board, and the ground that they tell."""
    views = views_of(board_z=-0.06)
    return views, ground_of(views)


def test_a_board_is_the_ground():
    _, ground = on_a_board()
    assert ground.plane.origin[2] == pytest.approx(-0.06, abs=0.002)
    assert ground_of(views_of()) is None


@pytest.mark.slow
@pytest.mark.parametrize("axis", [(0, 0, 0), (0.5, 0.8, -0.3)], ids=["upright", "askew"])
def test_the_ground_is_square_to_no_axis_where_a_hand_carries_the_camera(axis):
    # The axis that such cameras stand around is some degrees off it; that of the object frame is
    # it only where who measured the cameras did so from a board.
    turned = cv2.Rodrigues(np.array(axis, np.float64))[0]
    cameras = by_hand(turned)
    assert ring_normal(cameras) @ turned[:, 2] < np.cos(np.deg2rad(1.5))
    plane = ground_of(views_of(-0.06, cameras, turned)).plane
    assert plane.normal @ turned[:, 2] > np.cos(np.deg2rad(0.3))
    assert plane.origin @ turned[:, 2] == pytest.approx(-0.06, abs=0.002)


def test_the_ground_of_a_board_is_found_from_cameras_that_stand_around_nothing():
    # Photographs from the sides and two from above.
    cameras = by_hand(UPRIGHT)[::2]
    cameras[1:1] = [
        replace(cameras[0], t_camera_object=np.array(t), R_camera_object=R)
        for t, R in (([0, 0, 1.4], np.diag([1.0, -1, -1])), ([0, 0, 1.6], np.diag([-1.0, 1, -1])))
    ]
    assert ring_normal(cameras) is None
    plane = ground_of(views_of(-0.06, cameras)).plane
    assert plane.normal[2] > np.cos(np.deg2rad(0.3))
    assert plane.origin[2] == pytest.approx(-0.06, abs=0.002)


@pytest.mark.parametrize(
    ("areas", "which"),
    [
        # Every fourth height, of a painted animal on a dark plate: its back.
        ([0.01, 0.012, 0.013, 0.02, 0.055, 0.075, 0.115, 0.138, 0.102, 0.035, 0.001, 0, 0], None),
        # Of a checked board under a tin.
        ([0.05, 0.035, 0.046, 0.047, 0.068, 0.011, 0.298, 0.013, 0.095, 0.012, 0.009, 0, 0], 24),
    ],
)
def test_a_back_fits_over_many_heights_and_a_board_at_one(areas, which):
    heights = np.arange(4 * len(areas) - 3) / 4
    assert standing_out(np.interp(heights, np.arange(len(areas)), areas)) == which


@pytest.mark.parametrize(("at", "which"), [(24, 24), (20, None)])
def test_a_board_among_the_grain_of_a_table_is_where_the_cameras_were_measured_from(at, which):
    # Of photographs of black plastic on a white sheet with few marks, on a table of dark wood.
    areas = [0.045, 0.05, 0.045, 0.047, 0.06, 0.125, 0.212, 0.124, 0.065, 0.05, 0.045, 0.05, 0.04]
    areas = np.interp(np.arange(49) / 4, np.arange(13), areas)
    assert standing_out(areas) is None
    assert standing_out(areas, np.arange(49) == at) == which


def test_the_ground_is_kept_where_parts_of_the_views_show_too_little_of_it():
    views, ground = on_a_board()
    nearer = ground.nearer(views, np.array([0.01, 0.0, 0.02]), 0.1)
    assert nearer.plane.origin == pytest.approx([0.01, 0.0, ground.plane.origin[2]])
    assert nearer.plane.half == pytest.approx(ground.plane.half / 3)
    assert nearer.uneven == pytest.approx(ground.uneven / 3)
    assert len(nearer.places) == len(views)


def test_nearer_views_take_the_ground_of_those_from_farther_where_they_show_none():
    (_, ground), bare = on_a_board(), views_of()[::2]
    where = np.zeros(3), 0.1
    nearer = JointSegmenter()._seeking([(0, 0, 1, 1)], ground)(bare, *where)
    assert nearer.plane.origin[2] == pytest.approx(ground.plane.origin[2])
    assert JointSegmenter()._seeking([(0, 0, 1, 1)])(bare, *where) is None


def photograph(kind, k=0):
    """A blue body on white, where something is beside it."""
    image = np.full((*SHAPE, 3), 250.0)
    if kind == "white foot":  # a little darker, which turns
        image[75 : 120 + 3 * k, 40 + 4 * k : 175 + 4 * k] -= 12
    elif kind == "soft shadow":
        down, aside = (Y - 110 - k) / 5.0, (X - 95 - 10 * k) / 25.0
        image -= 150 * np.exp(-(aside**2) - down**2)[..., None]
    elif kind == "plate":  # which stays where it is
        image[75:125, 45:195] -= 30
    elif kind == "cloth":
        image -= np.random.default_rng(5).uniform(0, 60, (*SHAPE, 1)) * (X + Y > 0)[..., None]
        image[75 : 120 + 3 * k, 40 + 4 * k : 175 + 4 * k] -= 12
    image[DISC] = (200, 90, 60)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    image += np.random.default_rng(k).normal(0, 1, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("kind", "many"),
    [("", 0), ("white foot", 1), ("soft shadow", 0), ("plate", 0), ("cloth", 0)],
)
def test_steps_beside_a_mask_are_of_something_where_the_backdrop_is_even(kind, many):
    beside = StepsBeside()
    for k in range(6):
        beside.add(photograph(kind, k), DISC, EVERYWHERE)
    assert (np.median(beside.shares()) > MANY_STEPS) == many


def test_views_of_different_sizes_have_no_still_edges_in_common():
    beside = StepsBeside()
    for k in range(3):
        shown = slice(0, RIG.width - 10 * k)
        beside.add(photograph("plate")[:, shown], DISC[:, shown], EVERYWHERE[:, shown])
    assert (beside.shares() > MANY_STEPS).all()


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_an_object_that_every_picture_cuts_is_doubtful_and_not_refused():
    rig = replace(RIG, width=160, height=120, focal_px=667.0, elevation=np.deg2rad(10))
    body, look = make_object("figure"), RenderSettings(encoding="bgr8", noise=2.0)
    cameras = turntable_cameras(rig)
    found, masks = joint_masks([(render(body, c, look, k), c) for k, c in enumerate(cameras)])
    assert 0.4 < found.belief < 0.5
    assert any("border of the picture" in doubt for doubt in found.warnings)
    for mask, camera in zip(masks, cameras, strict=True):
        true = render(body, camera, RenderSettings(blur_px=0.0)) < 200
        mask = mask > 127
        assert np.count_nonzero(mask & true) > 0.95 * np.count_nonzero(mask | true)


def test_what_else_stands_in_the_room_is_not_the_object():
    cameras = by_hand(UPRIGHT)
    grid = Grid.around(np.full(3, -0.5), np.full(3, 0.5), 50)
    body = np.zeros(grid.shape, np.bool_)
    body[20:30, 20:30, 20:30] = True
    twice = body.copy()
    twice[22:25, 22:25, 33:36] = True  # its lid, held over it
    beside = twice.copy()
    beside[43:50, 20:40, 20:30] = True  # larger than the object, and in some of the pictures
    assert np.array_equal(looked_at(grid, beside, cameras), twice)
    assert np.array_equal(looked_at(grid, beside & ~twice, cameras), beside & ~twice)


@pytest.mark.parametrize(("says", "joins"), [(-0.5, True), (-3.0, False)])
def test_what_may_join_the_parts_of_an_object_is_of_it(says, joins):
    # A bird with a white neck, before a white table, ended below its neck.
    cameras = by_hand(UPRIGHT)
    grid = Grid.around(np.full(3, -0.2), np.full(3, 0.2), 40)
    whole = np.zeros(grid.shape, np.bool_)
    whole[17:23, 17:23, 4:36] = True
    body = whole.copy()
    body[:, :, 16:28] = False
    seen = np.full((RIG.height, RIG.width, 3), 128, np.uint8)
    views = [small_view(seen, camera, EVERYWHERE, None) for camera in cameras]
    shown = [
        np.where(
            silhouette(grid, body, c) > 0.5,
            3.0,
            np.where(silhouette(grid, whole, c) > 0.5, says, -3.0),
        )
        for c in cameras
    ]
    shown = [nats.astype(np.float32) for nats in shown]
    nothing = [np.zeros(SHAPE, np.float32)] * len(views)
    parts = Solution(
        grid, body, body.ravel() - 0.5, 0.07, None, shown, nothing, [], 3.0, None, [], shown, 3.0
    )
    found = joined(views, parts)
    assert (found is not None) == joins
    if joins:
        assert np.count_nonzero(found.body != whole) < 0.05 * np.count_nonzero(whole)
    assert joined(views, replace(parts, body=whole)) is None
    specks = np.zeros_like(whole)
    specks[20, 20, [10, 14]] = True
    assert joined(views, replace(parts, body=specks)) is None


def test_legs_that_a_shadow_cuts_off_are_no_specks():
    body = np.zeros((44, 32, 72), np.bool_)
    body[1:43, 1:31, 20:70] = True
    body[4:18, 8:22, 10:15] = body[26:40, 8:22, 10:15] = True  # 1.6 % of it each
    legs = np.count_nonzero(body)
    body[5:8, 5:8, 1:4] = True  # 0.04 %
    kept = largest(body)
    assert kept[:, :, 10:15].any()
    assert np.count_nonzero(kept) == legs


@pytest.mark.slow
@pytest.mark.usefixtures("few_heights")
def test_a_knob_of_a_round_pot_before_a_room_is_not_believed():
    # The pot looks the same in all views, outline and all; only its red knob is seen to turn.
    rng = np.random.default_rng(1)
    room = np.repeat((150 + 0.4 * Y)[..., None], 3, axis=2) * [1.0, 0.95, 0.9]
    for _ in range(12):
        x, y = rng.integers(0, 220), rng.integers(0, 160)
        room[y : y + 30, x : x + 18] = rng.uniform(40, 220, 3)
    balls = [((0, 0, 0), 0.07, (150, 200, 225)), ((0.055, 0, 0.055), 0.018, (40, 40, 190))]
    segmenter = JointSegmenter()
    for k, camera in enumerate(turntable_cameras(RIG)):
        rays = rays_of(camera)
        image, nearest = room.reshape(-1, 3).copy(), np.full(len(rays), np.inf)
        for middle, radius, colour in balls:
            away = met(camera, rays, np.full(3, radius), middle)
            front = away < nearest
            light = 0.8 + 0.2 * (away[front] * rays[front, 2] + camera.centre[2]) / radius
            image[front] = np.clip(light, 0.5, 1)[:, None] * colour
            nearest[front] = away[front]
        image = cv2.GaussianBlur(image.reshape(*SHAPE, 3), (0, 0), 0.7)
        image += np.random.default_rng(k).normal(0, 1.5, image.shape)
        segmenter.add(np.clip(image, 0, 255).astype(np.uint8), camera)
    found = segmenter._solve(Trial(0.07))
    assert found.belief <= 0.65
    assert any("of the pictures" in doubt for doubt in found.warnings)
