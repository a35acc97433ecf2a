"""Photographs on a board, in the order of their places around the object."""

from types import SimpleNamespace

import cv2
import numpy as np

from occ_recon_ros.bags.photographs import FolderPictures
from occ_recon_ros.bags.scanning import ScanPoses, by_place
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses.sequence import BoardPoses

COUNT = 24


def pose(k):
    a = 2 * np.pi * k / COUNT
    return CameraPose(np.eye(3), np.array([np.cos(a), np.sin(a), 0.5]))


def scanned(folder, places):
    """Photographs called by their number, each as light as its place around the object; the last
    shows no board."""
    folder.mkdir()
    for k, place in enumerate([*places, COUNT]):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((8, 8), 10 * place, np.uint8))
    kept = [
        SimpleNamespace(
            shot=SimpleNamespace(name=f"{k}.png"),
            pose=SimpleNamespace(pose=pose(place), covariance=np.eye(6), rms_px=0.1),
        )
        for k, place in enumerate(places)
    ]
    camera = Camera(np.diag([9.0, 9.0, 1.0]), 8, 8, np.eye(3), np.zeros(3))
    board = SimpleNamespace(marker_ids=(0,), not_printed=())
    return ScanPoses(BoardPoses(camera, kept, {f"{COUNT}.png": "no_board"}, board), COUNT + 1)


def test_photographs_of_shuffled_names_are_taken_around_the_object(tmp_path):
    # They were in no order, and doubtful for that, though their places were known.
    places = np.random.default_rng(3).permutation(COUNT)
    found = scanned(tmp_path / "v", places.tolist())
    pictures = FolderPictures(tmp_path / "v")
    found, pictures = by_place(found, pictures)
    assert "the photographs were put in the order of their places around" in found.lines[-1]
    assert "in this order 15" in found.lines[-1]
    views = [*found.posed(pictures)]
    assert [view.name for view in views] == found.names
    assert np.all(np.diff([view.stamp_ns for view in views]) > 0)
    shown = np.array([int(view.image[0, 0].max()) // 10 for view in views])
    assert set(np.diff(shown) % COUNT) in ({1}, {COUNT - 1})
    for place, view in zip(shown, views, strict=True):
        assert np.allclose(view.camera.centre, pose(place).centre)


def test_photographs_that_follow_each_other_stay_as_they_are_called(tmp_path):
    found = scanned(tmp_path / "v", range(COUNT))
    pictures = FolderPictures(tmp_path / "v")
    assert by_place(found, pictures) == (found, pictures)
