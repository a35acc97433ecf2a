"""Outlines of single images that nothing contradicts, and that leave less of a body than they
show."""

import pytest
from pits import views_of_pits
from stalks import views_of_stalks

from msg_adapters import View
from occ_recon_ros.evaluation.alone import each_alone


class Views(list):
    """What is asked of a recording."""

    def masked(self):
        return False


def alone(pairs):
    views = Views(View(k, camera, image, None) for k, (camera, image) in enumerate(pairs, 1))
    return each_alone(views, lambda *_: None)


def test_poses_that_are_off_by_little_are_no_reason_to_doubt_images():
    # Views that are 3 px apart contradict each other nowhere, and leave a fifth of the stalks out.
    found = alone(views_of_stalks(off_px=2.0))
    assert not found.doubts
    assert len(found.agreeing) == len(found.cameras) == 8


def test_what_images_lack_is_doubted_in_corrected_poses_too():
    found = alone(views_of_stalks(bitten=True))
    assert "the body that all outlines leave covers" in found.doubts[-1]
    assert not found.agreeing
    assert not found.cameras


@pytest.mark.parametrize("pitted", [False, True])
def test_holes_that_carve_nothing_others_need_are_doubted_where_others_show_a_surface(pitted):
    found = alone(views_of_pits(pitted))
    assert bool(found.agreeing) != pitted
    assert [doubt.split(" outlines, which")[0].split(" of 12")[-1] for doubt in found.doubts] == (
        [""] * pitted
    )
    assert not found.cameras
