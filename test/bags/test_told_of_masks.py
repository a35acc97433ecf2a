"""What is to be thought of masks travels with the bag that holds them."""

import json

import numpy as np
import pytest

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.reader import open_bag
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.cli import segmenting
from occ_recon_ros.evaluation import segmentation
from occ_recon_ros.evaluation.alone import Alone

TOLD = {
    "belief": 0.6,
    "warnings": ["only 74% of the outlines lie between colours"],
    "notes": ["a round foot was taken along"],
    "bad_views": {2: "it shows no object; left out"},
}


@pytest.fixture
def plain(command, folder, tmp_path):
    """A bag of the small folder, with masks."""
    assert command("import", folder.path, tmp_path / "plain.mcap")[0] == 0
    return tmp_path / "plain.mcap"


@pytest.mark.parametrize("name", ["b.mcap", "b.db3", "b"])
def test_it_is_read_as_it_was_written_and_goes_on_with_the_masks(plain, tmp_path, name):
    BagViews(plain).write(tmp_path / "told", told=TOLD | {"agreement": [0.9]})
    BagViews(tmp_path / "told").write(tmp_path / name)
    assert open_bag(tmp_path / name).told_of_masks == TOLD
    assert open_bag(tmp_path / name).names  # beside it
    assert open_bag(plain).told_of_masks == {}


def test_of_other_masks_nothing_is_told(plain, tmp_path):
    BagViews(plain).write(tmp_path / "told", told=TOLD)
    views = BagViews(tmp_path / "told")
    views.changes = Changes(masks={v.stamp_ns: np.zeros((48, 64), np.uint8) for v in views})
    views.write(tmp_path / "other")
    assert open_bag(tmp_path / "other").told_of_masks == {}


@pytest.mark.parametrize("text", ["{", "[1]", '{"warnings": 3}', '{"belief": "much"}'])
def test_what_cannot_be_read_is_nothing(plain, tmp_path, monkeypatch, text):
    monkeypatch.setattr("occ_recon_ros.bags.writer.told_text", lambda _: text)
    BagViews(plain).write(tmp_path / "told", told=TOLD)
    assert open_bag(tmp_path / "told").told_of_masks == {}


@pytest.mark.parametrize("way", ["single", "auto"])
def test_masks_that_segment_doubted_stay_doubted(plain, tmp_path, monkeypatch, way):
    # The masks agree, and lie where images show no edge, which was weighed when they were found.
    BagViews(plain).write(tmp_path / "told", told=TOLD)
    beside = ("12% of the outlines lie where their images show no edge",)
    alone = Alone({}, (), {}, {}, {}, off_edges=beside)
    monkeypatch.setattr(segmentation, "at_edges", lambda *_: alone)
    # Who told no belief did not weigh them.
    BagViews(plain).write(tmp_path / "unweighed", told={"bad_views": {}})
    bags = (tmp_path / "told", True), (plain, False), (tmp_path / "unweighed", False)
    for bag, told in bags:
        step = segmentation.Segmentation(way)
        assert step(BagViews(bag), lambda *_: None).masks is None
        came = list(beside) if way == "auto" else []
        assert step.report.get("warnings", []) == (TOLD["warnings"] if told else came)
        assert step.report.get("notes", []) == (TOLD["notes"] if told else [])
        assert step.report.get("bad_views", {}) == (TOLD["bad_views"] if told else {})
        assert step.report.get("belief") == (0.6 if told else None)
        assert list(step.off_edges) == ([] if told else came)


def test_images_that_are_asked_alone_do_not_have_the_doubts_of_masks_that_came(plain, tmp_path):
    BagViews(plain).write(tmp_path / "told", told=TOLD)
    step = segmentation.Segmentation("joint", images_alone=True)
    step(BagViews(tmp_path / "told"), lambda *_: None)
    assert TOLD["warnings"][0] not in step.report["warnings"]


def test_segment_writes_what_it_says_into_its_bag(command, folder, tmp_path, monkeypatch):
    def found(self, views, progress):
        self.report = {"way": "joint"} | TOLD
        return Changes(masks={v.stamp_ns: np.full((48, 64), 255, np.uint8) for v in views})

    monkeypatch.setattr(segmentation.Segmentation, "__call__", found)
    monkeypatch.setattr(segmenting.Refine, "__call__", lambda *_: Changes())
    plain, masked = tmp_path / "plain.mcap", tmp_path / "masked.mcap"
    assert command("import", folder.path, plain, "--no-masks")[0] == 0
    code, out, error = command("segment", plain, masked, "--json")
    assert code == 0, error
    assert json.loads(out)["belief"] == 0.6
    assert open_bag(masked).told_of_masks == TOLD
