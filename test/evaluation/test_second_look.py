"""When masks and cameras are found again, and which are taken."""

from types import SimpleNamespace

import numpy as np
import pytest

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.second_look import SecondLook

UNKNOWN = {"warnings": ["none to be believed"]}
MASKS = [{1: np.full((2, 2), k, np.uint8)} for k in range(9)]
CAMERAS = [{1: object()} for _ in range(9)]


class Looks:
    """Stands for Segmentation and Refine: what each look reports and finds; ``seen``: by which
    changes of the bag."""

    def __init__(self, reports, found, seen=None):
        self.seen = [] if seen is None else seen
        self.k = len(self.seen) + (seen is not None)
        self.report, self.reports, self.found = reports[self.k], reports, found

    def anew(self):
        return Looks(self.reports, self.found, self.seen)

    def __call__(self, views, progress):
        self.seen.append(views.changes)
        return self.found(self.k)


def doubtful(belief):
    return {"belief": belief, "warnings": ["much is faint"] * (belief < 0.95)}


def looked(beliefs, corrected=(True,) * 9, masked=False):
    """The looks at masks of such beliefs (reports where they are none), the looks at cameras,
    and what came of both."""
    reports = [b if isinstance(b, dict) else doubtful(b) for b in beliefs]
    masks = Looks(reports, lambda k: Changes(masks=MASKS[k]))
    poses = Looks(
        [{"look": k} for k in range(9)],
        lambda k: Changes(cameras=CAMERAS[k]) if corrected[k] else Changes(),
    )
    known = Changes(MASKS[0], CAMERAS[0] if corrected[0] else None)
    views = SimpleNamespace(changes=known, masked=lambda: masked)
    step = SecondLook(masks, poses)
    found = step(views, lambda *_: None)
    assert views.changes == known
    return step, masks, poses, found


@pytest.mark.parametrize("first", [0.6, UNKNOWN])
def test_masks_in_doubt_are_found_again_in_corrected_cameras_and_cameras_by_them(first):
    step, masks, poses, found = looked([first, 0.8, 0.98, 1.0])
    # Not from the masks of before: they are as wrong as the poses were. And not from corrected
    # cameras: how far they may be off is known of those that were given.
    assert masks.seen == [Changes(cameras=CAMERAS[0]), Changes(cameras=CAMERAS[1])]
    assert poses.seen == [Changes(masks=MASKS[1]), Changes(masks=MASKS[2])]
    assert found == Changes(MASKS[2], CAMERAS[2])
    assert step._masks.report == doubtful(0.98) | {"in_corrected_cameras": True}
    assert step._poses.report == {"look": 2}


@pytest.mark.parametrize("second", [0.5, UNKNOWN])
def test_masks_that_are_believed_less_are_not_taken(second):
    step, masks, _, found = looked([0.6, second])
    assert len(masks.seen) == 1
    assert found == Changes()
    assert step._masks.report == doubtful(0.6)


def test_cameras_stay_where_new_masks_ask_for_no_correction():
    step, _, _, found = looked([0.6, 0.8, 0.9], (True, False, False))
    assert found == Changes(masks=MASKS[1])
    assert step._poses.report == {"look": 0}


@pytest.mark.parametrize(
    ("first", "corrected", "masked"),
    [
        ({"way": "single"}, True, False),
        ({"belief": 0.8}, True, False),  # some views are bad, and are left out
        (0.97, True, False),
        (0.6, False, False),
        (0.6, True, True),
    ],
)
def test_what_is_sure_or_came_or_is_in_the_same_cameras_is_not_looked_at_again(
    first, corrected, masked
):
    _, masks, _, found = looked([first, 0.99], (corrected,), masked)
    assert masks.seen == []
    assert found == Changes()
