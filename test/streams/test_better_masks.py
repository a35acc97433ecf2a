"""Which masks of all views together are taken."""

import pytest

from occ_recon_ros.imaging.joint import JointMasks
from occ_recon_ros.imaging.joint.judge import ViewReport
from occ_recon_ros.streams.together import better


def masks(belief, support):
    return JointMasks("joint", belief, (), (ViewReport(1.0, support, 0.0, ""),) * 9, (), None, ())


@pytest.mark.parametrize(
    ("belief", "other", "alone", "guessed"),
    [
        (0.60, 0.55, True, False),  # a jug on a table: its foot was lost
        (0.93, 0.72, True, False),
        (0.60, 0.39, True, True),  # which were not used
        (0.80, 0.55, True, True),
        (1.00, 0.58, True, True),  # a person before a lit floor
        (1.00, 0.96, True, True),
        (0.55, 0.60, False, False),
        (0.60, 1.00, False, False),
    ],
)
def test_masks_from_outlines_that_contradict_each_other_have_to_end_a_doubt(
    belief, other, alone, guessed
):
    one, two = masks(belief, 0.8), masks(other, 0.8)
    assert better(one, two) is alone
    assert better(one, two, guessed=True) is guessed


@pytest.mark.parametrize("guessed", [True, False])
def test_of_masks_that_are_believed_as_much_those_clearly_more_confirmed_are_taken(guessed):
    assert better(masks(1.0, 0.95), masks(1.0, 0.93), guessed)
    assert not better(masks(1.0, 0.935), masks(1.0, 0.93), guessed)
