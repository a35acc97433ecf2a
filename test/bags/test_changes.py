"""A first pass over a bag puts masks, poses and calibrations in place of those recorded."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixtures import COARSE

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.cli.replay import BagSource
from occ_recon_ros.cli.scan import ScanOptions, run_scan


@pytest.fixture
def views(command, folder, tmp_path) -> BagViews:
    """Three views with masks."""
    assert command("import", folder.path, tmp_path / "scan.mcap")[0] == 0
    return BagViews(tmp_path / "scan.mcap")


def test_a_bag_without_changes_is_as_it_was_recorded(views):
    assert [m.topic for m in views.messages()] == [
        m.topic for m in views.bag.messages(views.topics)
    ]
    assert views.object_frame() == "turntable"


def test_masks_are_those_of_the_change_alone(views):
    before = list(views)
    first, last = before[0].stamp_ns, before[-1].stamp_ns
    found = {first: 255 - before[0].mask, last: np.zeros_like(before[-1].mask)}
    views.changes = Changes(masks=found)
    after = list(views)
    # The image that the change says nothing of has none.
    assert [view.stamp_ns for view in after] == [view.stamp_ns for view in before]
    assert [view.mask is None for view in after] == [False, True, False]
    for view in (after[0], after[-1]):
        np.testing.assert_array_equal(view.mask, found[view.stamp_ns])
    np.testing.assert_array_equal(after[0].image, before[0].image)
    np.testing.assert_allclose(after[0].camera.centre, before[0].camera.centre)


def test_a_bag_without_masks_gets_them(command, folder, tmp_path):
    bag = tmp_path / "bare.mcap"
    assert command("import", folder.path, bag, "--no-masks")[0] == 0
    views = BagViews(bag)
    assert all(view.mask is None for view in views)
    mask = np.full((48, 64), 255, np.uint8)
    views.changes = Changes(masks={view.stamp_ns: mask for view in views})
    assert "/mask" in views.played()
    assert [int(view.mask.min()) for view in views] == [255, 255, 255]


def test_cameras_are_those_of_the_change(views):
    before = list(views)
    moved = {
        view.stamp_ns: replace(
            view.camera,
            K=view.camera.K * [[1.1], [1.1], [1]],
            t_camera_object=view.camera.t_camera_object + np.array([0.01, 0, 0]),
        )
        for view in before
    }
    views.changes = Changes(cameras=moved)
    for view in views:
        np.testing.assert_allclose(view.camera.K, moved[view.stamp_ns].K)
        np.testing.assert_allclose(view.camera.centre, moved[view.stamp_ns].centre, atol=1e-12)
        assert view.mask is not None


def test_a_later_step_adds_to_an_earlier_one_and_outdoes_it():
    one, two = Changes(masks={1: np.zeros(1)}), Changes(masks={}, cameras={})
    assert one.then(Changes()) == one
    assert one.then(two).masks == {}
    assert one.then(two).topics() == ("/mask", "/camera_info", "/camera_pose")


def test_what_a_step_finds_is_what_the_nodes_get(bag: Path, tmp_path):
    """A table twice as large and twice as far away looks the same."""
    calls = []

    def twice(views, progress):
        calls.append(len(views))
        return Changes(
            cameras={
                view.stamp_ns: replace(view.camera, t_camera_object=2 * view.camera.t_camera_object)
                for view in views
            }
        )

    def seen_by_the_next(views, progress):
        calls.append([np.linalg.norm(view.camera.t_camera_object) for view in views])
        return Changes()

    coarse = [COARSE.removeprefix("--set=")]
    plain = run_scan(BagSource(bag), ScanOptions(tmp_path / "plain", assignments=coarse))
    source = BagSource(bag, steps=(twice, seen_by_the_next))
    large = run_scan(source, ScanOptions(tmp_path / "large", assignments=coarse))
    assert calls[0] == len(calls[1]) == plain["frames"]["images"]
    assert large["frames"] == plain["frames"]
    np.testing.assert_allclose(
        large["mesh"]["size_m"], 2 * np.array(plain["mesh"]["size_m"]), rtol=0.01
    )
    assert json.loads((tmp_path / "large" / "report.json").read_text())["command"] == "replay"
