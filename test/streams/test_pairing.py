"""Image, camera_info, pose and mask meet by stamp."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from occ_recon_ros.streams.pairing import Pairing, Poses

MS = 1_000_000


class Feed:
    def __init__(self, **settings):
        self.drops = Counter()
        self.pairing = Pairing(lambda reason, stamp: self.drops.update([reason]), **settings)
        self.frames = []

    def add(self, what, stamp):
        if what == "pose":
            self.frames += self.pairing.add_pose(stamp, ("pose", stamp))
        else:
            part = {"info": "camera_info"}.get(what, what)
            self.frames += self.pairing.add(part, stamp, (part, stamp))
        return self

    def whole(self, *stamps):
        for stamp in stamps:
            self.add("info", stamp).add("pose", stamp).add("image", stamp)
        return self

    @property
    def stamps(self):
        return [frame.stamp_ns for frame in self.frames]


@given(st.permutations(["image", "info", "pose", "mask"]))
def test_the_last_part_makes_the_frame_whatever_it_is(order):
    feed = Feed()
    feed.pairing.await_mask = True
    for what in order[:3]:
        feed.add(what, 5)
        assert not feed.frames
    (frame,) = feed.add(order[3], 5).frames
    assert frame.parts == {k: (k, 5) for k in ("image", "camera_info", "mask")}
    assert frame.poses == (("pose", 5),)
    assert not feed.drops
    assert len(feed.pairing) == 0


def test_a_mask_that_came_is_used_even_if_none_was_awaited():
    (frame,) = Feed().add("mask", 5).whole(5).frames
    assert "mask" in frame.parts


def test_what_lacks_a_part_is_dropped_by_what_it_lacks_when_a_later_frame_is_whole():
    feed = Feed().add("info", 1).add("pose", 1)
    feed.add("image", 2).add("pose", 2)
    feed.add("image", 3).add("info", 3)
    feed.whole(4)
    assert feed.stamps == [4]
    assert feed.drops == {"no_image": 1, "no_camera_info": 1, "no_camera_pose": 1}


def test_a_later_frame_that_waits_is_not_given_up():
    feed = Feed().add("image", 9).whole(4).add("info", 9).add("pose", 9)
    assert feed.stamps == [4, 9]
    assert not feed.drops


def test_of_too_many_that_wait_the_oldest_goes():
    feed = Feed(depth=3)
    for stamp in range(6):
        feed.add("image", stamp)
    assert feed.drops == {"no_camera_info": 3}
    assert feed.add("info", 5).add("pose", 5).stamps == [5]


def test_frames_that_never_become_whole_do_not_bar_those_of_an_earlier_time():
    feed = Feed(depth=3)
    for stamp in (7000, 8000, 9000):
        feed.add("image", stamp)
    assert feed.whole(10, 20, 30).stamps == [10, 20, 30]


def test_a_part_that_comes_twice_is_counted_and_harmless():
    feed = Feed().add("image", 5).add("image", 5).add("info", 5).add("pose", 5)
    assert feed.stamps == [5]
    assert feed.drops == {"duplicate": 1}


def interpolating(gap_ms=20):
    return Feed(interpolate=True, max_pose_gap_ns=gap_ms * MS)


def test_between_two_poses_the_frame_waits_for_the_later_one():
    feed = interpolating().add("pose", 10 * MS).add("image", 13 * MS).add("info", 13 * MS)
    assert not feed.frames
    (frame,) = feed.add("pose", 20 * MS).frames
    assert frame.poses == (("pose", 10 * MS), ("pose", 20 * MS))
    assert abs(frame.fraction - 0.3) < 1e-12


def test_a_pose_of_the_very_stamp_needs_no_neighbours():
    (frame,) = interpolating().whole(7 * MS).frames
    assert frame.poses == (("pose", 7 * MS),)


def test_the_nearest_neighbours_are_taken_whatever_the_order_they_came_in():
    feed = interpolating()
    for stamp in (30, 10, 20, 40):
        feed.add("pose", stamp * MS)
    (frame,) = feed.add("image", 24 * MS).add("info", 24 * MS).frames
    assert frame.poses == (("pose", 20 * MS), ("pose", 30 * MS))


def test_a_gap_that_is_too_wide_drops_the_frame_by_name():
    feed = interpolating(gap_ms=20).add("pose", 0)
    feed.add("image", 15 * MS).add("info", 15 * MS).add("pose", 30 * MS)
    assert not feed.frames
    feed.whole(40 * MS)
    assert feed.stamps == [40 * MS]
    assert feed.drops == {"pose_gap": 1}


def test_a_pose_from_the_far_future_does_not_spoil_the_frames_before_it():
    feed = interpolating().add("pose", 10**15)
    for k in range(5):
        feed.add("pose", k * 10 * MS)
        feed.add("image", (k * 10 + 5) * MS).add("info", (k * 10 + 5) * MS)
    feed.add("pose", 50 * MS)
    assert len(feed.frames) == 5
    assert not feed.drops


def test_poses_that_go_back_in_time_are_a_new_run():
    feed = interpolating()
    for stamp in (100, 110, 120, 130):
        feed.add("pose", stamp * MS)
    feed.add("pose", 100 * MS).add("image", 105 * MS).add("info", 105 * MS)
    assert not feed.frames  # the pose at 110 is of the old run
    assert feed.add("pose", 110 * MS).stamps == [105 * MS]


@given(
    st.lists(
        st.tuples(st.sampled_from(["image", "info", "pose", "mask"]), st.integers(0, 40)),
        max_size=200,
    ),
    st.booleans(),
)
def test_memory_is_bounded_and_a_good_frame_gets_through_after_anything(stream, interpolate):
    feed = Feed(interpolate=interpolate, max_pose_gap_ns=5, depth=6)
    for what, stamp in stream:
        feed.add(what, stamp)
        assert len(feed.pairing) <= 6
    feed.whole(100)
    assert feed.stamps[-1] == 100


def test_a_frame_may_be_spared_its_mask_but_nothing_else():
    feed = Feed(depth=3)
    feed.pairing.await_mask = feed.pairing.spare_mask = True
    feed.whole(1).add("image", 2).add("mask", 2).whole(3)
    assert not feed.frames
    feed.whole(4).add("mask", 4)
    assert feed.stamps == [1, 3, 4]
    assert ["mask" in frame.parts for frame in feed.frames] == [False, False, True]
    assert feed.drops == {"no_camera_info": 1}
    feed.whole(5, 6).add("image", 7)
    assert [frame.stamp_ns for frame in feed.pairing.flush()] == [5, 6]
    assert feed.drops == {"no_camera_info": 2}
    assert len(feed.pairing) == 0


def test_without_a_mask_nothing_is_spared_where_all_need_one():
    feed = Feed(depth=1)
    feed.pairing.await_mask = True
    feed.whole(1, 2)
    assert not feed.frames
    assert feed.drops == {"no_mask": 1}


def test_an_image_that_lacks_mask_and_pose_is_dropped_for_its_pose():
    feed = Feed(depth=1)
    feed.pairing.await_mask = True
    feed.add("image", 1).add("camera_info", 1).whole(2).add("mask", 2)
    assert feed.drops == {"no_camera_pose": 1}


def test_no_pose_is_looked_up_for_a_frame_without_its_image():
    class OfTheImage(Poses):
        def around(self, frame):
            assert "image" in frame.parts
            return super().around(frame)

    feed = Feed(depth=1, interpolate=True, max_pose_gap_ns=MS, poses=OfTheImage())
    feed.add("camera_info", 1).whole(2)
    assert feed.stamps == [2]
    assert feed.drops == {"no_image": 1}
