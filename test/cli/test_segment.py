"""Masks that a first pass over a recording finds."""

import json

import cv2
import numpy as np
import pytest
from plaster import imported, iou

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.cli import main, segmenting
from occ_recon_ros.evaluation import alone as alone_
from occ_recon_ros.evaluation import segmentation
from occ_recon_ros.evaluation.alone import Alone
from occ_recon_ros.imaging.joint import JointMasks, JointSegmenter
from occ_recon_ros.imaging.joint.judge import ViewReport
from occ_recon_ros.imaging.joint.solve import Trial
from occ_recon_ros.streams.together import strangers_among


@pytest.mark.slow
def test_masks_that_wrong_poses_spoil_are_found_in_corrected_ones(
    command, plaster, tmp_path, coarse
):
    content = json.loads((plaster / "cameras.json").read_text())
    del content["frames"][2::3]
    for frame in content["frames"]:
        cv2.imwrite(str(tmp_path / frame["file"]), cv2.imread(str(plaster / frame["file"])))
        frame["K"][0][2] += 10
        frame["K"][1][2] -= 6
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    plain, masked = tmp_path / "plain.mcap", tmp_path / "masked.mcap"
    assert command("import", tmp_path, plain)[0] == 0
    code, out, error = command("segment", plain, masked, "--json")
    assert code == 0, error
    assert json.loads(out)["in_corrected_cameras"]
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    views = list(BagViews(masked))
    scores = [iou(v.mask > 0, t) for v, t in zip(views, truth, strict=True)]
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9
    for view, came in zip(views, BagViews(plain), strict=True):
        assert np.array_equal(view.camera.K, came.camera.K)


@pytest.mark.slow
def test_a_grey_turn_whose_last_image_is_empty(command, plaster, tmp_path, coarse):
    # Without colour nothing tells the shadows in its crevices from the cloth: thin holes that
    # contradict nothing in any view leave a body in shreds. The table was cleared too early.
    content = json.loads((plaster / "cameras.json").read_text())
    del content["frames"][1::3]
    for frame in content["frames"]:
        grey = cv2.imread(str(plaster / frame["file"]), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(tmp_path / frame["file"]), grey)
    empty = np.random.default_rng(0).normal(8, 3, grey.shape).clip(0, 255).astype(np.uint8)
    empty[:40, :40] = 90  # something stands beside the table: the image is not black all over
    cv2.imwrite(str(tmp_path / content["frames"][-1]["file"]), empty)
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "plain.mcap")[0] == 0
    code, out, _ = command("segment", tmp_path / "plain.mcap", tmp_path / "masked.mcap")
    assert code == 0
    assert "masks by joint views" in out
    named = [line.strip() for line in out.splitlines() if "  view " in line]
    assert [line.split(":")[0] for line in named] == [f"view 7 ({frame['file']})"]
    assert named[0].endswith("it shows no object where the others have it; left out")
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    views = list(BagViews(tmp_path / "masked.mcap"))
    assert not views[-1].mask.any()
    scores = [iou(v.mask > 127, t) for v, t in zip(views[:-1], truth[:-1], strict=True)]
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9


def test_a_way_that_there_is_not_is_refused(command, plaster, tmp_path):
    plain = tmp_path / "plain.mcap"
    assert command("import", plaster, plain)[0] == 0
    code, _, error = command("replay", plain, "--out", tmp_path / "out", "--segment", "guess")
    assert code == 2
    assert "auto, joint, single" in error


@pytest.mark.slow
def test_a_view_that_is_lit_otherwise_is_drawn_where_the_others_have_its_outline(
    command, plaster, tmp_path
):
    # All of its colours are of no other view, and its edges are where they should be; those of
    # images that are not of the scan are not. Drawn by what the others say their masks agreed with
    # them, and moved poses and body.
    content = json.loads((plaster / "cameras.json").read_text())
    for k, frame in enumerate(content["frames"]):
        image = cv2.imread(str(plaster / frame["file"]))
        if k == 8:
            image = np.minimum(3.0 * image + 60, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / frame["file"]), from_nearer(image, None) if k > 9 else image)
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "plain.mcap")[0] == 0
    code, out, error = command("segment", tmp_path / "plain.mcap", tmp_path / "masked.mcap")
    assert code == 0, error
    named = [line.strip() for line in out.splitlines() if "  view " in line]
    assert [line.split(" (")[0] for line in named] == ["view 8", "view 10", "view 11"]
    assert named[0].endswith("it shows edges where the others ask for its outline: drawn there")
    assert "moved" not in named[0]
    assert all(line.endswith("left out") for line in named[1:])
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    masks = [view.mask for view in BagViews(tmp_path / "masked.mcap")]
    assert not any(mask.any() for mask in masks[10:])
    assert min(iou(m > 127, t) for m, t in zip(masks[:10], truth[:10], strict=True)) > 0.9


def nearly_black(image, rng):
    dark = 0.04 * image + rng.normal(0, 2, image.shape)
    return dark.clip(0, 255).astype(np.uint8)


def from_nearer(image, rng):
    middle = (image.shape[1] / 2, image.shape[0] / 2)
    M = cv2.getRotationMatrix2D(middle, 0, 1.25)
    return cv2.warpAffine(image, M, image.shape[1::-1], borderMode=cv2.BORDER_REFLECT)


@pytest.mark.slow
def test_last_images_that_are_not_of_the_scan_are_left_out(command, shared_data, tmp_path):
    # Of a sequence whose single images agree.
    folder = shared_data / "oxford_dino"
    content = json.loads((folder / "cameras.json").read_text())
    content["frames"] = content["frames"][::2]
    n, rng = len(content["frames"]), np.random.default_rng(0)
    for k, frame in enumerate(content["frames"]):
        image = cv2.imread(str(folder / frame["file"]))
        frame["file"] = f"{k}.png"
        frame.pop("mask", None)
        if k >= n - 2:
            image = (from_nearer, nearly_black)[k - n](image, rng)
        cv2.imwrite(str(tmp_path / frame["file"]), image)
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "plain.mcap")[0] == 0
    code, out, error = command("segment", tmp_path / "plain.mcap", tmp_path / "masked.mcap")
    assert code == 0, error
    named = [line.strip() for line in out.splitlines() if line.endswith("left out")]
    assert [line.split(":")[0] for line in named] == [f"view {n - 2} ({n - 2}.png)"]
    assert f"1 of {n} images are nearly black all over" in out
    empty = [not view.mask.any() for view in BagViews(tmp_path / "masked.mcap")]
    assert empty == [False] * (n - 2) + [True]


def test_what_moved_is_found_before_all_images_are_asked_together(command, toy, tmp_path):
    # Masks that are drawn in the poses of before agree with them.
    content = json.loads((toy / "cameras.json").read_text())
    for k, frame in enumerate(content["frames"]):
        image = cv2.imread(str(toy / frame["file"]))
        if k >= 5:  # the camera was bumped
            image = np.roll(image, (-5, 12), axis=(0, 1))
        cv2.imwrite(str(tmp_path / frame["file"]), image)
    bag = imported(command, content, tmp_path)
    found = alone_.each_alone(BagViews(bag), lambda *_: None)
    for k, view in enumerate(BagViews(bag)):
        centre = found.cameras[view.stamp_ns].project(np.zeros((1, 3)))[0]
        off = centre - view.camera.project(np.zeros((1, 3)))[0]
        np.testing.assert_allclose(off, [12, -5] if k >= 5 else [0, 0], atol=2)


def test_images_whose_poses_are_wrong_are_not_drawn_anew(command, toy, tmp_path, monkeypatch):
    # Outlines that contradict each other as given, and agree where the calibration is corrected,
    # are right: drawn together in the wrong calibration they were neither.
    content = json.loads((toy / "cameras.json").read_text())
    for frame in content["frames"]:
        frame["file"] = str(toy / frame["file"])
        frame["K"][0][2] += 5.0
        frame["K"][1][2] -= 3.0
    views = BagViews(imported(command, content, tmp_path))
    looks, look = [], alone_.each_alone
    monkeypatch.setattr(
        alone_, "each_alone", lambda *a, **k: looks.append(look(*a, **k)) or looks[-1]
    )
    step = segmentation.Segmentation()
    assert step(views, lambda *_: None).masks is None
    assert step.report["way"] == "single"
    (alone,) = looks
    assert not alone.doubts
    assert len(alone.cameras) == 9


@pytest.fixture(scope="module")
def outlined(plaster, tmp_path_factory):
    """Views, and an outline of all of each image by its stamp; nobody changes them."""
    bag = tmp_path_factory.mktemp("outlined") / "plain.mcap"
    assert main(["import", str(plaster), str(bag)]) == 0
    views = BagViews(bag)
    return views, {v.stamp_ns: np.full(v.image.shape[:2], 255, np.uint8) for v in views}


@pytest.mark.parametrize(
    ("believed", "confirmed", "way", "looks"),
    [
        ((0.9, 1.0), (1.0, 1.0), "joint", 2),
        ((0.9, 0.8), (1.0, 1.0), "given", 2),
        ((0.96, 1.0), (1.0, 1.0), "given", 1),
        ((0.99, 1.0), (0.9, 0.99), "joint", 2),
        ((1.0, 1.0), (0.9, 0.99), "joint", 2),
        ((0.9, 0.9), (0.998, 1.0), "given", 2),
        ((1.0, 1.0), (0.9, 0.8), "given", 2),
    ],
)
def test_doubted_masks_of_single_images_are_held_against_none(
    monkeypatch, outlined, believed, confirmed, way, looks
):
    """Outlines of single images confirm themselves, as that of a shadow does: the looks at all
    views are given here, the choice between them is asked."""
    views, own = outlined
    asked = []

    def jointly(self, views, kept, progress, out, asks_again=None):
        asked.append(kept)
        reports = (ViewReport(1.0, confirmed[len(asked) - 1], 0.0, ""),) * len(views)
        belief = believed[len(asked) - 1]
        return JointMasks("given" if kept else "joint", belief, (), reports, (), None, ())

    def mask(self, k, image, given=None, known=None):
        return np.zeros(image.shape[:2], np.uint8) if given is None else given

    monkeypatch.setattr(segmentation.Segmentation, "_jointly", jointly)
    monkeypatch.setattr(JointMasks, "mask", mask)
    alone = Alone(own, ("doubt",), own, {}, {})
    monkeypatch.setattr(alone_, "each_alone", lambda *_, **__: alone)
    step = segmentation.Segmentation()
    masks = step(views, lambda *_: None).masks
    assert asked == [own, {}][:looks]
    assert step.report["way"] == way
    assert all((m > 0).all() == (way == "given") for m in masks.values())


def test_a_look_at_all_views_says_which_it_is_and_counts_its_trials(monkeypatch, outlined):
    said = []

    class Told:
        def doing(self, what):
            said.append(what)

        def __call__(self, done, total):
            pass

    reports = (ViewReport(0.5, 1.0, 0.0, ""),) * 9
    found = JointMasks("joint", 0.5, (), reports, (), None, ())
    monkeypatch.setattr(JointSegmenter, "_solve", lambda *_: found)
    step = segmentation.Segmentation("joint")
    for _ in range(2):
        step._jointly(outlined[0], None, Told(), ())
    looks = [f"all views together, attempt {which}" for which in (1, 2)]
    expected = [[look, *(f"{look}, trial {k}" for k in range(1, 5))] for look in looks]
    assert said == [*expected[0], *expected[1]]
    step._like = Trial(0.07, 2)  # found the best masks: another look tries this and the first
    again = step.anew()
    again._jointly(outlined[0], None, Told(), ())
    assert said[10:] == expected[0][:3]
    assert again.anew(images_alone=True)._like is None


@pytest.mark.parametrize(("contrary", "left_out"), [((), []), ((4,), [4])])
def test_views_that_are_out_stay_out_when_others_are_strange(monkeypatch, contrary, left_out):
    asked = []

    def jointly(self, views, kept, progress, out, asks_again=None):
        asked.append(sorted(out))
        reports = [ViewReport(0.98, 1.0, 0.0, "")] * (12 - len(out))
        if len(out) == 1:  # view 4 is the fourth that is looked at
            reports[3] = ViewReport(0.88, 1.0, 0.0, "12% of the object's area disagrees")
        return JointMasks("joint", 1.0, (), tuple(reports), (), None, ())

    monkeypatch.setattr(segmentation.Segmentation, "_jointly", jointly)
    step, out = segmentation.Segmentation(), {1: "misplaced"}
    step._alone = Alone({}, (), {}, {}, out, frozenset(contrary))
    _, strangers = step._without_strangers(range(12), None, lambda *_: None)
    assert list(strangers) == left_out
    assert asked == [[1], [1, 4]][: 1 + len(left_out)]
    assert out == {1: "misplaced"}


def test_masks_that_came_are_not_held_against_none(monkeypatch, outlined):
    """They are no outlines of single images. The look at all views is given here."""
    views, own = outlined
    asked = []

    def jointly(self, views, kept, progress, out, asks_again=None):
        asked.append(kept)
        reports = (ViewReport(1.0, 0.8, 0.0, ""),) * len(views)
        return JointMasks("given", 0.8, (), reports, (), None, ())

    monkeypatch.setattr(BagViews, "masked", lambda self: True)
    monkeypatch.setattr(segmentation.Segmentation, "_jointly", jointly)
    monkeypatch.setattr(JointMasks, "mask", lambda self, k, image, given=None: given)
    alone = Alone(own, ("doubt",), own, {}, {})
    monkeypatch.setattr(alone_, "each_alone", lambda *_, **__: alone)
    segmentation.Segmentation()(views, lambda *_: None)
    assert asked == [own]


@pytest.mark.parametrize("confirmed", [0.9, 1.0])
def test_views_that_contradict_a_shadow_alone_are_not_left_out_without_it(
    monkeypatch, outlined, confirmed
):
    """Where the outlines of most images hold a shadow, those without it are called strange; the
    looks at all views are given here."""
    views, own = outlined
    asked = []

    def jointly(self, views, kept, progress, out, asks_again=None):
        asked.append((bool(kept), sorted(out)))
        reports = [ViewReport(0.99, 0.9 if kept else confirmed, 0.0, "")] * (len(views) - len(out))
        if kept and not out:
            reports[3] = ViewReport(0.4, 0.9, 0.0, "60% of the object's area disagrees")
        return JointMasks("given" if kept else "joint", 1.0, (), tuple(reports), (), None, ())

    monkeypatch.setattr(segmentation.Segmentation, "_jointly", jointly)
    monkeypatch.setattr(JointMasks, "mask", lambda self, k, image, given=None: image[..., 0])
    alone = Alone(own, ("doubt",), own, {}, {}, contrary=frozenset([3]))
    monkeypatch.setattr(alone_, "each_alone", lambda *_, **__: alone)
    step = segmentation.Segmentation()
    step(views, lambda *_: None)
    assert asked == [(True, []), (True, [3]), (False, [])]
    assert step.report["way"] == "joint"
    assert step.report["bad_views"] == {}


@pytest.mark.parametrize(
    ("report", "found", "looks"),
    [
        ({"way": "joint", "belief": 1.0}, True, 1),
        ({"way": "single", "warnings": ["not to be believed"]}, False, 1),
        ({"way": "single"}, False, 0),
    ],
)
def test_where_views_were_asked_together_their_poses_are_asked_too(
    monkeypatch, command, plaster, tmp_path, report, found, looks
):
    """What was found and the second look are given here: whether there is one is asked."""
    asked = []

    class Given(segmentation.Segmentation):
        bounded = True

        def __call__(self, views, progress):
            self.report = report
            masks = {view.stamp_ns: np.zeros(view.image.shape[:2], np.uint8) for view in views}
            return Changes(masks=masks if found else None)

    class Look:
        def __init__(self, masks, poses):
            pass

        def __call__(self, views, progress):
            asked.append(views.changes)
            return Changes()

    monkeypatch.setattr(segmenting, "Segmentation", Given)
    monkeypatch.setattr(segmenting, "SecondLook", Look)
    monkeypatch.setattr(segmenting.Refine, "__call__", lambda *_: Changes(cameras={}))
    assert command("import", plaster, tmp_path / "plain.mcap")[0] == 0
    command("segment", tmp_path / "plain.mcap", tmp_path / "masked.mcap")
    assert len(asked) == looks


@pytest.mark.parametrize(("contrary", "left_out"), [((), []), ((3,), [3])])
def test_a_view_that_disagrees_is_left_out_where_its_own_outline_does_too(contrary, left_out):
    # As where a pose was stuck for one step: colours alone may be misled by a shadow.
    reports = [ViewReport(0.98, 1.0, 0.0, "")] * 12
    reports[3] = ViewReport(0.88, 1.0, 0.0, "12% of the object's area disagrees")
    found = JointMasks("joint", 1.0, (), tuple(reports), (), None, ())
    assert list(strangers_among(found, {}, contrary)) == left_out


@pytest.mark.parametrize(("agreement", "left_out"), [(0.95, []), (0.8, [3])])
def test_a_view_half_hidden_is_left_out_where_what_hides_it_bites_into_the_body(
    agreement, left_out
):
    # A hand covers little; the lower half of a torn picture is backdrop to what all views learn.
    reports = [ViewReport(0.99, 1.0, 0.0, "")] * 12
    reports[3] = ViewReport(agreement, 1.0, 0.0, "something is before it", covered=0.3)
    found = JointMasks("joint", 1.0, (), tuple(reports), (), None, ())
    assert list(strangers_among(found, {}, ())) == left_out


def test_of_given_masks_it_is_not_said_that_images_were_segmented(command, plaster, tmp_path):
    content = json.loads((plaster / "cameras.json").read_text())
    content["frames"] = content["frames"][::5]
    for frame in content["frames"]:
        cv2.imwrite(str(tmp_path / frame["file"]), cv2.imread(str(plaster / frame["file"])))
        mask = np.load(plaster / f"{frame['file']}.npy")
        cv2.imwrite(str(tmp_path / f"mask_{frame['file']}"), np.uint8(255) * np.uint8(mask > 0))
        frame["mask"] = f"mask_{frame['file']}"
    del content["frames"][0]["mask"]
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    code, out, error = command("segment", tmp_path / "given.mcap", tmp_path / "masked.mcap")
    assert code == 0, error
    assert "given masks: 1 of" in out
    assert "one by one" not in out
