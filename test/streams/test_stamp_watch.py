"""Stamps that are late, told from those of another clock."""

import pytest

from occ_recon_ros.streams.stamp_watch import StampWatch

S = 1_000_000_000
NOW = 1_700_000_000 * S
YEAR = 365 * 86_400 * S


def why(part, off_ns, images=25, gap_ns=None):
    """What is said of a topic whose stamps are off by so much, 10 images a second."""
    watch = StampWatch()
    for k in range(images):
        watch.note("image", NOW + k * S // 10)
        watch.note(part, NOW + k * S // 10 + off_ns)
    return watch.why([part], 10, gap_ns)


@pytest.mark.parametrize("part", ["camera_info", "camera_pose"])
@pytest.mark.parametrize(("off_s", "side"), [(-30, "30 s behind"), (30, "30 s ahead of")])
def test_another_clock(part, off_s, side):
    words = f"the stamps of {part} are {side} those of the images: another clock"
    assert words in why(part, off_s * S)
    assert words in why(part, off_s * S, gap_ns=S // 10)


@pytest.mark.parametrize("part", ["camera_info", "camera_pose"])
@pytest.mark.parametrize("images", [2, 5, 15, 25])
def test_another_epoch_is_told_at_once_and_without_a_number_of_years(part, images):
    words = why(part, -40 * YEAR, images, S // 10)
    assert "of another clock than those of the images" in words
    assert "sync_queue" not in words
    assert "e+" not in words


def test_poses_that_come_late_need_a_longer_queue_and_nothing_is_said_too_soon():
    assert why("camera_pose", -3 * S // 2, 25, S // 10).endswith("set it to 30")
    assert not why("camera_pose", -3 * S // 2, 12, S // 10)


@pytest.mark.parametrize("part", ["camera_info", "camera_pose", "mask"])
@pytest.mark.parametrize(
    ("by_s", "words"),
    [
        (3600, "3600 s ahead of"),
        (0.3, "300 ms ahead of"),
        (-0.3, "300 ms behind"),
        (-60, "60 s behind"),
    ],
)
def test_a_clock_that_jumps_in_mid_scan_is_named_with_how_much(part, by_s, words):
    watch = StampWatch()
    for k in range(18):
        watch.note("image", NOW + k * S // 4)
        watch.note(part, NOW + k * S // 4 + (int(by_s * S) + 7 if k > 12 else 0))
    said = watch.why([part], 10)
    assert f"the stamps of {part} have jumped: they are {words} those" in said


def test_masks_that_come_late_or_for_every_second_image_are_no_other_clock():
    late, half = StampWatch(), StampWatch()
    for k in range(30):
        for watch in (late, half):
            watch.note("image", NOW + k * S // 4)
        if k >= 16:
            late.note("mask", NOW + (k - 16) * S // 4)
        if k % 2:
            half.note("mask", NOW + k * S // 4)
    assert "mask comes 4.00 s after its image" in late.why(["mask"], 10)
    assert half.why(["mask"], 10) == ""


MS = 1_000_000


def rate_of_their_own(change, paused=lambda t: False):
    """A watch of 10 s, images each 250 ms and poses each 50 ms that come as they are stamped."""
    watch = StampWatch()
    for t in range(0, 10_000, 50):
        if not paused(t):
            watch.note("camera_pose", (t + change(t)) * MS)
        if t % 250 == 0:
            watch.note("image", t * MS)
    return watch


@pytest.mark.parametrize(
    ("by", "words"), [(500, "ahead by 500 ms"), (-3_600_000, "back by 3600 s")]
)
def test_a_clock_of_poses_that_leaps_is_told(by, words):
    watch = rate_of_their_own(lambda t: by if t >= 5000 else 0)
    assert words in watch.leap()
    for t in range(10_000, 100_000, 50):
        watch.note("camera_pose", (t + by) * MS)
    assert words in watch.leap()  # however long the scan goes on


def test_poses_that_pause_or_come_late_have_not_leapt():
    assert not rate_of_their_own(lambda t: 0).leap()
    assert not rate_of_their_own(lambda t: 0, lambda t: 4000 < t < 5000).leap()
    assert not rate_of_their_own(lambda t: -100 * (t % 3 == 0)).leap()
