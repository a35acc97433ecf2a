"""replay of bags that were merged, looped, or written in another order than that of time."""

import json
import random

import pytest
from fixtures import COARSE
from recordings import FRAMES, later, write_all

from occ_recon_ros.cli import drive
from occ_recon_ros.cli.drive import companions_first

ALL = f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims"


@pytest.mark.slow
def test_frames_that_come_twice_change_nothing_but_a_warning(command, messages, expected, tmp_path):
    """With the first passes over the images, which hold each view against the others."""
    bag = write_all(tmp_path / "bag", messages + messages[-12:])
    code, text, err = command("replay", bag, "--out", tmp_path / "out", COARSE)
    assert code == 0, err
    assert ALL in text
    assert (tmp_path / "out" / "rims.ply").read_bytes() == expected
    assert "4 are left out" in err
    assert err.count("\n") == 1
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["images"] == FRAMES


@pytest.mark.slow
@pytest.mark.parametrize("name", ["all poses after all images", "shuffled"])
def test_no_frame_is_lost_of_a_bag_in_another_order(replay, messages, expected, tmp_path, name):
    if name == "shuffled":
        mixed = random.Random(1).sample(messages, len(messages))
        mixed = [m._replace(time_ns=k * 10_000_000) for k, m in enumerate(mixed)]
    else:
        mixed = [m for m in messages if m.topic != "/camera_pose"]
        hour = 3_600_000_000_000
        poses = [m for m in messages if m.topic == "/camera_pose"]
        mixed += [m._replace(time_ns=m.time_ns + hour) for m in poses]
    code, text, err = replay(write_all(tmp_path / "bag", mixed), tmp_path / "out")
    assert code == 0, err
    assert ALL in text
    assert (tmp_path / "out" / "rims.ply").read_bytes() == expected
    assert "order of their stamps" in err
    assert err.count("\n") == 1
    assert json.loads((tmp_path / "out" / "report.json").read_text())["drops"] == {}


def test_in_a_short_bag_poses_may_come_last(replay, messages, tmp_path):
    few = messages[:24]
    poses = [m for m in few if m.topic == "/camera_pose"]
    few = [m for m in few if m not in poses] + [m._replace(time_ns=10**12) for m in poses]
    code, text, err = replay(write_all(tmp_path / "bag", few), tmp_path / "out")
    assert (code, err) == (0, "")
    assert "8 images, 8 contours, 8 rims" in text


def test_images_whose_masks_never_come_are_not_held_back_for_longer_than_the_tracker_waits(
    messages,
):
    """It gives up those of more than 10 stamps; each has an image, a pose, a camera_info."""
    masks = [later(m._replace(topic="/mask"), 7) for m in messages if m.topic == "/image"]
    mixed = sorted([*messages, *masks], key=lambda m: m.time_ns)
    waiting = {m.topic: 0 for m in mixed}
    for message, whole in companions_first(mixed, masks=True):
        assert not whole
        waiting[message.topic] += 1
        assert waiting["/camera_pose"] - waiting["/image"] <= 9
    assert waiting["/image"] == FRAMES


def test_an_hour_between_two_images_is_no_reason_to_wait(replay, messages, tmp_path, monkeypatch):
    """The tracker keeps a frame far ahead until the next has come: nothing comes of it before."""
    hour = 3_600_000_000_000
    late = [m for k, m in enumerate(messages) if k >= len(messages) // 2]
    moved = [later(m, hour)._replace(time_ns=m.time_ns + hour) for m in late]
    waits, wait = [], drive.Feed.wait

    def noted(feed, stamp, whole):
        waits.append(whole)
        wait(feed, stamp, whole)

    monkeypatch.setattr(drive.Feed, "wait", noted)
    bag = write_all(tmp_path / "bag", [*messages[: -len(late)], *moved])
    code, text, err = replay(bag, tmp_path / "out")
    assert (code, err) == (0, "")
    assert ALL in text
    assert "nothing came" not in text
    assert [k for k, whole in enumerate(waits) if not whole] == [FRAMES // 2]


def test_images_that_still_wait_at_the_end_are_dropped_by_name(replay, messages, tmp_path):
    lacking = [m for k, m in enumerate(messages) if m.topic != "/camera_pose" or k < 24]
    code, text, _ = replay(write_all(tmp_path / "bag", lacking), tmp_path / "out")
    assert code == 0
    assert "contour_tracker dropped 4: no_camera_pose" in text
    assert "4 of 12 images gave no outline: 4 had no camera_pose" in text
    assert "nothing came" not in text
