"""When masks and cameras are found again, and which are taken."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_given_up import GREEN, figure, turn

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.advice import TIGHT, of_remark
from occ_recon_ros.evaluation.second_look import SecondLook

UNKNOWN = {"warnings": ["none to be believed"]}
MASKS = [{1: np.full((2, 2), k, np.uint8)} for k in range(9)]
CAMERAS = [{1: object()} for _ in range(9)]


class Seen(SimpleNamespace):
    """Stands for the views of a bag: six images, cut out or not; ``shown``: what is seen of them
    one by one."""

    cut_out, shown = False, ()

    def __iter__(self):
        return iter(self.shown)

    def __len__(self):
        return 6

    def some(self, numbers):
        image = np.arange(16, dtype=np.uint8).reshape(4, 4)
        mask = np.where(image > 7, np.uint8(255), np.uint8(0))
        for _ in numbers:
            yield SimpleNamespace(image=image & mask if self.cut_out else image, mask=mask)


class Looks:
    """Stands for Segmentation and Refine: what each look reports and finds; ``seen``: by which
    changes of the bag."""

    images_alone, way, off_edges, on_sheet, misread = False, "auto", (), False, False

    def __init__(self, reports, found, seen=None):
        self.seen = [] if seen is None else seen
        self.k = len(self.seen) + (seen is not None)
        self.report, self.reports, self.found = reports[self.k], reports, found

    def anew(self, images_alone=False):
        assert images_alone == self.images_alone
        return Looks(self.reports, self.found, self.seen)

    def __call__(self, views, progress):
        self.seen.append(views.changes)
        return self.found(self.k)


def doubtful(belief):
    return {"belief": belief, "warnings": ["much is faint"] * (belief < 0.95)}


def looked(beliefs, corrected=(True,) * 9, masked=False, apart=0.0, after_px=1.0):
    """The looks at masks of such beliefs (reports where they are none), the looks at cameras,
    which were so far apart, and what came of both."""
    reports = [b if isinstance(b, dict) else doubtful(b) for b in beliefs]
    masks = Looks(reports, lambda k: Changes(masks=MASKS[k]))
    poses = Looks(
        [{"look": k, "before_px": 6.25} for k in range(9)],
        lambda k: Changes(cameras=CAMERAS[k]) if corrected[k] else Changes(),
    )
    poses.report |= {"before_of_size": apart, "after_px": after_px}
    known = Changes(MASKS[0], CAMERAS[0] if corrected[0] else None)
    views = Seen(changes=known, masked=lambda: masked)
    step = SecondLook(masks, poses)
    found = step(views, lambda *_: None)
    assert views.changes == known
    return step, masks, poses, found


@pytest.mark.parametrize("first", [0.6, UNKNOWN])
def test_masks_in_doubt_are_found_again_in_corrected_cameras_and_cameras_by_them(first):
    step, masks, poses, found = looked([first, 0.8, 0.98, 1.0])
    # Not from the masks of before: they are as wrong as the poses were. And not from corrected
    # cameras: how far they may be off is known of those that were given.
    assert masks.seen == [Changes(cameras=CAMERAS[0]), Changes(cameras=CAMERAS[1])]
    assert poses.seen == [Changes(masks=MASKS[1]), Changes(masks=MASKS[2])]
    assert found == Changes(MASKS[2], CAMERAS[2])
    assert step._masks.report == doubtful(0.98) | {"in_corrected_cameras": True}
    assert step._poses.report["look"] == 2


def agreeing(*views, belief=1.0):
    return {"belief": belief, "warnings": [], "agreement": list(views)}


@pytest.mark.parametrize(
    ("first", "second", "apart", "taken"),
    [
        (agreeing(0.98, 0.99), agreeing(0.99, 1.0), 0.014, True),
        (agreeing(0.98, 0.99), agreeing(0.97, 0.99), 0.014, False),
        (agreeing(0.98, 0.99), agreeing(1.0, 1.0, belief=0.98), 0.014, False),
        (agreeing(0.99, 0.99, belief=0.96), agreeing(0.97, 0.98), 0.014, True),
        (agreeing(0.98, 0.99), agreeing(0.99, 1.0), 0.0072, None),
        ({"way": "single"}, agreeing(0.99, 1.0), 0.014, None),
    ],
)
def test_masks_that_were_drawn_where_cameras_were_not_are_drawn_again_once(
    first, second, apart, taken
):
    step, masks, _, found = looked([first, second, agreeing(1.0, 1.0)], apart=apart)
    assert len(masks.seen) == (taken is not None)
    assert found == (Changes(MASKS[1], CAMERAS[1]) if taken else Changes())
    assert step._poses.report["look"] == (1 if taken else 0)


@pytest.mark.parametrize(
    ("belief", "apart", "doubted"), [(0.93, 0.01, True), (0.96, 0.01, False), (0.93, 0.007, False)]
)
def test_masks_and_poses_that_tell_each_other_and_are_both_unsure_are_doubted(
    belief, apart, doubted
):
    edges = "images show edges"
    unsure = agreeing(0.94, 0.95, belief=belief) | {"warnings": [edges]}
    step, _, _, _ = looked([unsure, unsure], apart=apart)
    said = step._masks.report["warnings"]
    assert len(said) == 1 + doubted
    if doubted:  # the cause first
        assert said == [
            "poses or calibration as given are off by 6.2 px, and the masks that were found by "
            "them are believed by 0.93 only",
            edges,
        ]
        assert of_remark(said[0], "usual").startswith("check K, D and poses first")
    assert of_remark(edges, "usual") == "usual"


def test_outlines_that_no_cameras_bring_together_are_not_said_to_be_the_fault_of_these():
    unsure = agreeing(0.94, 0.95, belief=0.57)
    step, _, _, _ = looked([unsure, unsure], apart=0.01, after_px=5.2)
    assert step._masks.report["warnings"] == [
        "the outlines are 6.2 px apart as given, 5.2 in any cameras, and the masks that were found "
        "by them are believed by 0.57 only"
    ]


def test_before_a_sheet_that_was_found_nothing_is_looked_at_again(monkeypatch):
    monkeypatch.setattr(Looks, "on_sheet", True)
    _, masks, _, found = looked([0.6, 0.98], apart=0.05)
    assert found == Changes()
    assert not masks.seen


def test_a_doubt_of_both_is_added_to_other_doubts_and_not_said_of_masks_that_are_not_used():
    faint = agreeing(0.94, 0.95, belief=0.7) | {"warnings": ["much is faint"]}
    step, _, _, _ = looked([faint, faint], apart=0.01)
    assert [words.split()[0] for words in step._masks.report["warnings"]] == ["poses", "much"]
    unused = agreeing(0.94, 0.95, belief=0.39) | {"warnings": ["not used"]}
    step, _, _, _ = looked([unused, unused], apart=0.01)
    assert step._masks.report["warnings"] == ["not used"]


def test_masks_in_doubt_do_not_give_way_to_those_that_are_believed_as_little():
    faint = agreeing(0.94, 0.95, belief=0.7) | {"warnings": ["much is faint"]}
    _, masks, _, found = looked([faint, agreeing(0.99, 0.99, belief=0.7)])
    assert len(masks.seen) == 1
    assert found == Changes()


def test_all_views_count_for_how_much_masks_agree():
    # The median is the same.
    first, second = agreeing(0.9, 0.99, 0.99), agreeing(0.98, 0.99, 0.99)
    assert looked([first, second], apart=0.01)[3] == Changes(MASKS[1], CAMERAS[1])
    assert looked([second, first], apart=0.01)[3] == Changes()


def test_how_far_cameras_were_apart_is_that_of_the_masks_that_are_taken():
    # The first were as wide as the poses were off; Looks are 0 apart when they are made anew.
    first, second = agreeing(0.9, 0.9, belief=0.9), agreeing(0.99, 0.99, belief=0.93)
    step, _, _, found = looked([first, second, second], apart=0.014)
    assert found == Changes(MASKS[1], CAMERAS[1])
    assert "before_of_size" not in step._poses.report
    assert step._masks.report["warnings"] == []


@pytest.mark.parametrize("second", [0.5, UNKNOWN])
def test_masks_that_are_believed_less_are_not_taken(second):
    step, masks, _, found = looked([0.6, second])
    assert len(masks.seen) == 1
    assert found == Changes()
    assert step._masks.report == doubtful(0.6)


def test_cameras_stay_where_new_masks_ask_for_no_correction():
    step, _, _, found = looked([0.6, 0.8, 0.9], (True, False, False))
    assert found == Changes(masks=MASKS[1])
    assert step._poses.report["look"] == 0


@pytest.mark.parametrize(
    ("first", "corrected", "masked"),
    [
        ({"way": "single"}, True, False),
        ({"belief": 0.8}, True, False),  # some views are bad, and are left out
        (0.97, True, False),
        (0.6, False, False),
        (0.6, True, True),
    ],
)
def test_what_is_sure_or_came_or_is_in_the_same_cameras_is_not_looked_at_again(
    first, corrected, masked
):
    _, masks, _, found = looked([first, 0.99], (corrected,), masked)
    assert masks.seen == []
    assert found == Changes()


def looked_instead(
    belief, apart, corrected=True, first=None, way="auto", off=(), cut_out=False, shown=(), found=()
):
    """The same of a bag with masks, by what the images show, and by how many sigmas outlines are
    apart in corrected cameras: those that came, and what images show, of views that may be
    ``shown`` the masks ``found``."""
    own = [{}, dict(found)] if found else MASKS
    masks = Looks([first or {"way": "single"}, doubtful(belief)], lambda k: Changes(masks=own[k]))
    masks.images_alone, masks.way, masks.off_edges = True, way, off
    poses = Looks(
        [{"after_in_sigmas": a, "after_px": 0.3 * a} for a in apart],
        lambda k: Changes(cameras=CAMERAS[k]) if corrected else Changes(),
    )
    known = Changes(cameras=CAMERAS[0])
    views = Seen(changes=known, masked=lambda: True, cameras=lambda: CAMERAS[8])
    views.cut_out, views.shown = cut_out, shown
    step = SecondLook(masks, poses)
    found = step(views, lambda *_: None)
    assert views.changes == known
    return step, masks, found


def test_masks_that_no_camera_makes_agree_give_way_to_what_images_show():
    step, masks, found = looked_instead(0.98, (5.0, 1.0))
    assert masks.seen == [Changes()]  # in the cameras as given: those by coarse masks are spoilt
    assert found == Changes(MASKS[1], CAMERAS[1])
    said = step._masks.report.pop("not_used")
    assert said == "the masks that came are 1.5 px apart from each other in any cameras"
    assert step._masks.report == doubtful(0.98)
    assert step._poses.report["after_in_sigmas"] == 1.0


@pytest.mark.parametrize(("apart", "taken"), [((0.8, 1.0), True), ((0.8, 4.0), False)])
def test_masks_beside_the_edges_of_their_images_give_way_to_them(apart, taken):
    # Those of a generous brush agree with each other; those of images have to, too.
    step, _, found = looked_instead(0.98, apart, off=("they lie some 8 px outside",))
    assert found == (Changes(MASKS[1], CAMERAS[1]) if taken else Changes())
    assert step._masks.report.get("not_used", "") == "they lie some 8 px outside" * taken


EDGES = "26% of the outlines of the masks that came lie where their images show no edge"


@pytest.mark.parametrize(
    ("belief", "apart", "foot", "why"),
    [
        (0.65, (0.8, 1.0), True, "tell less"),
        (1.0, (0.8, 1.0), False, "leave out parts that look as nothing beside the masks does"),
        (1.0, (0.8, 4.0), True, "agree less"),
    ],
)
def test_masks_that_stay_since_images_are_no_better_are_not_to_be_left_out(
    belief, apart, foot, why
):
    # Those of an object with black parts before black: alone, images lost half of it.
    first = {"way": "single", "warnings": ["poses", EDGES]}
    seen = {"shown": turn(GREEN, lambda mask: mask)}
    seen["found"] = {
        view.stamp_ns: figure(view.stamp_ns)[0 if foot else 1] for view in seen["shown"]
    }
    step, _, found = looked_instead(belief, apart, first=first, off=(EDGES,), **seen)
    assert found == Changes()
    assert step._masks.report["warnings"] == ["poses", said := f"{EDGES}; images alone {why}"]
    assert "--no-masks" not in of_remark(said, "")
    assert of_remark(EDGES, "") == TIGHT


def test_images_that_are_cut_out_are_not_asked_for_they_show_no_more_than_the_masks():
    _, masks, found = looked_instead(0.98, (5.0, 1.0), cut_out=True)
    assert (masks.seen, found) == ([], Changes())


def test_where_the_outlines_of_images_ask_for_no_correction_cameras_are_as_given():
    assert looked_instead(0.98, (5.0, 1.0), corrected=False)[2] == Changes(MASKS[1], CAMERAS[8])


@pytest.mark.parametrize(
    ("belief", "apart", "first", "way"),
    [
        (0.9, (5.0, 1.0), None, "auto"),
        (0.98, (5.0, 3.0), None, "auto"),
        (0.98, (2.0, 0.5), None, "auto"),
        (0.98, (5.0, 1.0), {"not_used": "boxes"}, "auto"),
        (0.98, (5.0, 1.0), None, "single"),
    ],
)
def test_masks_that_came_stay_where_images_show_nothing_better(
    monkeypatch, belief, apart, first, way
):
    monkeypatch.setattr(SecondLook, "_drawn_anew", lambda *_: Changes())  # asked with masks
    step, _, found = looked_instead(belief, apart, first=first, way=way)
    assert found == Changes()
    assert step._masks.report == (first or {"way": "single"})
    assert step._poses.report["after_in_sigmas"] == apart[0]


def test_what_masks_tell_of_poses_is_said_once_and_they_are_not_looked_for_again():
    masks = Looks([{"warnings": ["K is wrong"]}] * 2, lambda k: Changes())
    poses = Looks([{"warnings": ["K is wrong"]}] * 2, lambda k: Changes())
    masks.misread = True
    views = Seen(changes=Changes(), masked=lambda: True)
    assert SecondLook(masks, poses)(views, lambda *_: None) == Changes()
    assert masks.seen == poses.seen == []
    assert masks.report["warnings"] + poses.report["warnings"] == ["K is wrong"]
