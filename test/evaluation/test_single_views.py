"""Outlines of single images that nothing contradicts, and that leave less of a body than they
show."""

from stalks import views_of_stalks

from msg_adapters import View
from occ_recon_ros.evaluation.alone import each_alone


class Views(list):
    """What is asked of a recording."""

    def masked(self):
        return False


def alone(**spoilt):
    pairs = enumerate(views_of_stalks(**spoilt), 1)
    views = Views(View(k, camera, image, None) for k, (camera, image) in pairs)
    return each_alone(views, lambda *_: None)


def test_poses_that_are_off_by_little_are_no_reason_to_doubt_images():
    # Views that are 3 px apart contradict each other nowhere, and leave a fifth of the stalks out.
    found = alone(off_px=2.0)
    assert not found.doubts
    assert len(found.agreeing) == len(found.cameras) == 8


def test_what_images_lack_is_doubted_in_corrected_poses_too():
    found = alone(bitten=True)
    assert "the body that all outlines leave covers" in found.doubts[-1]
    assert not found.agreeing
    assert not found.cameras
