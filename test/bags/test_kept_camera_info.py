"""A camera_info holds until the next one comes: for the images that have none of their stamp."""

import numpy as np
import pytest
from recordings import FRAMES, changed, later, write_all

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.views import BagViews

INFO = "/camera_info"
MS = 1_000_000


def bag_of(path, messages, keep):
    """A bag of the messages, with those camera_info whose number is kept."""
    infos = [m for m in messages if m.topic == INFO]
    kept = [infos[k] for k in keep]
    return write_all(path, [m for m in messages if m.topic != INFO or m in kept])


def focal(views):
    return [camera.K[0, 0] for camera in views.cameras().values()]


@pytest.mark.parametrize("keep", [[0], [6], [FRAMES - 1], range(6, FRAMES), range(0, FRAMES, 3)])
def test_images_without_one_have_that_before_them_or_the_first(bag, messages, tmp_path, keep):
    views = BagViews(bag_of(tmp_path / "bag", messages, keep))
    whole = BagViews(bag)
    assert views.cameras().keys() == whole.cameras().keys()
    assert focal(views) == focal(whole)
    (words,) = views.remarks()
    assert f"{FRAMES - len(keep)} of {FRAMES} images have no camera_info of their stamp" in words
    played = [header_stamp_ns(m.cdr) for m in views.messages() if m.topic == INFO]
    assert sorted(played) == sorted(whole.cameras())
    views.write(tmp_path / "again.mcap")
    assert BagViews(tmp_path / "again.mcap").remarks() == []


@pytest.mark.parametrize("ns", [7 * MS, -(10**9), 3600 * 10**9])
def test_of_other_stamps_they_hold_as_well(messages, tmp_path, ns):
    moved = [later(m, ns) if m.topic == INFO else m for m in messages]
    views = BagViews(write_all(tmp_path / "bag", moved))
    assert len(list(views)) == FRAMES
    assert len([m for m in views.messages() if m.topic == INFO]) == FRAMES


def test_each_camera_has_its_own(messages, tmp_path):
    """Two publish on one topic: told apart by frame_id, where images and camera_info share it."""

    def of_other(msg):
        msg.header.frame_id = "other"
        msg.k = msg.k * np.array([2, 1, 1, 1, 2, 1, 1, 1, 1])

    info = next(m for m in messages if m.topic == INFO)
    found = [info, later(changed(info, of_other), 1), *(m for m in messages if m.topic != INFO)]
    views = BagViews(write_all(tmp_path / "bag", found))
    assert set(focal(views)) == {250.0}


def zoomed(messages, numbers, by=1.1):
    def zoom(msg):
        msg.k = msg.k * np.array([by, 1, 1, 1, by, 1, 1, 1, 1])

    infos = [m for m in messages if m.topic == INFO]
    chosen = [infos[k] for k in numbers]
    return [changed(m, zoom) if m in chosen else m for m in messages]


def test_one_that_changes_midway_is_named_once_and_used(messages, tmp_path):
    views = BagViews(write_all(tmp_path / "bag", zoomed(messages, range(7, FRAMES))))
    (words,) = views.remarks()
    assert "camera_info changed in mid-scan, at stamp 1.700" in words
    assert "f 275.0 px instead of 250.0 (+10.0%)" in words
    np.testing.assert_allclose(focal(views)[6:8], [250, 275])


def test_those_that_differ_from_image_to_image_are_meant_so(messages, tmp_path):
    """As of photographs whose cameras were solved for one by one."""
    views = BagViews(write_all(tmp_path / "bag", zoomed(messages, range(0, FRAMES, 2))))
    assert views.remarks() == []
