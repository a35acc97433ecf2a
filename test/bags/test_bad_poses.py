"""Poses that cannot be used, or are in another frame than the rest, are left out by name."""

import numpy as np
import pytest
from recordings import FRAMES, changed, write_all

from occ_recon_ros.bags.poses import PoseReading
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.errors import UserError

POSE = "/camera_pose"


def no_number(msg):
    msg.pose.position.x = float("nan")


def no_turn(msg):
    q = msg.pose.orientation
    q.x = q.y = q.z = q.w = 0.0


def other_frame(msg):
    msg.header.frame_id = "map"


def spoilt(messages, changes):
    """The messages, some poses of which are changed, by their number."""
    poses = [m for m in messages if m.topic == POSE]
    found = {poses[k]: change for k, change in changes.items()}
    return [changed(m, found[m]) if m in found else m for m in messages]


def test_they_cost_their_images_and_not_the_bag(bag, messages, tmp_path):
    bad = {2: no_number, 7: no_turn, 8: no_number}
    views = BagViews(write_all(tmp_path / "bag", spoilt(messages, bad)))
    whole = list(BagViews(bag).cameras())
    kept = [stamp for k, stamp in enumerate(whole) if k not in bad]
    assert list(views.cameras()) == kept == [view.stamp_ns for view in views]
    words = views.remarks()[0]
    assert "3 of 12 poses cannot be used and are left out" in words
    assert "2 the pose is not finite (at 1.200, 1.800 s)" in words
    assert "1 the quaternion must have length 1, got 0 (at 1.700 s)" in words
    assert "3 of 12 images have no pose of their stamp" in views.remarks()[1]


def test_of_poses_all_of_which_are_bad_that_is_said(messages, tmp_path):
    bad = dict.fromkeys(range(FRAMES), no_number)
    views = BagViews(write_all(tmp_path / "bag", spoilt(messages, bad)))
    with pytest.raises(UserError, match=r"12 of 12 poses cannot be used.*not finite"):
        views.remarks()


@pytest.mark.parametrize(("first", "named"), [(0, "turntable"), (6, "turntable"), (6, "map")])
def test_of_two_frames_one_is_used(messages, tmp_path, first, named):
    numbers = range(first, first + 6)
    views = BagViews(
        write_all(tmp_path / "bag", spoilt(messages, dict.fromkeys(numbers, other_frame))),
        reading=PoseReading(object_frame=named),
    )
    assert views.object_frame() == named
    assert len(views.cameras()) == FRAMES - 6
    other = "map" if named == "turntable" else "turntable"
    words = views.remarks()[0]
    assert f"6 of 12 poses are in the frame '{other}', not '{named}', and left out" in words
    assert f"--set contour_tracker.object_frame={other} takes those instead" in words


def test_of_frames_none_of_which_is_named_the_first_counts(messages, tmp_path):
    def world(msg):
        msg.header.frame_id = "world"

    bad = {k: other_frame if k < 3 else world for k in range(FRAMES)}
    views = BagViews(write_all(tmp_path / "bag", spoilt(messages, bad)))
    assert views.object_frame() == "map"
    assert len(views.cameras()) == 3


def test_poses_of_one_frame_that_has_another_name_are_all_used(messages, tmp_path):
    bad = dict.fromkeys(range(FRAMES), other_frame)
    views = BagViews(write_all(tmp_path / "bag", spoilt(messages, bad)))
    assert (views.object_frame(), len(views.cameras())) == ("map", FRAMES)
    assert views.remarks() == []
    np.testing.assert_array_equal([len(v.image) for v in views], 120)
