"""Masks that came with a recording, held against each other and against their images."""

import json

import cv2
import numpy as np
import pytest
from plaster import imported, iou

from occ_recon_ros.bags import importing
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.evaluation import alone as alone_
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.second_look import SecondLook
from occ_recon_ros.evaluation.segmentation import Segmentation


def masked(plaster, folder, drawn):
    """The content of cameras.json of the turn with masks that ``drawn`` makes of its true ones,
    numbers and (h, w) uint8; and the true ones, (h, w) bool."""
    content = json.loads((plaster / "cameras.json").read_text())
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    for k, (frame, mask) in enumerate(zip(content["frames"], truth, strict=True)):
        frame["file"], frame["mask"] = str(plaster / frame["file"]), f"mask_{k}.png"
        cv2.imwrite(str(folder / frame["mask"]), drawn(k, mask.astype(np.uint8) * 255))
    return content, truth


def brushed(mask, px):
    """A mask that is so much larger all around, or smaller."""
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(px) + 1,) * 2)
    return cv2.dilate(mask, brush) if px > 0 else cv2.erode(mask, brush)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_masks_that_contradict_the_others_are_named_and_made_anew(command, plaster, tmp_path):
    content = json.loads((plaster / "cameras.json").read_text())
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    for k, (frame, mask) in enumerate(zip(content["frames"], truth, strict=True)):
        cv2.imwrite(str(tmp_path / frame["file"]), cv2.imread(str(plaster / frame["file"])))
        shown = np.roll(mask, 60, axis=1) if k == 5 else mask
        frame["mask"] = f"mask_{k}.png"
        cv2.imwrite(str(tmp_path / frame["mask"]), shown.astype(np.uint8) * 255)
    # A pose that is wrong, where mask and image are right.
    rolled = cv2.Rodrigues(np.deg2rad([0.0, 0.0, 25.0]))[0]
    content["frames"][8]["R"] = (rolled @ np.array(content["frames"][8]["R"])).tolist()
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    assert [line.split(":")[0].strip() for line in out.splitlines() if "  view " in line] == [
        f"view {k} ({content['frames'][k]['file']})" for k in (5, 8)
    ]
    assert "left out; something is before the object, or its pose is wrong" in out
    views = list(BagViews(tmp_path / "masked.mcap"))
    assert not views.pop(8).mask.any()
    truth.pop(8)
    assert min(iou(v.mask > 127, t) for v, t in zip(views, truth, strict=True)) > 0.9


@pytest.mark.slow
@pytest.mark.usefixtures("few_heights")
def test_what_masks_lack_at_one_place_is_found_in_the_images(command, shared_data, tmp_path):
    # As where a network took a limb for backdrop. All else lies on edges, so that poses were
    # blamed; and rims of the other views were outside of the object.
    folder = shared_data / "oxford_dino"
    content = json.loads((folder / "cameras.json").read_text())
    content["frames"] = content["frames"][::3]
    rng, bitten, truth = np.random.default_rng(5), (2, 6, 9), []
    for k, frame in enumerate(content["frames"]):
        mask = cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE)
        truth.append(mask > 127)
        frame["file"], frame["mask"] = str(folder / frame["file"]), f"mask_{k}.png"
        if k in bitten:
            outline = np.argwhere(mask - cv2.erode(mask, np.ones((3, 3))))
            y, x = outline[rng.integers(len(outline))].tolist()
            cv2.circle(mask, (x, y), 60, 0, -1)
        cv2.imwrite(str(tmp_path / frame["mask"]), mask)
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    named = [line.strip() for line in out.splitlines() if "  view " in line]
    assert [int(line.split(":")[0].split()[1]) for line in named] == list(bitten)
    assert all("its mask contradicts those of the others" in line for line in named)
    views = list(BagViews(tmp_path / "masked.mcap"))
    scores = [iou(v.mask > 127, t) for v, t in zip(views, truth, strict=True)]
    assert min(scores) > 0.95
    assert sum(score == 1.0 for score in scores) == len(scores) - len(bitten)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_images_that_came_without_a_mask_get_one(command, plaster, tmp_path):
    content = json.loads((plaster / "cameras.json").read_text())
    truth = [np.load(plaster / f"{frame['file']}.npy") for frame in content["frames"]]
    for k, (frame, mask) in enumerate(zip(content["frames"], truth, strict=True)):
        cv2.imwrite(str(tmp_path / frame["file"]), cv2.imread(str(plaster / frame["file"])))
        if k % 3:
            frame["mask"] = f"mask_{k}.png"
            cv2.imwrite(str(tmp_path / frame["mask"]), mask.astype(np.uint8) * 255)
    given = imported(command, content, tmp_path)
    assert command("segment", given, tmp_path / "masked.mcap")[0] == 0
    views = list(BagViews(tmp_path / "masked.mcap"))
    scores = [iou(v.mask > 127, t) for v, t in zip(views, truth, strict=True)]
    assert len(scores) == 12
    assert min(scores[1::3] + scores[2::3]) > 0.99
    assert min(scores[::3]) > 0.93


@pytest.mark.slow
def test_masks_that_end_at_the_border_are_taken_as_they_are(command, plaster, tmp_path):
    # They were sought again in all views together, which takes a minute and cannot help.
    content = json.loads((plaster / "cameras.json").read_text())
    for k, frame in enumerate(content["frames"]):
        image = cv2.imread(str(plaster / frame["file"]))
        mask = np.load(plaster / f"{frame['file']}.npy")
        frame["width"] = int(np.flatnonzero(mask.any(axis=0))[-1] - 15)
        frame["mask"] = f"mask_{k}.png"
        cv2.imwrite(str(tmp_path / frame["file"]), image[:, : frame["width"]])
        cv2.imwrite(str(tmp_path / frame["mask"]), mask[:, : frame["width"]].astype(np.uint8) * 255)
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    assert "masks from those that came" in out
    sheet = cv2.imread(str(tmp_path / "masked.mcap.masks.png"))
    assert sheet is not None  # of images that are not of one size
    for frame, view in zip(content["frames"], BagViews(tmp_path / "masked.mcap"), strict=True):
        given = cv2.imread(str(tmp_path / frame["mask"]), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(view.mask, given)


@pytest.mark.parametrize(
    ("px", "shift", "says"),
    [
        (0, 0, None),
        (4, 0, "4 px outside"),
        (-7, 0, "px inside"),
        (0, 1, "fit the images after theirs"),
        (0, -1, "fit the images before theirs"),
    ],
)
def test_masks_that_do_not_lie_on_the_edges_of_their_images_are_doubtful(
    command, plaster, tmp_path, monkeypatch, px, shift, says
):
    # Masks of a generous brush, or of the next image, agree with each other: a body twice as large
    # was called good, and one turned by a step against its images.
    content, _ = masked(plaster, tmp_path, lambda k, mask: brushed(mask, px))
    masks = [frame["mask"] for frame in content["frames"]]
    for frame, mask in zip(content["frames"], np.roll(masks, -shift).tolist(), strict=True):
        frame["mask"] = mask
    # As a bag that was recorded so.
    monkeypatch.setattr(importing, "masks_in_place", lambda frames: (frames, []))
    given = imported(command, content, tmp_path)
    views = BagViews(given)
    found = alone_.each_alone(views, lambda *_: None).off_edges
    assert [says in doubt for doubt in found] == ([True] if says else [])


@pytest.mark.parametrize("px", [4, pytest.param(-5, marks=pytest.mark.slow)])
def test_masks_beside_the_edges_of_their_images_are_drawn_there(command, plaster, tmp_path, px):
    # Their outlines agree with each other: bodies were a tenth too large, doubtful.
    content, truth = masked(plaster, tmp_path, lambda k, mask: brushed(mask, px))
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    side = "outside" if px > 0 else "inside"
    assert f"px {side} of the edges of their images: they were drawn there" in out
    assert "doubtful" not in out
    scores = [
        iou(view.mask > 127, right)
        for view, right in zip(BagViews(tmp_path / "masked.mcap"), truth, strict=True)
    ]
    assert min(scores) > 0.96


def test_masks_of_some_views_beside_the_edges_of_their_images_are_drawn_there(
    command, plaster, tmp_path
):
    # Poses that were right were corrected by them, and the body was a tenth too large between.
    content, truth = masked(plaster, tmp_path, lambda k, mask: brushed(mask, 4 * (k > 7)))
    views = BagViews(imported(command, content, tmp_path))
    found = alone_.at_edges(views, lambda *_: None)
    (said,) = found.off_edges
    assert said.startswith("the masks of 4 views lie some")
    assert said.endswith(f"unlike the others (views {', '.join(named(content, 8))})")
    masks = found.redrawn.values()
    assert min(iou(m > 127, right) for m, right in zip(masks, truth, strict=True)) > 0.96
    for k, view in enumerate(views):
        assert (k > 7) == (found.redrawn[view.stamp_ns] != view.mask).any()


def named(content, first):
    """The views from one on, by number and file."""
    rows = enumerate(content["frames"])
    return [f"{k} ({frame['file'].rpartition('/')[2]})" for k, frame in rows if k >= first]


@pytest.mark.parametrize("coarse_px", [0, pytest.param(10, marks=pytest.mark.slow)])
def test_coarse_masks_are_drawn_at_the_edges_where_images_alone_are_not_sure(
    command, plaster, tmp_path, coarse_px
):
    # Polygons clicked by hand: the body within all of them was a tenth too small, and the advice
    # was to check poses.
    def drawn(k, mask):
        loops = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        clicked = [cv2.approxPolyDP(loop, coarse_px, True) for loop in loops]
        return cv2.drawContours(np.zeros_like(mask), clicked, -1, 255, -1) if coarse_px else mask

    content, truth = masked(plaster, tmp_path, drawn)
    views = BagViews(imported(command, content, tmp_path))
    masks, poses = Segmentation(), Refine("auto")
    poses.report["after_in_sigmas"] = 3.0
    found = SecondLook(masks, poses)._drawn_anew(views, lambda *_: None)
    if not coarse_px:
        assert found == Changes()
        return
    (said,) = [*masks.report.get("notes", ()), *masks.report.get("warnings", ())]
    assert said.startswith("the masks that came are coarse: drawn anew at the edges")
    assert found.masks is not None
    pairs = zip(found.masks.values(), truth, strict=True)
    assert min(iou(own > 127, right) for own, right in pairs) > 0.95  # 0.89 before


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_boxes_in_place_of_masks_are_not_used(command, plaster, tmp_path):
    # Those of a detector: poses were said to be wrong, and the body had the corners of boxes.
    def boxed(k, mask):
        x, y, w, h = cv2.boundingRect(mask)
        mask[y : y + h, x : x + w] = 255
        return mask

    content, truth = masked(plaster, tmp_path, boxed)
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    assert "masks by joint views" in out
    assert "upright boxes around the object" in out
    assert "doubtful" not in out
    assert "left out" not in out
    assert cv2.imread(str(tmp_path / "masked.mcap.masks.png")) is not None
    views = BagViews(tmp_path / "masked.mcap")
    scores = [iou(v.mask > 127, t) for v, t in zip(views, truth, strict=True)]
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9


def with_masks(plaster, folder, turned):
    """Write the turn with its masks; ``turned`` gives for each view a rotation vector (3,) of
    its camera about itself, radians."""
    content = json.loads((plaster / "cameras.json").read_text())
    for k, frame in enumerate(content["frames"]):
        cv2.imwrite(str(folder / frame["file"]), cv2.imread(str(plaster / frame["file"])))
        frame["mask"] = f"mask_{k}.png"
        mask = np.load(plaster / f"{frame['file']}.npy")
        cv2.imwrite(str(folder / frame["mask"]), mask.astype(np.uint8) * 255)
        turn = cv2.Rodrigues(turned(k))[0]
        frame["R"] = (turn @ np.array(frame["R"])).tolist()
        frame["t"] = (turn @ np.array(frame["t"])).tolist()
    (folder / "cameras.json").write_text(json.dumps(content))
    return [cv2.imread(str(folder / frame["mask"]), 0) for frame in content["frames"]]


@pytest.mark.slow
def test_masks_in_poses_that_are_a_little_off_are_taken_as_they_are(command, plaster, tmp_path):
    # Sought again in wrong poses they agree with each other, and nobody sees what is wrong.
    rng = np.random.default_rng(3)
    given = with_masks(plaster, tmp_path, lambda k: 2e-3 * rng.normal(size=3))  # 3.3 px
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    assert command("segment", tmp_path / "given.mcap", tmp_path / "masked.mcap")[0] == 0
    for mask, view in zip(given, BagViews(tmp_path / "masked.mcap"), strict=True):
        assert np.array_equal(view.mask, mask)


@pytest.mark.slow
def test_masks_in_poses_that_are_all_off_by_much_are_not_left_out(command, plaster, tmp_path):
    # Those that were off by most were: but all agree where the poses are corrected.
    rng = np.random.default_rng(3)
    with_masks(plaster, tmp_path, lambda k: 6e-3 * rng.normal(size=3))  # 10 px
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    found = alone_.each_alone(BagViews(tmp_path / "given.mcap"), lambda *_: None)
    assert not found.misplaced
    assert not found.refuted


@pytest.mark.slow
def test_masks_most_of_which_are_wrong_blame_no_pose(command, plaster, tmp_path):
    # The right ones contradict them, and their views were left out.
    masks = with_masks(plaster, tmp_path, lambda k: np.zeros(3))
    for k, mask in enumerate(masks):
        if k % 3:
            cv2.imwrite(str(tmp_path / f"mask_{k}.png"), np.roll(mask, 60 - 120 * (k % 2), axis=1))
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    found = alone_.each_alone(BagViews(tmp_path / "given.mcap"), lambda *_: None)
    assert found.doubts
    assert not found.agreeing
    assert not found.misplaced


@pytest.mark.slow
def test_a_view_of_a_wrong_pose_is_kept_where_a_correction_is_found(command, plaster, tmp_path):
    with_masks(plaster, tmp_path, lambda k: np.array([0.0, 0.02 * (k == 8), 0.0]))  # 33 px
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    first_look = Segmentation("auto")
    assert first_look(BagViews(tmp_path / "given.mcap"), lambda *_: None).masks is None
    ((number, why),) = first_look.report["bad_views"].items()
    assert number == 8
    assert why.startswith("its mask lies on edges of its image, but ")
    assert why.endswith("nothing where its pose is corrected: its pose is wrong")
    # Where nobody corrects it the view spoils the surface.
    views = BagViews(tmp_path / "given.mcap")
    assert list(alone_.each_alone(views, lambda *_: None, to_correct=False).misplaced) == [8]


@pytest.mark.slow
def test_a_view_of_a_wrong_pose_is_left_out_and_named(command, plaster, tmp_path):
    # Its camera is told at the place of another, a quarter of the turn away.
    given = with_masks(plaster, tmp_path, lambda k: np.zeros(3))
    content = json.loads((tmp_path / "cameras.json").read_text())
    content["frames"][8] |= {key: content["frames"][5][key] for key in ("R", "t")}
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    assert command("import", tmp_path, tmp_path / "given.mcap")[0] == 0
    code, out, error = command("segment", tmp_path / "given.mcap", tmp_path / "masked.mcap")
    assert code == 0, error
    (named,) = (line for line in out.splitlines() if line.startswith("  view "))
    name = content["frames"][8]["file"]
    assert named.startswith(f"  view 8 ({name}): its mask lies on edges of its image")
    given[8][:] = 0
    for mask, view in zip(given, BagViews(tmp_path / "masked.mcap"), strict=True):
        assert np.array_equal(view.mask, mask)


@pytest.mark.slow
@pytest.mark.usefixtures("few_heights")
def test_a_mask_of_another_place_is_no_wrong_pose_though_it_lies_on_edges(
    command, shared_data, tmp_path
):
    # Of the print of a sheet, say. Left out, such a view had no outline, for its pose was blamed.
    folder = shared_data / "apple_aruco"
    content = json.loads((folder / "cameras.json").read_text())
    content["frames"] = content["frames"][::2]
    truth = []
    for k, frame in enumerate(content["frames"]):
        mask = cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE)
        truth.append(mask > 127)
        frame["file"], frame["mask"] = str(folder / frame["file"]), f"mask_{k}.png"
        if k in (1, 5, 10, 14, 19):
            mask = np.roll(mask, 166, axis=1)
        cv2.imwrite(str(tmp_path / frame["mask"]), mask)
    given = imported(command, content, tmp_path)
    code, out, error = command("segment", given, tmp_path / "masked.mcap")
    assert code == 0, error
    named = [line.strip() for line in out.splitlines() if "  view " in line]
    assert {int(line.split(":")[0].split()[1]) for line in named} == {1, 5, 10, 14, 19}
    assert any("its mask shows another place; but it shows edges" in line for line in named)
    views = list(BagViews(tmp_path / "masked.mcap"))
    assert min(iou(v.mask > 127, t) for v, t in zip(views, truth, strict=True)) > 0.9
