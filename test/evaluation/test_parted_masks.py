"""What is said of masks some of which hold a part that the others leave out."""

import numpy as np
import pytest
from exact_turns import exact_turn

from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.verdict import judge
from occ_recon_ros.surface.agreement import Agreement

VIEWS = 16


def judged(large, by=0.5, least=0.0, lacks=0.0, given=True):
    """The verdict on a turn whose first views hold so much more than the others."""
    contours = exact_turn("figure", VIEWS)[2]
    refuted = np.full(VIEWS, least)
    refuted[:large] = by
    refutes = np.zeros(VIEWS)
    refutes[-1] = lacks
    agreement = Agreement(refuted, refutes, np.zeros(VIEWS, np.bool_))
    # No body covers both.
    iou = np.where(np.arange(VIEWS) < large, 0.5, 0.98)
    return judge(
        Evidence(
            contours, (), VIEWS, 0.8, agreement=agreement, body_iou=iou, given=given, bounded=True
        )
    )


@pytest.mark.parametrize(
    ("large", "said"),
    [
        (2, "2 of 16 masks hold what the others leave out, 50% of a mask: 0, 1"),
        (7, "7 of 16 masks hold what the others leave out, 50% of a mask: 0, 1, 2, 3, 4, 5, 6"),
        (8, "8 of 16 masks hold what the others leave out, 50% of a mask, as many as do not: 0, "),
        (10, "6 of 16 masks leave out what the others hold, 50% of these: 10, 11, 12, 13, 14, 15"),
    ],
)
def test_a_part_that_some_masks_hold_is_said_and_whose_and_is_no_failure(large, said):
    # A right body was called failed, and K, D and poses were blamed.
    verdict = judged(large)
    assert verdict.word == "doubtful"
    (reason,), (advice,) = verdict.reasons, verdict.advice
    assert reason.startswith(said)
    assert "add it to the masks that leave it out" in advice


@pytest.mark.parametrize(
    "changes", [{"large": VIEWS}, {"lacks": 0.1}, {"by": 0.05, "least": 0.019}, {"given": False}]
)
def test_outlines_that_disagree_otherwise_contradict_each_other(changes):
    verdict = judged(**{"large": 8, **changes})
    assert verdict.word == "failed"
    assert "contradict the others (by 5" in verdict.reasons[0]


def test_masks_that_lack_a_part_at_one_place_are_named_and_no_pose_is_blamed():
    # Legs that a network lost: it was said that views contradict each other, or K, D and poses
    # were to be checked.
    refutes, refuted = np.zeros(VIEWS), np.zeros(VIEWS)
    refutes[[3, 7, 10]], refuted[12] = [0.013, 0.018, 0.043], 0.03
    local = np.ones(VIEWS, np.bool_)
    contours = exact_turn("figure", VIEWS)[2]

    def said(agreement):
        evidence = Evidence(contours, (), VIEWS, 0.8, agreement=agreement, given=True, bounded=True)
        return judge(evidence)

    verdict = said(Agreement(refuted, refutes, local))
    assert verdict.word == "doubtful"
    short, rest = verdict.reasons
    assert short.startswith("3 of 16 masks leave out, at one place, what the others hold, up to 4%")
    assert short.endswith(": 3, 7, 10")
    assert rest == "1 of 16 views contradict the others, by up to 3%: 12"
    assert "K, D" not in " ".join(verdict.advice)
    # So many that nobody can tell.
    verdict = said(Agreement(np.full(VIEWS, 0.03), refutes, local))
    assert verdict.word == "failed"
    assert verdict.reasons[0].endswith("most of them at one place")
    assert "K, D" not in " ".join(verdict.advice)
