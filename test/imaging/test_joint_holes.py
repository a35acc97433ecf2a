"""Holes of the object before a dark backdrop, and hollows that are as dark."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from traced import met, rays_of, solution

from occ_recon_ros.imaging.joint import Volume, joint_masks
from occ_recon_ros.imaging.joint.colours import COUNT
from occ_recon_ros.imaging.joint.holes import holes_of, seen_through
from occ_recon_ros.imaging.joint.judge import MUCH_BESIDE, beside_of, judge
from occ_recon_ros.imaging.joint.models import Models
from occ_recon_ros.imaging.joint.plane import Ground, plane_at
from occ_recon_ros.imaging.joint.small_view import small_view
from occ_recon_ros.imaging.joint.space import Grid, silhouettes
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

RIG = TurntableSettings(
    frames=16,
    step=2 * np.pi / 16,
    elevation=np.deg2rad(8),
    distance=1.0,
    width=240,
    height=180,
    focal_px=300.0,
)
SHAPE = RIG.height, RIG.width
BASE = (0, 0, -0.12), (0.17, 0.09, 0.02)
BEAM = (0, 0, 0.12), (0.2, 0.1, 0.02)
POSTS = [((x, y, 0), (0.02, 0.02, 0.11)) for x in (-0.15, 0.15) for y in (-0.07, 0.07)]
WALL = (0, 0, 0), (0.15, 0.02, 0.11)
ARCH = [BASE, BEAM, *POSTS]


def seen(camera, boxes):
    """(h w, 3) where rays of a camera meet boxes first, NaN where none, and (h w,) which box."""
    v, u = np.mgrid[: RIG.height, : RIG.width]
    rays = camera.viewing_directions(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    nearest, which = np.full(len(rays), np.inf), np.full(len(rays), -1)
    for k, (middle, half) in enumerate(boxes):
        to = np.array(middle) - camera.centre
        with np.errstate(divide="ignore"):
            sides = np.stack([(to - half) / rays, (to + half) / rays])
        enters, leaves = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
        hit = (enters < leaves) & (enters < nearest)
        nearest[hit], which[hit] = enters[hit], k
    with np.errstate(invalid="ignore"):
        return camera.centre + nearest[:, None] * rays, which


@cache
def turn(walled, dark=()):
    """Images of a stone arch before black cloth, and its masks; the sides of what stands between
    its posts may be as dark."""
    rng = np.random.default_rng(5)
    found = []
    for camera in turntable_cameras(RIG):
        points, which = seen(camera, [*ARCH, WALL] if walled else ARCH)
        grey = np.full(len(points), 12.0)
        on = which >= 0
        skin = np.sin(points[on] @ [90, 35, 20]) * np.cos(points[on] @ [-30, 80, 40])
        grey[on] = 130 + 45 * skin
        for side in dark:
            shadow = (which == len(ARCH)) & (side * points[:, 1] > 0.0199)
            grey[shadow & (np.abs(points[:, 2]) < 0.1)] = 12.0
        image = np.clip(grey + rng.normal(0, 1.5, len(grey)), 0, 255).reshape(SHAPE)
        image = np.repeat(image[..., None].astype(np.uint8), 3, axis=2)
        found.append((image, camera, on.reshape(SHAPE)))
    return found


def filled(times=1.0):
    """A grid, and the body without its holes, so many times as large."""
    corner = times * np.array([0.21, 0.13, 0.16])
    grid = Grid.around(-corner, corner, 48)
    x, y, z = np.abs(grid.centres()).T / times
    return grid, ((x < 0.17) & (y < 0.09) & (z < 0.14)).reshape(grid.shape)


def holes_in(views, times=1.0):
    """Of each view, where it is found to see through the body, and where it truly does."""
    grid, body = filled(times)
    cameras = [camera for _, camera, _ in views]
    masks = [outline > 0.5 for outline in silhouettes(grid, body, cameras)]
    small = [small_view(image, camera, np.ones(SHAPE, bool), None) for image, camera, _ in views]
    found = holes_of(small, grid, body, masks)
    return list(zip(found, [m & ~t for m, (*_, t) in zip(masks, views, strict=True)], strict=True))


@pytest.mark.parametrize(
    ("walled", "times", "noise"), [(False, 1, 0), (True, 1, 0), (False, 12, 0), (False, 0.012, 6)]
)
def test_what_is_seen_through_is_found(walled, times, noise):
    """Of an object of half a metre, of five metres, and, in noisy images, of five millimetres."""
    rng, views = np.random.default_rng(6), []
    for image, camera, true in turn(walled):
        noisy = np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)
        views.append((noisy, replace(camera, t_camera_object=times * camera.t_camera_object), true))
    holes = holes_in(views, times)
    found, true = (sum(int(part.sum()) for part in parts) for parts in zip(*holes, strict=True))
    right = sum(int((hole & through).sum()) for hole, through in holes)
    assert right > 0.97 * found
    assert found > (0.3 if walled else 0.75) * true


def test_a_wall_that_is_as_dark_as_the_backdrop_on_one_side_is_no_hole():
    assert not any(hole.any() for hole, _ in holes_in(turn(True, dark=(1,))))


def test_before_a_light_backdrop_colours_tell():
    views = [
        (np.where(true[..., None], image, 120 + image), camera, true)
        for image, camera, true in turn(False)
    ]
    assert not any(hole.any() for hole, _ in holes_in(views))


@pytest.mark.parametrize(
    ("light", "darker", "shadow", "open_to"),
    [
        (180, 0, 0.0, True),
        (180, 0, 0.4, True),  # shadows move over the ground
        (180, 12, 0.0, False),  # a shaded part of the object
        (20, 0, 0.0, False),  # a hollow as dark as the backdrop
    ],
)
def test_a_hole_shows_its_place_as_it_is_when_empty(light, darker, shadow, open_to):
    rng = np.random.default_rng(3)
    y, x = np.mgrid[: RIG.height, : RIG.width]
    away = np.hypot(x - 120, y - 90)
    mask, hole = (away < 50) & (away >= 25), away < 25
    image = light + rng.normal(0, 2.0, SHAPE)
    image[mask] = 90
    image[hole] -= darker
    image[hole & (x < 95 + 50 * shadow)] *= 0.7
    image = np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    view = small_view(image, next(iter(turntable_cameras(RIG))), np.ones(SHAPE, bool), None)
    scene = np.full((*SHAPE, 3), light, np.float32), np.full(SHAPE, 2.0, np.float32)
    assert (seen_through(view, mask, [scene]) == (hole & open_to)).all()
    assert not seen_through(view, mask, []).any()


def agreed(views, found):
    masks = [mask > 0 for mask in found]
    return [np.sum(m & t) / np.sum(m | t) for m, (*_, t) in zip(masks, views, strict=True)]


@pytest.mark.slow
@pytest.mark.usefixtures("few_heights")
def test_masks_have_the_holes(monkeypatch):
    monkeypatch.setattr("occ_recon_ros.imaging.joint.solve._GRIDS", (36, 48, 54))
    views = turn(False)[::2]
    volume = Volume("box", np.zeros(3), np.array([0.5, 0.4, 0.4]))
    found, masks = joint_masks([(image, camera) for image, camera, _ in views], volume)
    assert found.belief > 0.9
    assert np.mean(agreed(views, masks)) > 0.98
    assert min(agreed(views, masks)) > 0.95


@pytest.mark.slow
def test_a_vase_with_black_paintings_on_all_sides_stays_whole():
    rng, views = np.random.default_rng(1), []
    for camera in turntable_cameras(RIG):
        rays = rays_of(camera)
        away = met(camera, rays, np.array([0.11, 0.11, 0.14]))
        on = np.isfinite(away)
        points = camera.centre + away[on, None] * rays[on]
        grey = np.full(len(rays), 12.0)
        around = (np.arctan2(points[:, 1], points[:, 0]) * 4 / np.pi) % 1
        painted = (np.abs(around - 0.5) < 0.19) & (np.abs(points[:, 2]) < 0.025)
        grey[on] = np.where(painted, 12.0, 130 + 40 * np.sin(points @ [90, 35, 20]))
        image = np.clip(grey + rng.normal(0, 1.5, len(grey)), 0, 255).reshape(SHAPE)
        image = np.repeat(image[..., None].astype(np.uint8), 3, axis=2)
        views.append((image, camera, on.reshape(SHAPE)))
    volume = Volume("box", np.zeros(3), np.full(3, 0.4))
    _, masks = joint_masks([(image, camera) for image, camera, _ in views], volume)
    assert min(agreed(views, masks)) > 0.97


def beside(turned, boxes, scene=None, more=None, ground=None):
    """How much is found to be lost beside right masks of dark boxes before a light backdrop, where
    ``more`` of each view (h, w) is as dark."""
    grid, _ = filled()
    middles = grid.centres()
    body = np.any([(np.abs(middles - at) < half).all(axis=1) for at, half in boxes], axis=0)
    views, masks = [], []
    for k, (image, camera, true) in enumerate(turned):
        dark = true if more is None else true | more[k]
        image = np.where(dark[..., None], 70, 180 + image // 12).astype(np.uint8)
        views.append(small_view(image, camera, np.ones(SHAPE, bool), None))
        masks.append(true)
    models = Models(np.zeros(COUNT), np.ones(COUNT), [[scene] if scene else [] for _ in views])
    nats = [np.where(mask, 3, -3).astype(np.float32) for mask in masks]
    total = np.where(body, 9.0, -9.0).astype(np.float32)
    found = solution(
        grid, body.reshape(grid.shape), total, 0.07, nats, models=models, ground=ground
    )
    return beside_of(judge(views, found, masks).views)


def test_what_is_seen_through_the_object_is_no_lost_part_of_it():
    """Edges enclose the floor between the posts of an arch, as they enclose what is lost."""
    scene = np.full((*SHAPE, 3), 181, np.float32), np.full(SHAPE, 2.0, np.float32)
    assert beside(turn(False), ARCH) > MUCH_BESIDE
    assert beside(turn(False), ARCH, scene) == 0.0


def test_what_is_beside_the_object_at_another_place_in_each_view_is_no_lost_part_of_it():
    boxes, more = [*ARCH, WALL], []
    y, x = np.mgrid[: RIG.height, : RIG.width]
    for k, (*_, true) in enumerate(turn(True)):
        rows, columns = np.nonzero(true)
        middle = columns.mean(), rows.mean()
        u, v = [
            (columns.min() - 6, middle[1]),
            (columns.max() + 6, middle[1]),
            (middle[0], rows.min() - 6),
            (middle[0], rows.max() + 6),
        ][k % 4]
        more.append((np.abs(x - u) < 14) & (np.abs(y - v) < 14) & ~true)
    gaps = beside(turn(True), boxes)  # beside its wall the arch is open
    assert beside(turn(True), boxes, more=more) == pytest.approx(gaps, abs=0.005)
    same = [(np.abs(x - 120) < 30) & (np.abs(y - 90) < 88) & ~true for *_, true in turn(True)]
    assert beside(turn(True), boxes, more=same) > gaps + MUCH_BESIDE


def test_print_on_the_ground_is_no_lost_part_of_what_stands_on_it():
    """Edges enclose a picture in a newspaper as well."""
    boxes = [*ARCH, WALL]
    y, x = np.mgrid[: RIG.height, : RIG.width]
    there = (np.abs(x - 120) < 30) & (np.abs(y - 90) < 88)
    picture = [there & ~true for *_, true in turn(True)]
    shows = np.where(there, 73.0, 181.0)[..., None] * np.ones(3, np.float32)
    scene = shows.astype(np.float32), np.full(SHAPE, 3.0, np.float32)
    ground = Ground(plane_at(np.array([0, 0, -0.14]), np.array([0, 0, 1.0]), 0.5), [], 0.0)
    assert beside(turn(True), boxes, scene, picture) > MUCH_BESIDE
    assert beside(turn(True), boxes, scene, picture, ground) == 0.0
