"""How many images of a scan were lost, and for what."""

from collections import Counter

from occ_recon_ros.streams.lost_images import LostImages


def lost(used, *reasons, before=()):
    images = LostImages()
    for reason in before:
        images.drop(reason)
    for _ in range(used):
        images.use()
    for reason in reasons:
        images.drop(reason)
    return images


def test_masks_for_every_second_image():
    images = lost(12, *["no_mask"] * 12)
    assert images.words(Counter()) == "12 of 24 images were lost: 12 had no mask"


def test_those_that_still_wait_are_lost_too_and_the_reason_is_said():
    images = lost(12, *["no_camera_pose"] * 2)
    images.why = "another clock"
    words = "12 of 24 images were lost: 12 had no camera_pose (another clock)"
    assert images.words(Counter(no_camera_pose=10)) == words


def test_a_few_are_no_matter_nor_what_was_dropped_before_the_scan_or_was_no_image_of_it():
    assert not lost(36, "no_mask").words(Counter(no_mask=1))
    assert not lost(36, before=["no_camera_pose"] * 99).words(Counter())
    assert not lost(36, *["second_publisher", "no_image"] * 50).words(Counter())
    assert not lost(0).words(Counter(no_camera_pose=9))
