"""When masks are found again in corrected cameras, and which of the two are taken."""

from types import SimpleNamespace

import numpy as np
import pytest

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.second_look import SecondLook

MASKS, CAMERAS, AGAIN = (
    {1: np.zeros((2, 2), np.uint8)},
    {1: object()},
    {1: np.ones((2, 2), np.uint8)},
)


class Masks:
    """Stands for a Segmentation: what it would report, and which views it was shown."""

    def __init__(self, report, later=None):
        self.report, self.later, self.seen = report, later, []

    def anew(self):
        return self.later

    def __call__(self, views, progress):
        self.seen.append(views.changes)
        return Changes(masks=AGAIN)


@pytest.mark.parametrize(
    ("before", "corrected", "after", "taken"),
    [
        ({"belief": 0.6}, ["common"], {"belief": 0.98}, True),
        ({"warnings": ["none to be believed"]}, ["poses"], {"belief": 0.5}, True),
        ({"belief": 0.6}, ["common"], {"belief": 0.5}, False),
        ({"belief": 0.6}, ["common"], {"warnings": ["none to be believed"]}, False),
    ],
)
def test_masks_in_doubt_are_found_again_in_corrected_cameras(before, corrected, after, taken):
    first = Masks(before, Masks(after))
    views = SimpleNamespace(changes=Changes(MASKS, CAMERAS))
    step = SecondLook(first, SimpleNamespace(report={"corrected": corrected}))
    found = step(views, lambda *_: None)
    # Not the masks of before: they are as wrong as the poses were.
    assert first.later.seen == [Changes(cameras=CAMERAS)]
    assert views.changes == Changes(MASKS, CAMERAS)
    assert found == (Changes(masks=AGAIN) if taken else Changes())
    assert first.report.get("belief") == (after if taken else before).get("belief")
    assert first.report.get("in_corrected_cameras", False) is taken


@pytest.mark.parametrize(
    ("report", "corrected"), [({"way": "single"}, ["common"]), ({"belief": 0.6}, [])]
)
def test_what_is_sure_or_in_the_same_cameras_is_not_looked_at_again(report, corrected):
    views = SimpleNamespace(changes=Changes())
    step = SecondLook(Masks(report), SimpleNamespace(report={"corrected": corrected}))
    assert step(views, lambda *_: None) == Changes()
