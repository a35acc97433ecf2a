"""The shadow that a thing throws on what it stands on, as grey as its own foot."""

import cv2
import numpy as np
import pytest
from traced import met, rays_of, solution

from occ_recon_ros.imaging.joint import ramps, segmenter
from occ_recon_ros.imaging.joint.colours import COUNT, histogram
from occ_recon_ros.imaging.joint.judge import judge
from occ_recon_ros.imaging.joint.models import Models
from occ_recon_ros.imaging.joint.occupancy import occupied
from occ_recon_ros.imaging.joint.ramps import MUCH_IN_SHADOW, shadow_ramps
from occ_recon_ros.imaging.joint.segmenter import _without_shadow
from occ_recon_ros.imaging.joint.shadow import in_shadow
from occ_recon_ros.imaging.joint.small_view import small_view
from occ_recon_ros.imaging.joint.solve import cut_back
from occ_recon_ros.imaging.joint.space import Grid, silhouettes
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

RIG = TurntableSettings(
    frames=8,
    step=2 * np.pi / 8,
    elevation=np.deg2rad(20),
    distance=1.0,
    width=160,
    height=120,
    focal_px=400.0,
)
SIZES = np.array([0.09, 0.05, 0.05])
Y, X = np.mgrid[: RIG.height, : RIG.width]


def photograph(camera, k, deep, lens=0.7):
    """A grey egg with a red belt on white ground, and where it is; ``deep``: share of the light
    that its shadow takes; ``lens``: px of blur."""
    rays, centre = rays_of(camera), camera.centre
    image = np.full((len(rays), 3), 245.0)
    at = centre + ((-SIZES[2] - centre[2]) / rays[:, 2])[:, None] * rays
    image *= 1 - deep / (1 + (np.hypot(at[:, 0] / 1.4, at[:, 1]) / 0.05) ** 8)[:, None]
    away = met(camera, rays, SIZES)
    hit = np.isfinite(away)
    belt = np.abs(centre[2] + away[hit] * rays[hit, 2]) < 0.02
    image[hit] = np.where(belt[:, None], (30, 30, 150), 60)
    image = cv2.GaussianBlur(image.reshape(*X.shape, 3), (0, 0), lens)
    image += np.random.default_rng(k).normal(0, 1, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), hit.reshape(X.shape)


def looked_at(deep, lens=0.7):
    """Views of the egg, where it is, where all that is dark is, and where it is grey."""
    views, eggs, dark, grey = [], [], [], []
    for k, camera in enumerate(turntable_cameras(RIG)):
        image, egg = photograph(camera, k, deep, lens)
        views.append(small_view(image, camera, np.ones(egg.shape, np.bool_), None))
        eggs.append(egg)
        dark.append(image.min(axis=2) < 150)
        grey.append(np.ptp(image.astype(int), axis=2) < 20)
    return views, eggs, dark, grey


def test_an_outline_in_a_soft_shadow_is_told_from_one_at_the_object():
    views, eggs, dark, grey = looked_at(0.75)
    assert shadow_ramps(views, eggs, grey)[1] < MUCH_IN_SHADOW
    below, share = shadow_ramps(views, dark, grey)
    assert share > 2 * MUCH_IN_SHADOW
    assert not any((ramp & egg).any() for ramp, egg in zip(below, eggs, strict=True))
    assert shadow_ramps(views, dark, [np.zeros_like(g) for g in grey])[1] == 0


@pytest.mark.parametrize("axis", [None, np.array([0.0, 0.0, -1.0])])
def test_what_is_not_below_is_no_contact_shadow(axis, monkeypatch):
    views, _, dark, grey = looked_at(0.75)
    monkeypatch.setattr(ramps, "ring_normal", lambda _: axis)
    assert shadow_ramps(views, dark, grey)[1] < 0.1 * MUCH_IN_SHADOW


def test_a_grey_thing_out_of_focus_is_in_no_shadow():
    views, eggs, _, grey = looked_at(0.0, lens=2.5)
    assert shadow_ramps(views, eggs, grey)[1] == 0


@pytest.fixture
def found_in(request):
    """Views of the egg, where it is in them, and the body that their dark pixels bear."""
    views, eggs, dark, _ = looked_at(request.param)
    cameras = [view.camera for view in views]
    said = [np.where(d, 3, -3).astype(np.float32) for d in dark]
    grid = Grid.around(np.full(3, -0.11), np.full(3, 0.11), 44)
    body, total = occupied(grid, views, said, np.ones(grid.shape, np.bool_), 0.07)
    ground = sum(histogram(v.bins[~d]) for v, d in zip(views, dark, strict=True))
    models = Models(np.zeros(COUNT), ground, [[]] * len(views), shaded=in_shadow(ground))
    known = {"models": models, "outlines": silhouettes(grid, body, cameras), "blur": 2.0}
    return views, eggs, solution(grid, body, total, 0.07, said, **known)


def iou(masks, eggs):
    pairs = zip(masks, eggs, strict=True)
    return np.mean([np.count_nonzero(m & e) / np.count_nonzero(m | e) for m, e in pairs])


@pytest.mark.parametrize("found_in", [0.75], indirect=True)
def test_a_contact_shadow_is_cut_off_and_doubted(found_in, monkeypatch):
    views, eggs, whole = found_in
    assert iou(_without_shadow(views, whole)[1], eggs) > 0.95
    monkeypatch.setattr(segmenter, "_CUTS", 0)
    found, masks = _without_shadow(views, whole)
    assert iou(masks, eggs) < 0.9
    judged = judge(views, whole, masks)
    assert (judged.belief, judged.doubts) == (1.0, [])  # nothing else tells
    judged = judge(views, found, masks)
    belief, warnings = judged.belief, judged.doubts
    assert belief == pytest.approx(0.65)
    assert "contact shadow" in warnings[0]


@pytest.mark.parametrize("found_in", [0.0], indirect=True)
def test_a_grey_foot_that_other_views_miss_is_kept(found_in, monkeypatch):
    views, eggs, whole = found_in
    found, masks = _without_shadow(views, whole)
    assert found.in_shadow == 0
    feet = [egg & (np.abs(Y - 80) < 20) for egg in eggs]
    monkeypatch.setattr(segmenter, "shadow_ramps", lambda *_: (feet, 0.3))
    assert cut_back(views, whole, feet).body.sum() < 0.9 * whole.body.sum()
    found, masks = _without_shadow(views, whole)
    assert found.body is whole.body
    assert iou(masks, eggs) > 0.98
