"""Good scans are called good, and no scan that its own images refute is."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from exact_turns import exact_turn

from occ_recon_ros.evaluation.advice import TIGHT
from occ_recon_ros.evaluation.ends import Ends
from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.findings import median_size_px
from occ_recon_ros.evaluation.verdict import judge
from occ_recon_ros.geometry import contours_from_loops
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.streams.alone import Outlines
from occ_recon_ros.surface.agreement import silhouette_agreement
from occ_recon_ros.surface.covering import body_iou, doubt_of_hull, filled_holes

VIEWS = 16
SIZE = (480, 360)
SETTINGS = TurntableSettings(
    frames=VIEWS, elevation=0.4, width=SIZE[0], height=SIZE[1], focal_px=600.0
)
CAMERAS = turntable_cameras(SETTINGS)


@cache
def outlines():
    truth = make_object("figure")
    return tuple(truth.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(CAMERAS))


@cache
def agreement():
    """Of these outlines, as whoever closes the body knows it."""
    return silhouette_agreement(outlines())


@pytest.fixture(scope="module")
def figure():
    return outlines()


def evidence(contours, **changes):
    sizes = [SIZE] * len(contours)
    if contours is outlines():
        changes = {"agreement": agreement(), **changes}
    return replace(Evidence(contours, sizes, len(contours), 0.8), **changes)


def rectangle(left, top, right, bottom):
    u, v = np.arange(left, right), np.arange(top, bottom)
    return np.concatenate(
        [
            np.column_stack([np.full(len(v), left), v]),
            np.column_stack([u, np.full(len(u), bottom)]),
            np.column_stack([np.full(len(v), right), v[::-1]]),
            np.column_stack([u[::-1], np.full(len(u), top)]),
        ]
    ).astype(float)


def outline(camera, stamp, loop):
    return contours_from_loops(camera, [loop], [0], [np.full(len(loop), 0.1)], stamp, "turntable")


def test_a_good_scan_is_called_good(figure):
    for known in (agreement(), None):
        verdict = judge(evidence(figure, agreement=known))
        assert (verdict.word, verdict.reasons, verdict.advice) == ("good", (), ())


def test_the_frame_of_the_images_is_no_object():
    loop = rectangle(30, 0, SIZE[0] - 31, SIZE[1] - 1)
    contours = [outline(c, k + 1, loop) for k, c in enumerate(CAMERAS)]
    verdict = judge(evidence(contours))
    assert verdict.word == "failed"
    assert "rectangle" in verdict.reasons[0]


def test_outlines_that_contradict_each_other_fail(figure):
    mixed = [
        replace(c, T=o.T, N=o.N, uv=o.uv, loop=o.loop, sigma=o.sigma)
        for c, o in zip(figure, figure[7:] + figure[:7], strict=True)
    ]
    verdict = judge(evidence(mixed))
    assert verdict.word == "failed"
    assert "contradict" in verdict.reasons[0]


def test_who_looked_at_all_views_together_is_not_told_to_and_poses_are_not_blamed(figure):
    mixed = [
        replace(c, T=o.T, N=o.N, uv=o.uv, loop=o.loop, sigma=o.sigma)
        for c, o in zip(figure, figure[7:] + figure[:7], strict=True)
    ]
    alone, together = (
        judge(evidence(mixed, together=t, under="a sheet lies under it", pose_error_px=6.8))
        for t in (False, True)
    )
    assert "--segment joint" in alone.advice[0]
    assert "--segment" not in together.advice[0]
    assert together.advice[0].startswith("a sheet lies under it; look at contours.png")
    assert "the outlines are about 6.8 px apart in these cameras" in together.reasons
    assert not any("calibration are off" in reason for reason in together.reasons)


def test_a_single_wrong_view_is_named_and_doubted(figure):
    wrong = list(figure)
    wrong[5] = outline(CAMERAS[5], 6, rectangle(150, 110, 340, 300))
    verdict = judge(evidence(wrong))
    assert verdict.word == "doubtful"
    assert verdict.doubtful_views == (5,)
    assert verdict.report()["view_disagreement"][5] > 0.1


def test_a_view_is_called_by_its_image_where_that_is_known(figure):
    wrong = list(figure)
    wrong[5] = outline(CAMERAS[5], 6, rectangle(150, 110, 340, 300))
    called = [f"{2 * k} (IMG_{k}.jpg)" for k in range(VIEWS)]
    assert judge(evidence(wrong, called=called)).reasons[0].endswith(": 10 (IMG_5.jpg)")
    assert judge(evidence(wrong)).reasons[0].endswith(": 5")


@pytest.mark.parametrize("changes", [{"body_iou": np.full(4, 0.6)}, {"remarks": ("odd",)}])
def test_whoever_gave_masks_is_told_of_these_and_not_to_give_some(figure, changes):
    own, found = (" ".join(judge(evidence(figure, given=g, **changes)).advice) for g in (1, 0))
    assert "mask" in own
    assert "give masks" not in own
    assert "masks of your own" not in own
    assert "--segment" not in own
    assert "give masks" in found or "masks of your own" in found


def test_masks_given_that_make_no_body_are_said_not_to_agree(figure):
    (advice,) = judge(evidence(figure, given=True, body_iou=np.full(4, 0.75))).advice
    assert advice.startswith("the masks of the bag do not agree with each other in these cameras")
    assert "sway or bend" in advice


@pytest.mark.parametrize(
    ("changes", "word", "said"),
    [
        ({"images": 3 * VIEWS}, "failed", "gave an outline"),
        ({"images": VIEWS + 6}, "doubtful", "gave no outline"),
        ({"body_iou": np.full(4, 0.6)}, "failed", "IoU"),
        ({"body_iou": np.full(4, 0.93)}, "doubtful", "IoU"),
        ({"body_iou": np.array([0.99, 0.98, 0.91])}, "doubtful", "the outline of a view by 91.0%"),
        (
            {"filled": np.array([0, 0.03]), "given": True},
            "doubtful",
            "an outline, in view 1",
        ),
        ({"good_share": 0.1}, "doubtful", "good rim point"),
        ({"pose_error_px": 3.0}, "doubtful", "3.0 px"),
        ({"not_closed": "120 degrees were seen", "covered_deg": 120.0}, "doubtful", "120 degrees"),
        ({"covered_deg": 200.0}, "doubtful", "200 of 360 degrees"),
        ({"remarks": ("the object has the colour of the backdrop",)}, "doubtful", "colour"),
        ({"sizes": [(240, 180)] * VIEWS}, "doubtful", "cut by the border"),
        ({"ends": Ends(0.07, 0.08, 0.2)}, "doubtful", "70 mm above and 80 mm below"),
    ],
)
def test_each_finding_is_said(figure, changes, word, said):
    verdict = judge(evidence(figure, **changes))
    assert verdict.word == word
    assert said in " ".join(verdict.reasons)
    assert verdict.advice


def test_what_no_view_bounds_is_noted_on_a_body_that_fits_its_outlines(figure):
    roof = evidence(figure, ends=Ends(0.02, 0.03, 0.2))
    good = judge(roof)
    assert (good.word, good.reasons, good.advice) == ("good", (), ())
    (note,) = good.notes
    assert "20 mm above and 30 mm below" in note
    assert note.endswith("level with it, or end it at a plane: contour_tracker.volume_kind=plane")
    assert judge(replace(roof, body_iou=np.full(4, 0.93))).notes == good.notes
    assert judge(replace(roof, body_iou=np.full(4, 0.6))).notes == ()


def test_views_in_no_order_are_a_doubt_of_the_strips_and_not_of_the_closed_body(figure):
    way = {"step_deg": 110.0, "neighbours_deg": 10.0, "follow": False}
    verdict = judge(evidence(figure, **way))
    assert verdict.word == "doubtful"
    assert "do not follow each other around the object" in verdict.reasons[0]
    assert verdict.reasons[0].endswith("mesh.ply and rims are torn, closed.ply is not")
    assert "order of the turn" in verdict.advice[0]
    unclosed = judge(evidence(figure, not_closed="70 degrees were seen", **way))
    assert not any("closed.ply" in reason for reason in unclosed.reasons)


def test_masks_that_are_empty_are_said_to_those_who_gave_masks(figure):
    verdict = judge(evidence(figure, images=VIEWS + 6, empty_masks=6))
    assert verdict.reasons == (f"6 of {VIEWS + 6} images gave no outline: 6 masks show no object",)
    assert not any("give masks" in advice for advice in verdict.advice)
    assert "leave out the images" in verdict.advice[0]


def test_of_images_that_came_without_masks_these_are_asked_for(figure):
    more = "give masks for the other 6 images: b.jpg, ..."
    remark = "no masks from all views together: nothing stands out"
    verdict = judge(evidence(figure, images=VIEWS + 6, given=True, bare=more, remarks=[remark]))
    assert verdict.reasons == (f"6 of {VIEWS + 6} images gave no outline", remark)
    assert verdict.advice == (more,)


@pytest.mark.parametrize(("width", "doubted"), [(80, True), (320, False)])
def test_an_object_of_few_pixels_is_a_doubt(width, doubted):
    _, cameras, contours = exact_turn("figure", frames=12, width=width)
    sizes = [(c.width, c.height) for c in cameras]
    found = Evidence(contours, sizes, len(contours), 0.8)
    assert judge(found).word == "good"  # of images one by one, which are segmented again in doubt
    verdict = judge(replace(found, object_px=median_size_px(contours)))
    said = [reason for reason in verdict.reasons if "px large in the images" in reason]
    assert len(said) == doubted


def test_few_views_far_apart_are_a_doubt_and_their_poses_are_not(figure):
    few = evidence(figure[::3][:5], step_deg=72.0, neighbours_deg=72.0, pose_error_px=3.0)
    verdict = judge(few)
    assert verdict.word == "doubtful"
    (reason,) = verdict.reasons
    assert reason.startswith("only 5 views, 72 degrees apart: too few")
    assert "by 24% of its radius" in reason
    assert "10 degrees" in verdict.advice[0]
    assert "off by" in judge(replace(few, neighbours_deg=30.0)).reasons[0]


@pytest.mark.parametrize(
    ("width", "off_px", "word"),
    [(480, 1.4, "good"), (480, 1.6, "doubtful"), (4000, 5.9, "good"), (4000, 6.1, "doubtful")],
)
def test_an_image_of_more_pixels_may_be_off_by_more_of_them(figure, width, off_px, word):
    sizes = [(width, 3 * width // 4)] * VIEWS
    assert judge(evidence(figure, sizes=sizes, pose_error_px=off_px)).word == word


def test_contours_that_were_asked_already_are_not_advised(figure):
    off = evidence(figure, pose_error_px=3.0)
    assert judge(off).advice[0].startswith("correct them by the contours: --refine")
    (advice,) = judge(replace(off, refined=True)).advice
    assert "--refine" not in advice
    assert advice.startswith("check K, D and poses")


def test_whether_it_is_the_object_goes_before_how_much_of_it_was_seen(figure):
    remark = "only 88% of the outlines lie between colours of the object and of the backdrop"
    verdict = judge(evidence(figure, covered_deg=302.0, remarks=(remark,)))
    assert [reason.split()[1] for reason in verdict.reasons] == ["88%", "object"]
    assert verdict.advice[0].startswith("look at contours.png")


@pytest.mark.parametrize("iou", [0.93, 0.5])
@pytest.mark.parametrize(
    ("remark", "advice"),
    [
        ("the masks that came fit the images after theirs better", "give each image its own mask"),
        ("t seems to be the place of the camera: give -R t", "give -R t"),
    ],
)
def test_what_all_else_follows_from_comes_first(figure, iou, remark, advice):
    verdict = judge(evidence(figure, body_iou=np.full(4, iou), remarks=("odd", remark)))
    assert verdict.reasons[0] == remark
    assert verdict.advice[0].startswith(advice)


@pytest.mark.parametrize(
    ("remark", "advice"),
    [
        (
            "the object touches the border of the picture in most views",
            "take the images so that the whole object is in them",
        ),
        ("the masks that came lie some 15 px outside of the edges of their images", TIGHT),
        ("44% of the outlines of the masks that came lie where their images show no edge", TIGHT),
    ],
)
def test_a_doubt_of_masks_has_advice_of_its_own(figure, remark, advice):
    assert judge(evidence(figure, remarks=(remark,))).advice == (advice,)


def test_the_gravest_comes_first(figure):
    verdict = judge(evidence(figure, good_share=0.1, body_iou=np.full(4, 0.5)))
    assert verdict.word == "failed"
    assert "IoU" in verdict.reasons[0]
    assert len(verdict.reasons) == 2
    assert not any("smaller steps" in advice for advice in verdict.advice)


def test_the_body_is_held_against_its_outlines(figure):
    body = make_object("figure").mesh(128)
    assert body_iou(body, figure).min() > 0.97
    assert body_iou(body.copy().apply_translation([0.01, 0.0, 0.0]), figure).max() < 0.95


def test_holes_that_a_body_fills_are_measured():
    _, _, contours = exact_turn("torus", 8, 0.6)
    body = make_object("torus").mesh(96)
    assert filled_holes(body, contours).max() == 0
    inner = [abs(polygon_area(loop)) for loop in contours[2].by_loop(contours[2].uv)]
    found = filled_holes(body.convex_hull, contours)
    assert found[2] == pytest.approx(min(inner) / (max(inner) - min(inner)), rel=0.1)
    assert (found > 0.05).all()


def polygon_area(loop):
    x, y = loop.T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


def test_holes_of_outlines_that_the_program_found_itself_are_a_note(figure):
    covered = np.array([0.99] * (VIEWS - 1) + [0.93])  # in one view for the hole alone
    verdict = judge(evidence(figure, filled=np.full(VIEWS, 0.03), body_iou=covered))
    assert verdict.word == "good"
    assert verdict.notes[0].startswith("closed.ply fills holes of up to 3.0% of an outline")


@pytest.mark.parametrize(("step", "noted"), [(18.0, False), (45.0, True)])
def test_few_views_are_told_how_far_off_the_body_may_be_between_them(figure, step, noted):
    verdict = judge(evidence(figure, neighbours_deg=step))
    assert verdict.word == "good"
    assert [("by 8% of its radius" in note) for note in verdict.notes] == [True] * noted


def test_nothing_at_all_is_no_success():
    assert judge(evidence([], images=5)).word == "failed"


def test_a_note_of_the_steps_before_is_no_doubt(figure):
    verdict = judge(evidence(figure, notes=["the outlines would agree better with another lens"]))
    assert verdict.word == "good"
    assert verdict.notes == ("the outlines would agree better with another lens",)


@pytest.mark.parametrize(
    ("share", "step", "noted"),
    [(0.08, 18.0, True), (0.3, 18.0, False), (0.3, 39.4, True), (float("nan"), 39.4, False)],
)
def test_an_open_surface_that_is_little_or_torn_is_noted(figure, share, step, noted):
    verdict = judge(evidence(figure, strips_share=share, neighbours_deg=step))
    assert verdict.word == "good"
    said = [note for note in verdict.notes if note.startswith("mesh.ply")]
    assert len(said) == noted
    assert all(note.startswith(f"mesh.ply is only {share:.0%} of the surface") for note in said)
    assert all(f"{step:.0f} degrees apart here); closed.ply is the result" in note for note in said)
    without = evidence(figure, strips_share=share, not_closed="too few", covered_deg=100.0)
    assert judge(without).notes == ()


def test_who_gave_no_cameras_is_not_sent_to_check_them(figure):
    doubts = {"remarks": ["no"], "pose_error_px": 3.0, "refined": True, "body_iou": np.ones(1) / 2}
    said = " ".join(judge(evidence(figure, **doubts, checked="the steps")).advice)
    assert "K, D" not in said
    assert "check the steps" in said


@pytest.mark.parametrize(("thickness", "said"), [(120, True), (20, False)])
@pytest.mark.parametrize("side", [(0, -1), (0, 1), (-1, 0), (1, 0)])
def test_a_cut_by_the_border_is_said_of_outlines_that_end_before_it(side, thickness, said):
    """By ``border_px``; a thin part that only reaches the border is not much of the object."""
    middle = np.array(SIZE) // 2
    cut = Outlines(ContourSettings())
    for k, camera in enumerate(CAMERAS):
        mask = np.zeros(SIZE[::-1], np.uint8)
        cv2.circle(mask, middle.tolist(), 60, 255, -1)
        cv2.line(mask, middle.tolist(), (middle + middle * side).tolist(), 255, thickness)
        assert cut.add(mask, camera, k + 1, mask)
    reasons = judge(evidence(cut.contours)).reasons
    assert any("cut by the border" in reason for reason in reasons) == said


def test_of_few_outlines_one_that_holds_more_than_the_others_leave_is_a_doubt(figure):
    few = list(figure[::3])
    assert doubt_of_hull(few) == ""
    box = cv2.boundingRect(np.rint(few[2].uv).astype(np.int32))
    wide = rectangle(box[0], box[1] + 0.8 * box[3], box[0] + box[2], box[1] + box[3])
    loops = [*few[2].by_loop(few[2].uv)]
    drawn = np.zeros(SIZE[::-1], np.uint8)
    for loop in [*loops, wide]:  # a shadow about its foot
        cv2.fillPoly(drawn, [np.rint(loop).astype(np.int32)], 255)
    outlines = Outlines()
    outlines.add(cv2.merge([drawn] * 3), CAMERAS[6], 1, drawn)
    said = doubt_of_hull([*few[:2], *outlines.contours, *few[3:]])
    assert said.startswith("the body that all outlines leave covers one of them by")
