"""Whose fault it is that neighbours see their points apart: the outlines' or the poses'."""

import pytest
from exact_turns import exact_turn

from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.verdict import judge

OFF_PX = 2.6
VIEWS = 16


def judged(**changes):
    contours = exact_turn("figure", VIEWS)[2]
    return judge(Evidence(contours, (), VIEWS, 0.8, bounded=True, pose_error_px=OFF_PX, **changes))


@pytest.mark.parametrize(("given", "advised"), [(True, "smooth outlines"), (False, "sharper")])
def test_poses_that_outlines_agree_on_are_not_blamed_for_ragged_ones(given, advised):
    # K, D and poses were to be checked, which had just been corrected to 0.4 px.
    verdict = judged(refined=True, left_px=0.41, left_sigmas=0.94, given=given)
    assert verdict.word == "doubtful"
    (reason,), (advice,) = verdict.reasons, verdict.advice
    assert reason.startswith("the outlines are ragged or noisy by about 2.6 px")
    assert "poses agree with them to 0.4 px" in reason
    assert advised in advice
    assert "refine" not in advice


def test_poses_that_outlines_do_not_agree_on_are_blamed():
    (reason,) = judged(refined=True, left_px=2.5, left_sigmas=4.0).reasons
    assert reason.startswith("poses or calibration are off by about 2.6 px")


def test_who_may_have_corrected_them_before_is_told_what_else_it_can_be():
    verdict = judged()
    assert verdict.reasons[0].startswith("poses or calibration are off by about 2.6 px")
    assert verdict.advice[0] == (
        "correct them by the contours: --refine; if that was done, the outlines are ragged or noisy"
    )
