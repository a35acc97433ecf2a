"""What of a bag is played: each frame once, whatever was recorded twice."""

import pytest
from recordings import FRAMES, changed, write_all

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.views import BagViews

HOUR_NS = 3_600_000_000_000
FRAME = 3  # messages: camera_info, camera_pose, image
TWICE = {
    "two bags merged": lambda all_: all_ + all_,
    "a looped recording": lambda all_: all_ + later(all_),
    "the last frames again": lambda all_: all_ + later(all_[-2 * FRAME :]),
    "an image alone": lambda all_: all_ + [m for m in all_ if m.topic == "/image"][4:5],
}


def later(messages):
    return [m._replace(time_ns=m.time_ns + HOUR_NS) for m in messages]


def played(views):
    return [(m.topic, m.time_ns, m.cdr) for m in views.messages()]


@pytest.mark.parametrize("name", TWICE)
def test_a_frame_that_comes_twice_is_given_once(bag, messages, tmp_path, name):
    once = BagViews(bag)
    twice = BagViews(write_all(tmp_path / "bag", TWICE[name](messages)))
    assert played(twice) == played(once)
    assert [view.stamp_ns for view in twice] == [view.stamp_ns for view in once]
    assert len(twice) == len(once) == FRAMES
    (words,) = twice.remarks()
    assert "again" in words
    assert once.remarks() == []


def test_the_first_of_two_frames_of_one_stamp_is_taken(messages, tmp_path):
    def move(pose):
        pose.pose.position.x += 1

    moved = [changed(m, move) if m.topic == "/camera_pose" else m for m in later(messages)]
    views = BagViews(write_all(tmp_path / "bag", messages + moved))
    assert played(views) == [(m.topic, m.time_ns, m.cdr) for m in messages]


def test_poses_of_one_stamp_are_no_frame_that_comes_twice(messages, tmp_path):
    """Of two poses of a stamp the tracker takes the later one, as ever."""
    fifth = [m for m in messages if m.topic == "/camera_pose"][4]
    at = messages.index(fifth)
    views = BagViews(write_all(tmp_path / "bag", [*messages[:at], fifth, *messages[at:]]))
    assert len(played(views)) == len(messages) + 1
    assert len(views) == len({header_stamp_ns(m.cdr) for m in messages}) == FRAMES
    assert views.remarks() == []
