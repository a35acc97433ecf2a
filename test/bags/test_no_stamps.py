"""Topics whose header stamps are all 0: the times of recording are taken."""

import numpy as np
import pytest
from recordings import FRAMES, changed, later, write_all

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.errors import UserError


def unstamped(message):
    def clear(msg):
        msg.header.stamp.sec = msg.header.stamp.nanosec = 0

    return changed(message, clear)


@pytest.mark.parametrize("topics", [("/image",), ("/camera_info", "/camera_pose", "/image")])
def test_the_times_of_recording_are_taken(bag, messages, tmp_path, topics):
    found = [unstamped(m) if m.topic in topics else m for m in messages]
    views, whole = BagViews(write_all(tmp_path / "bag", found)), BagViews(bag)
    assert views.cameras().keys() == whole.cameras().keys()
    assert len(list(views)) == FRAMES
    words = views.remarks()[0]
    assert f"all stamps of {', '.join(topics)} are 0: the times of recording are taken" in words
    views.write(tmp_path / "again.mcap")
    assert BagViews(tmp_path / "again.mcap").remarks() == []


def test_parts_that_were_recorded_a_little_apart_meet_between_the_poses(bag, messages, tmp_path):
    late = {"/image": 30_000_000, "/camera_info": 20_000_000, "/camera_pose": 0}
    found = [unstamped(m)._replace(time_ns=m.time_ns + late[m.topic]) for m in messages]
    views = BagViews(write_all(tmp_path / "bag", sorted(found, key=lambda m: m.time_ns)))
    assert len(views.cameras()) == FRAMES
    np.testing.assert_array_equal(
        [header_stamp_ns(m.cdr) for m in views.messages() if m.topic == "/image"],
        [m.time_ns for m in found if m.topic == "/image"],
    )


def test_masks_recorded_apart_from_their_images_are_named(messages, tmp_path):
    masks = [m._replace(topic="/mask") for m in messages if m.topic == "/image"]
    masks = [later(m, 0)._replace(time_ns=m.time_ns + 7_000_000) for m in masks]
    found = sorted([*messages, *masks], key=lambda m: m.time_ns)
    views = BagViews(write_all(tmp_path / "bag", [unstamped(m) for m in found]))
    with pytest.raises(UserError, match=r"mask has the stamp of no image.* 7 ms later"):
        views.remarks()


def test_one_message_of_stamp_0_is_no_clock_that_stands(messages, tmp_path):
    """As of a camera_info that is latched."""
    first = next(m for m in messages if m.topic == "/camera_info")
    found = [unstamped(first), *(m for m in messages if m.topic != "/camera_info")]
    views = BagViews(write_all(tmp_path / "bag", found))
    assert len(views.cameras()) == FRAMES
    assert "recording" not in " ".join(views.remarks())
