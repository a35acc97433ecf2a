"""A surface is judged by the cameras that it was made with."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.evaluation.corrected import camera_rows, cameras_beside
from occ_recon_ros.scene import make_object


@pytest.fixture
def surface(bag, tmp_path):
    """The true vase turned a little about, and the report of a replay that corrected cameras so
    that they see it where the images show it."""
    views = list(BagViews(bag))
    shift = np.array([0.0, 0.0, 0.02])
    cameras = {
        view.stamp_ns: replace(
            view.camera,
            t_camera_object=view.camera.t_camera_object - view.camera.R_camera_object @ shift,
        )
        for view in views
    }
    mesh = make_object("vase").mesh()
    mesh.apply_translation(shift)
    mesh.export(tmp_path / "closed.ply")
    rows = camera_rows(cameras, BagViews(bag).cameras())
    report = {
        "source": {"refinement": {"cameras": rows}},
        "files": ["closed.ply"],
    }
    (tmp_path / "report.json").write_text(json.dumps(report))
    return tmp_path / "closed.ply", cameras


def test_cameras_come_back_as_they_were_written(surface, bag):
    path, cameras = surface
    found = cameras_beside(path, BagViews(bag))
    assert found.keys() == cameras.keys()
    for stamp, camera in cameras.items():
        assert (found[stamp].K == camera.K).all()
        assert (found[stamp].t_camera_object == camera.t_camera_object).all()


def test_they_serve_a_recording_of_the_same_cameras(surface, bag, tmp_path):
    path, cameras = surface
    masked = tmp_path / f"masked{bag.suffix}"
    shutil.copy(bag, masked)
    assert cameras_beside(path, BagViews(masked)).keys() == cameras.keys()


def test_a_report_of_something_else_says_nothing(surface, bag, tmp_path):
    path, cameras = surface
    bag = BagViews(bag)
    assert cameras_beside(path, bag) is not None
    assert cameras_beside(path.with_name("mine.ply"), bag) is None
    other = BagViews(bag.bag.path)
    other.changes = Changes(cameras=cameras)
    assert cameras_beside(path, other) is None
    (tmp_path / "report.json").write_text("[]")
    assert cameras_beside(path, bag) is None
    (tmp_path / "report.json").unlink()
    assert cameras_beside(path, bag) is None


def test_a_bag_that_has_views_beyond_them_is_another_but_for_blank_images(surface, bag, tmp_path):
    path, cameras = surface
    report = json.loads((tmp_path / "report.json").read_text())
    *rows, last = report["source"]["refinement"]["cameras"]
    report["source"]["refinement"]["cameras"] = rows
    (tmp_path / "report.json").write_text(json.dumps(report))
    assert cameras_beside(path, BagViews(bag)) is None
    report["source"]["blank_images"] = {"stamps_ns": [last["stamp_ns"]]}
    (tmp_path / "report.json").write_text(json.dumps(report))
    assert len(cameras_beside(path, BagViews(bag))) == len(cameras) - 1


def test_evaluate_sees_by_them_and_says_so(command, surface, bag, tmp_path):
    path, _ = surface
    code, out, _ = command("evaluate", path, "--bag", bag, "--out", tmp_path / "a.json")
    assert code == 0
    assert "cameras that the replay corrected" in out
    code, out, _ = command(
        "evaluate", path, "--bag", bag, "--out", tmp_path / "b.json", "--given-cameras"
    )
    assert code == 0
    assert "the replay corrected" not in out
    by_corrected, by_given = (
        json.loads((tmp_path / name).read_text())["iou"]["min"] for name in ("a.json", "b.json")
    )
    assert by_corrected > 0.97
    assert by_given < 0.9
