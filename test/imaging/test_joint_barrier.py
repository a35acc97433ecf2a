"""Where colours do not tell an object from its backdrop, but edges do."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.imaging import ContourError, joint
from occ_recon_ros.imaging.joint import JointMasks, JointSegmenter
from occ_recon_ros.imaging.joint.barrier import (
    barriers,
    enclosed_beside,
    of_one_place,
    speaking,
)
from occ_recon_ros.imaging.joint.judge import MUCH_BESIDE, ViewReport, beside_of
from occ_recon_ros.imaging.joint.small_view import small_view
from occ_recon_ros.imaging.joint.solve import ROUNDS, Trial
from occ_recon_ros.imaging.joint.space import Grid, silhouettes
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

RIG = TurntableSettings(frames=10, step=0.63, width=200, height=150, focal_px=520.0)
BALLS = (([0.0, 0.0, -0.03], 0.06), ([0.03, 0.01, 0.04], 0.045), ([-0.04, -0.03, 0.03], 0.035))
LIGHT = np.array([0.6, 0.3, 0.74])  # turns with the object
Y, X = np.mgrid[: RIG.height, : RIG.width]
UNEVEN = 55.0 + 60 * Y / RIG.height + 20 * X / RIG.width
PICTURE = np.ones(UNEVEN.shape, np.bool_)


def iou(a, b):
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def photograph(camera, k):
    """Balls that stick together, of the grey levels of the backdrop, and where they are seen."""
    image, nearest = UNEVEN.copy(), np.full(UNEVEN.shape, np.inf)
    directions = np.stack([X, Y, np.ones_like(X)], axis=-1) @ np.linalg.inv(camera.K).T
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for centre, radius in BALLS:
        at = camera.R_camera_object @ centre + camera.t_camera_object
        along = directions @ at
        inside = radius**2 - (at @ at - along**2)
        depth = along - np.sqrt(np.maximum(inside, 0))
        normal = (depth[..., None] * directions - at) @ camera.R_camera_object / radius
        seen = (inside > 0) & (depth < nearest)
        image[seen] = (45 + 95 * np.maximum(normal @ LIGHT, 0))[seen]
        nearest[seen] = depth[seen]
    noise = np.random.default_rng(k).normal(0, 1.5, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8), np.isfinite(nearest)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_edges_find_a_shaded_body_of_the_greys_of_its_backdrop():
    segmenter, images, truth = JointSegmenter(), [], []
    for k, camera in enumerate(turntable_cameras(RIG)):
        image, seen = photograph(camera, k)
        images.append(image)
        truth.append(seen)
        segmenter.add(image, camera)
    with pytest.raises(ContourError, match="nothing stands out"):
        segmenter._solve(Trial(0.07))
    found = segmenter._solve(Trial(0.07, ROUNDS))
    scores = [
        iou(found.mask(k, image) > 127, seen)
        for k, (image, seen) in enumerate(zip(images, truth, strict=True))
    ]
    assert np.mean(scores) > 0.96
    assert min(scores) > 0.94


def level(image, row, column):
    view = small_view(image, next(iter(turntable_cameras(RIG))), PICTURE, None)
    return barriers(view)[row, column]


def disc(light, gap=0.0):
    """A disc on an uneven backdrop that it is ``light`` lighter than, but for a gap (radians)."""
    away = np.hypot(X - 100, Y - 75)
    turn = np.abs(np.arctan2(Y - 75, X - 100))
    more = light * np.clip((30 - away) / 2 + 0.5, 0, 1)
    soft = np.clip((60 - away) / 60, 0, 1) * light  # as the backdrop comes to meet it there
    image = UNEVEN + np.where(turn < gap, soft, more)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def test_a_barrier_grows_with_the_edge_and_not_with_the_unevenness():
    levels = [level(disc(light), 75, 100) for light in (0, 5, 20, 60)]
    assert levels == sorted(levels)
    assert levels[-1] > levels[0] + 6
    assert level(disc(60), 75, 20) == pytest.approx(levels[0], abs=2)


def test_a_gap_in_the_outline_lets_it_out():
    assert level(disc(60, gap=0.4), 75, 100) < level(disc(60), 75, 100) - 4


def test_barriers_never_say_more_than_leaks_and_handles_allow():
    inside = np.hypot(X - 100, Y - 75) < 28
    levels = [barriers(small_view(disc(60), next(iter(turntable_cameras(RIG))), PICTURE, None))]
    (nats,) = speaking(levels, [inside], [~inside & (np.hypot(X - 100, Y - 75) > 34)])
    assert nats[75, 100] > 1.0
    assert nats[75, 20] < -1.0
    assert nats.max() < np.log(1 / 0.05)
    assert nats.min() > np.log(0.2) - 0.01


def test_what_edges_enclose_beside_a_mask_is_seen():
    image = disc(60)
    away = np.hypot(X - 100, Y - 75)
    view = small_view(image, next(iter(turntable_cameras(RIG))), PICTURE, None)
    whole = away < 30
    (none,) = enclosed_beside([view], [whole], [~PICTURE], 2.0)
    (lost,) = enclosed_beside([view], [whole & (Y < 75)], [~PICTURE], 2.0)
    (shaded,) = enclosed_beside([view], [whole & (Y < 75)], [Y >= 75], 2.0)
    assert not none.any()
    assert not shaded.any()
    assert 0.5 < np.count_nonzero(lost) / np.count_nonzero(whole & (Y < 75)) < 1.1


@pytest.mark.parametrize(("half_width", "counts"), [(18, True), (45, False)])
def test_a_foot_of_steeper_edges_counts_as_beside_and_a_plate_does_not(half_width, counts):
    away = np.hypot(X - 100, Y - 75)
    foot = (np.abs(X - 100) < half_width) & (Y >= 103) & (Y < 118)
    image = np.where(foot & (away >= 30), 5, disc(60)).astype(np.uint8)
    view = small_view(image, next(iter(turntable_cameras(RIG))), PICTURE, None)
    (beside,) = enclosed_beside([view], [away < 30], [foot], 2.0)  # as dark as a shadow
    area = np.count_nonzero(foot & (away >= 30)) if counts else 0
    assert np.count_nonzero(beside) == pytest.approx(area, rel=0.4)


@pytest.mark.parametrize(
    ("at", "shown", "coloured", "counts"),
    [
        (0.08, 10, False, True),  # a part beside the body
        (0.08, 6, False, True),  # whose edges leak in some views
        (0.08, 2, False, False),
        (0.4, 10, False, False),  # what stands in the room behind
        (0.4, 10, True, True),  # of the object's colours
    ],
)
def test_what_is_lost_is_at_one_place(at, shown, coloured, counts):
    cameras = list(turntable_cameras(RIG))
    views = [small_view(disc(60), camera, PICTURE, None) for camera in cameras]
    grid = Grid.around(np.full(3, -0.13), np.full(3, 0.13), 48)
    body = (np.linalg.norm(grid.centres(), axis=1) < 0.06).reshape(grid.shape)
    room = Grid.around(np.full(3, -0.45), np.full(3, 0.45), 96)
    thing = np.linalg.norm(room.centres() - [at, 0, -0.02], axis=1) < 0.03
    masks, drawn = (
        [outline > 0.5 for outline in silhouettes(*what, cameras)]
        for what in ((grid, body), (room, thing.reshape(room.shape)))
    )
    regions = [d & ~m & (k < shown) for k, (d, m) in enumerate(zip(drawn, masks, strict=True))]
    saying = [np.where(coloured, 2.0, -4.0) * np.ones(PICTURE.shape, np.float32)] * len(views)
    kept = of_one_place(views, grid, body, 2.0, masks, regions, saying)
    before, after = (sum(map(np.count_nonzero, told)) for told in (regions, kept))
    assert before > 100
    assert after > 0.9 * before if counts else after < 0.2 * before


@pytest.mark.parametrize(("views", "lost"), [(1, False), (2, False), (4, True), (6, True)])
def test_what_edges_enclose_in_some_views_alone_is_lost_for_in_the_others_they_leak(views, lost):
    shares = [0.05] * views + [0.0] * (10 - views)
    reports = [ViewReport(1.0, 1.0, 0.0, "", share) for share in shares]
    assert (beside_of(reports) > MUCH_BESIDE) == lost


def masks(agreement, support, belief, beside=0.0, edgeless=0.0):
    report = ViewReport(agreement, support, 0.0, "", beside, edgeless)
    return JointMasks("joint", belief, (), (report,), (), None, ())


ROUND = "of what stands still too"
UNSHADED = "in no shadow"
BESIDE = [0, ROUND, 0, 3]
MORE = [masks(1, 0.6, 0.6, 0.2)]  # found by ROUND


@pytest.mark.parametrize(
    ("found", "asked", "chosen"),
    [
        ([masks(0.98, 0.99, 0.9)], [0], 0),  # colours suffice
        ([masks(0.95, 0.9, 0.6), masks(0.94, 0.8, 0.7), masks(0.95, 0.93, 0.5)], [0, 0, 2], 2),
        (
            [masks(0.7, 0.7, 0), masks(0.8, 0.7, 0.1), masks(0.8, 0.6, 0), masks(1, 0.7, 0.4)],
            [0, 0, 2, 3],
            3,
        ),
        # Edges enclose more beside the body that colours find.
        ([masks(1, 0.7, 0.6, 0.2), *MORE, masks(1, 0.9, 0.65, 0.2), masks(1, 1, 1)], BESIDE, 3),
        ([masks(1, 1, 0.65, 0.2), *MORE, masks(1, 1, 0.65, 0.2), masks(0.99, 0.98, 1)], BESIDE, 3),
        ([masks(1, 1, 0.6, 0.03), *MORE, masks(1, 1, 0.6, 0.03), masks(0.99, 0.99, 1)], BESIDE, 3),
        ([masks(1, 0.7, 0.6, 0.2), *MORE, masks(1, 0.9, 0.65, 0.2), masks(1, 0.7, 1)], BESIDE, 2),
        # What they enclose stood still, and is of the object.
        ([masks(1, 1, 0.65, 0.2), masks(0.98, 0.97, 1)], BESIDE[:2], 1),
        ([masks(0.8, 1, 0.5, 0.2), masks(1, 1, 1)], [0, 0], 1),
        # Part of the outline lies where images show no edge: a shadow, or a reflection.
        ([masks(1, 0.98, 0.6, 0, 0.12), masks(1, 0.97, 1)], [0, 3], 1),
        # Where edges do not help, what else there is is tried, and the best taken.
        (
            [masks(1, s, 0.6, 0, 0.1) for s in (0.9, 0.98, 0.95)] + [masks(1, 0.9, 1.0)],
            [0, 3, 0, 2],
            3,
        ),
        ([masks(1, s, 0.6, 0, 0.1) for s in (0.9, 0.98, 0.95, 0.9)], [0, 3, 0, 2], 1),
        ([None, None, masks(0.6, 0.3, 0.0), masks(1.0, 0.9, 0.6)], [0, 0, 2, 3], 3),
        # Half of a mouse is as white as its table: colours confirm little of any outline.
        (
            [masks(0.98, s, 0.7) for s in (0.86, 0.6, 0.84, 0.79)] + [masks(1, 0.94, 0.65)],
            [0, ROUND, 0, 2, 3],
            4,
        ),
    ],
)
def test_edges_are_asked_where_colours_do_not_suffice(monkeypatch, found, asked, chosen):
    segmenter, tried = trials(monkeypatch, found)
    assert segmenter.solve() is found[chosen]
    assert tried == asked


def whole(area, belief, cut_short=False):
    """Masks of so much of a picture, which agree."""
    rows = np.zeros((100, 100), np.bool_)
    rows[: round(100 * area)] = True
    small, windows = (rows,) * RIG.frames, ((0, 0, RIG.width, RIG.height),) * RIG.frames
    found = masks(1, 0.95, belief)
    return replace(found, cut_short=cut_short, small=small, windows=windows)


@pytest.mark.parametrize(
    ("area", "asked", "chosen"),
    [(0.24, [0, ROUNDS], 1), (0.3, [0, ROUNDS, 0], 2)],
    ids=["feet", "a plate"],
)
def test_edges_are_asked_at_once_of_what_shows_edges_beside_it(monkeypatch, area, asked, chosen):
    """But what they enclose may be the plate as well, on which it stands."""
    found = [whole(0.2, 0.65, cut_short=True), whole(area, 1.0), whole(0.2, 1.0)]
    segmenter, tried = trials(monkeypatch, found)
    best = segmenter.solve()
    assert best.small is found[chosen].small
    assert tried == asked


@pytest.mark.parametrize(
    ("ground", "asked"), [("a newspaper", [0, UNSHADED]), (None, [0, 0])], ids=["print", "none"]
)
def test_on_print_what_is_grey_is_asked_for_without_shadow(monkeypatch, ground, asked):
    found = [masks(0.95, 0.95, 0.4), masks(0.99, 0.94, 0.96)]
    segmenter, tried = trials(monkeypatch, found)
    segmenter._grounds["any"] = ground
    assert segmenter.solve() is found[1]
    assert tried == asked


def test_a_known_print_has_edges_of_its_own(monkeypatch):
    found = [masks(1, s, 0.6, 0, 0.12) for s in (0.98, 0.95, 0.9)]
    segmenter, tried = trials(monkeypatch, found)
    segmenter._backdrop = "a print"
    assert segmenter.solve() is found[0]
    assert tried == [0, 0, ROUNDS - 1]


@pytest.mark.parametrize(
    ("support", "asked"), [(0.95, [0]), (0.86, [0, ROUND, 0, ROUNDS - 1, ROUNDS])]
)
def test_strangers_are_left_out_where_colours_confirm_what_the_rest_sees(
    monkeypatch, support, asked
):
    found = [masks(0.98, support, 0.7), *[masks(0.98, 0.86, 0.7)] * 4]
    segmenter, tried = trials(monkeypatch, found)
    assert segmenter.solve(asks_again=lambda _: True) is found[0]
    assert tried == asked


@pytest.mark.parametrize(
    ("first", "asked"),
    [([masks(0.95, 0.7, 0.6, 0.2)] * 3, [0, ROUND, 0, 3, ROUND]), ([None] * 3, [0, 0, 2, 3])],
)
def test_what_stands_still_is_asked_where_edges_left_nothing_to_doubt(monkeypatch, first, asked):
    """Of a body that edges found where they enclosed more beside the first ones."""
    sure = replace(masks(1, 1, 1.0), trial=Trial(0.07, ROUNDS))
    segmenter, tried = trials(monkeypatch, [*first, sure, masks(1, 0.9, 0.6)])
    assert segmenter.solve() is sure
    assert tried == asked


def trials(monkeypatch, found):
    """A segmenter that finds these, trial by trial, and the list of what it tries."""
    tried = []

    def solve(self, how):
        what = how.edged if how.still else ROUND
        tried.append(what if how.shaded else UNSHADED)
        if found[len(tried) - 1] is None:
            raise ContourError("no_object", "nothing")
        return found[len(tried) - 1]

    monkeypatch.setattr(JointSegmenter, "_solve", solve)
    segmenter = JointSegmenter()
    for k, camera in enumerate(turntable_cameras(RIG)):
        segmenter.add(photograph(camera, k)[0], camera)
    return segmenter, tried


@pytest.mark.parametrize(
    ("edged", "heard"), [(0, [1, 1, 1]), (ROUNDS - 1, [1, 1, 1]), (ROUNDS, [0.3, 0.3, 1])]
)
@pytest.mark.usefixtures("coarse")
def test_colours_speak_softly_while_they_are_learnt_from_edges(monkeypatch, edged, heard):
    told = []

    def occupied(grid, views, saying, allowed, solid):
        told.append(max(float(nats.max()) for nats in saying))
        ball = np.linalg.norm(grid.centres(), axis=1) < 0.06
        return ball.reshape(grid.shape), np.zeros(len(ball), np.float32)

    ones = np.ones(UNEVEN.shape, np.float32)
    monkeypatch.setattr(joint.solve, "occupied", occupied)
    monkeypatch.setattr(joint.solve, "_said", lambda *_: ones)
    monkeypatch.setattr(joint.solve, "speaking", lambda levels, *_: [0 * ones] * len(levels))
    cameras = list(turntable_cameras(RIG))[::2]
    views = [small_view(photograph(c, k)[0], c, PICTURE, None) for k, c in enumerate(cameras)]
    joint.solve.solve(views, None, Trial(0.07, edged), seek=lambda *_: None)
    assert told == pytest.approx(heard)
