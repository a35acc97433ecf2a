"""What of a bag is played: each frame once, whatever was recorded twice."""

import random

import pytest
from recordings import FRAMES, changed, write_all
from rosbags.rosbag2 import StoragePlugin

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
    assert "the first is taken" in words
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


def shuffled(messages):
    mixed = random.Random(1).sample(messages, len(messages))
    return [m._replace(time_ns=k * 10_000_000) for k, m in enumerate(mixed)]


def last(topic):
    return lambda all_: (
        [m for m in all_ if m.topic != topic] + later([m for m in all_ if m.topic == topic])
    )


def swapped(messages, one, other):
    assert messages[one].topic == messages[other].topic == "/image"
    found = list(messages)
    found[one] = messages[other]._replace(time_ns=messages[one].time_ns)
    found[other] = messages[one]._replace(time_ns=messages[other].time_ns)
    return found


SCATTERED = {
    "all poses last": last("/camera_pose"),
    "all images last": last("/image"),
    "all calibrations last": last("/camera_info"),
    "shuffled": shuffled,
    "two images changed places": lambda all_: swapped(all_, 5, 8),
    "shuffled and twice": lambda all_: shuffled(all_ + all_),
}


@pytest.mark.parametrize("storage", StoragePlugin)
@pytest.mark.parametrize("name", SCATTERED)
def test_messages_far_from_the_order_of_their_stamps_are_put_in_it(
    messages, tmp_path, name, storage
):
    views = BagViews(write_all(tmp_path / "bag", SCATTERED[name](messages), storage))
    found = list(views.messages())
    stamps = [m.time_ns for m in found]
    assert stamps == [header_stamp_ns(m.cdr) for m in found] == sorted(stamps)
    assert {(m.topic, m.cdr) for m in found} == {(m.topic, m.cdr) for m in messages}
    assert len(found) == len(messages)
    assert len(list(views)) == FRAMES
    assert list(views.messages()) == found
    assert "order" in views.remarks()[-1]


def restarted(messages, kept):
    """The same again from ``kept`` frames of it on, as of a clock that was set back by so many."""
    moved = [
        changed(m, lambda msg: setattr(msg.header.stamp, "nanosec", msg.header.stamp.nanosec + 1))
        for m in later(messages)
    ]
    return messages[: kept * FRAME] + moved


@pytest.mark.parametrize(("kept", "as_recorded"), [(FRAMES, True), (3, False)])
def test_a_clock_that_was_set_back_is_no_disorder(messages, tmp_path, kept, as_recorded):
    # What follows is another scan; a few frames back are images that came in another order.
    both = restarted(messages, kept)
    views = BagViews(write_all(tmp_path / "bag", both))
    assert (played(views) == [(m.topic, m.time_ns, m.cdr) for m in both]) == as_recorded
    assert bool(views.remarks()) != as_recorded


def test_in_that_order_a_bag_is_written(messages, tmp_path):
    views = BagViews(write_all(tmp_path / "bag", shuffled(messages)))
    views.write(tmp_path / "sorted.mcap")
    again = BagViews(tmp_path / "sorted.mcap")
    assert again.remarks() == []
    assert played(again) == played(views)


def test_the_end_of_a_damaged_bag_does_not_spoil_its_order(messages, tmp_path):
    back = [m._replace(time_ns=k) for k, m in enumerate(reversed(messages))]
    folder = write_all(tmp_path / "bag", back, StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    cut = tmp_path / "cut.db3"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 4])
    views = BagViews(cut)
    assert views.bag.lost
    stamps = [header_stamp_ns(m.cdr) for m in views.messages()]
    assert 0 < len(stamps) < len(messages)
    assert stamps == sorted(stamps)


@pytest.mark.parametrize("late_ns", [0, 30_000_000, 700_000_000])
@pytest.mark.parametrize("topic", ["/camera_info", "/camera_pose", "/image"])
def test_messages_that_are_a_little_late_are_played_as_recorded(messages, tmp_path, topic, late_ns):
    late = [m._replace(time_ns=m.time_ns + late_ns * (m.topic == topic)) for m in messages]
    late.sort(key=lambda m: m.time_ns)
    views = BagViews(write_all(tmp_path / "bag", late))
    assert played(views) == [(m.topic, m.time_ns, m.cdr) for m in late]
    assert views.remarks() == []
