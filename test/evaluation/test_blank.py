"""Images that show nothing are left out before anything else is asked of a recording."""

import json

import cv2
import numpy as np
import pytest
from recordings import FRAMES, write_folder

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.evaluation.blank import Blank

DARK = (4, 9)


@pytest.fixture
def lamp_out(command, tmp_path):
    """A turn of a vase; the lamp was out in two of its images."""
    write_folder(tmp_path / "turn")
    for k in DARK:
        path = str(tmp_path / "turn" / f"{k}.png")
        assert cv2.imwrite(path, (0.04 * cv2.imread(path)).astype(np.uint8))
    return tmp_path / "turn"


def imported(command, folder, tmp_path):
    bag = tmp_path / "turn.mcap"
    assert command("import", folder, bag)[0] == 0
    return bag


def looked_at(bag):
    views, step = BagViews(bag), Blank()
    step(views, lambda done, total: None)
    return views, step.report


def test_they_are_named_and_as_if_they_were_not_there(command, lamp_out, tmp_path):
    views, report = looked_at(imported(command, lamp_out, tmp_path))
    (note,) = report["notes"]
    assert note.startswith("2 of 12 images are nearly black all over, unlike the others, and were")
    assert note.endswith(": 4.png, 9.png")
    shown = {view.stamp_ns for view in views}
    assert set(report["stamps_ns"]) == {v.stamp_ns for v in BagViews(views.bag.path)} - shown
    assert len(views) == len(list(views)) == len(views.cameras()) == FRAMES - 2
    assert [row["name"] for row in views.images()] == [
        f"{k}.png" for k in range(FRAMES) if k not in DARK
    ]
    views.write(tmp_path / "written.mcap")
    assert len(list(BagViews(tmp_path / "written.mcap"))) == FRAMES - 2


def test_one_without_a_name_is_called_by_its_number(command, lamp_out, tmp_path, monkeypatch):
    bag = imported(command, lamp_out, tmp_path)
    monkeypatch.setattr(BagViews, "images", lambda _: [{"name": ""} for _ in range(FRAMES)])
    assert looked_at(bag)[1]["notes"][0].endswith(": view 4, view 9")


def test_a_mask_tells_what_a_black_image_does_not(command, lamp_out, tmp_path):
    content = json.loads((lamp_out / "cameras.json").read_text())
    for k, frame in enumerate(content["frames"]):
        mask = np.zeros((120, 160), np.uint8)
        cv2.circle(mask, (80, 60), 30, 255, -1)
        assert cv2.imwrite(str(lamp_out / f"mask{k}.png"), mask)
        frame["mask"] = f"mask{k}.png"
    (lamp_out / "cameras.json").write_text(json.dumps(content))
    views, report = looked_at(imported(command, lamp_out, tmp_path))
    assert report == {}
    assert len(views) == FRAMES


@pytest.mark.slow
def test_no_view_is_placed_by_them_and_the_rest_is_good(command, lamp_out, tmp_path):
    bag, out = imported(command, lamp_out, tmp_path), tmp_path / "out"
    code, said, error = command("replay", bag, "--out", out)
    assert code == 0, error
    report = json.loads((out / "report.json").read_text())
    assert report["frames"]["images"] == report["frames"]["contours"] == FRAMES - 2
    assert report["source"]["segmentation"]["way"] == "single"
    assert "placed_anew" not in report["source"]["refinement"]
    assert "note: 2 of 12 images are nearly black all over" in said
    code, said, error = command("evaluate", out / "closed.ply", "--bag", bag)
    assert code == 0, error
    assert "far off" not in said
