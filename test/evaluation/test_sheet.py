"""An object on a printed sheet of which nobody told: poses are given, neither masks nor a board."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenes.standing import Standing, cameras_around, lying_pebble
from scipy.spatial.transform import Rotation

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation import segmentation
from occ_recon_ros.evaluation.advice import explains_all, of_remark
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.evaluation.sheet import held_sheet, sheet_in
from occ_recon_ros.imaging.joint import ViewReport
from occ_recon_ros.poses import BoardSpec
from occ_recon_ros.scene.coverage import coverage
from occ_recon_ros.scene.render import silhouette_loops

GRID = BoardSpec("aruco_grid", 5, 7, marker_m=0.03, gap_m=0.008, dictionary="DICT_5X5_100")
SIZE = (480, 360)
TURN = Rotation.from_rotvec([2.1, 0.6, -0.9]).as_matrix()  # of the object frame


class Recording(list):
    """Views as those of a bag."""

    changes = Changes()

    def images(self):
        return []

    def masked(self):
        return any(view.mask is not None for view in self)

    def told_of_masks(self):
        return {}

    def some(self, numbers):
        return (self[k] for k in numbers)

    def cameras(self):
        return {view.stamp_ns: view.camera for view in self}


def recording(count, board=GRID, mask=None):
    """An object on a sheet, and where it is seen: (h, w) coverage 0 to 1."""
    scene = Standing(lying_pebble(), board, colour=(60.0, 140.0, 80.0), shadow=0.2)
    views, truth = Recording(), []
    for k, camera in enumerate(cameras_around(count, SIZE, 490.0)):
        loops = silhouette_loops(scene.body.silhouette(camera, 0.5))
        truth.append(coverage(loops, *SIZE))
        R = camera.R_camera_object @ TURN.T
        moved = replace(
            camera, R_camera_object=R, t_camera_object=camera.t_camera_object - R @ [0.4, 0.1, -2.0]
        )
        views.append(View(k + 1, moved, scene.photograph(camera, k), mask))
    return views, truth


@pytest.mark.slow
def test_the_sheet_is_the_backdrop_and_no_part_of_the_object():
    views, truth = recording(10)
    step = Segmentation()
    found = step(views, lambda *_: None)
    for view, true in zip(views, truth, strict=True):
        mask = found.masks[view.stamp_ns] / 255
        assert np.minimum(mask, true).sum() / np.maximum(mask, true).sum() > 0.95
    assert step.on_sheet
    assert step.bounded
    assert "sheet of 5 x 7 markers (DICT_5X5" in step.report["notes"][0]
    assert "scan --board" in step.report["notes"][0]


@pytest.mark.slow
def test_masks_that_hold_the_sheet_with_the_object_are_named():
    # They agree with each other, and their body was as large as the sheet: cut by the border of
    # the image, it was said, and with no end above and below.
    views, truth = recording(6)
    held = Recording(replace(v, mask=np.full(SIZE[::-1], 255, np.uint8)) for v in views)
    step = Segmentation()
    assert step(held, lambda *_: None) == Changes()
    (said,) = step.report["warnings"]
    assert said.startswith("the masks that came hold the printed sheet of 5 x 7 markers (DICT_5X5")
    assert of_remark(said, "").startswith("cut the sheet from the masks")
    assert explains_all(said)
    right = Recording(
        replace(view, mask=np.rint(255 * true).astype(np.uint8))
        for view, true in zip(views, truth, strict=True)
    )
    assert held_sheet(right) == held_sheet(views) == ""


def test_no_backdrop_is_looked_for_where_masks_came(monkeypatch):
    monkeypatch.setattr(segmentation, "sheet_in", lambda views: pytest.fail("looked for"))
    views, _ = recording(1, mask=np.zeros(SIZE[::-1], np.uint8))
    step = Segmentation("joint")
    assert step(views, lambda *_: None) == Changes()
    assert not step.on_sheet


@pytest.mark.slow
def test_paper_that_is_not_lit_as_evenly_as_it_is_drawn_is_no_doubt_of_masks_on_edges(monkeypatch):
    views, _ = recording(6)
    small = np.zeros(SIZE[::-1], np.uint8)
    reports = [ViewReport(1.0, 0.6, 0.0, "", 0.0, 0.01) for _ in views]
    found = SimpleNamespace(
        method="joint",
        belief=0.25,
        warnings=(
            "only 60% of the outlines lie between colours of the object and of the backdrop",
        ),
        views=reports,
        agreement=1.0,
        edgeless=0.01,
        support=0.6,
        mask=lambda *_: small,
        trial=None,
        notes=(),
    )
    monkeypatch.setattr(segmentation, "JointSegmenter", lambda *_, **__: _Solved(found))
    step = Segmentation()
    assert step(views, lambda *_: None).masks is not None
    assert step.report["warnings"] == []
    assert step.report["belief"] > 0.95
    found.edgeless = 0.3
    step = Segmentation("joint")
    step(views, lambda *_: None)
    assert step.report["warnings"] == list(found.warnings)


class _Solved:
    """A joint segmenter that finds this."""

    def __init__(self, found):
        self.found = found

    def add(self, *_):
        pass

    def solve(self, asks_again, _like):
        assert asks_again(self.found) == (self.found.edgeless < 0.1)
        return self.found


@pytest.mark.slow
def test_where_nothing_stands_out_from_the_sheet_it_is_as_if_it_were_not_known(monkeypatch):
    views, _ = recording(3)  # too few to be looked at together
    step = Segmentation()
    assert step(views, lambda *_: None) == Changes()
    assert not step.on_sheet
    assert "notes" not in step.report


@pytest.mark.slow
def test_a_sheet_that_cannot_be_drawn_is_named(monkeypatch):
    views, _ = recording(6)
    found = sheet_in(views)
    assert found.board is not None
    monkeypatch.setattr(segmentation, "sheet_in", lambda views: replace(found, board=None))
    step = Segmentation("auto")
    monkeypatch.setattr(step, "_masks", lambda *_: Changes())
    step(views, lambda *_: None)
    assert "scan --board" in step.report["sheet"]["advice"]
    assert not step.on_sheet
