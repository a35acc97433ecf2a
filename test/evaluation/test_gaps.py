"""What is said of a part of the turn that no view shows."""

import pytest

from occ_recon_ros.evaluation.advice import ROUND
from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.findings import DOUBTFUL, GOOD, of_turn


@pytest.mark.parametrize(("covered", "grade"), [(300.0, DOUBTFUL), (315.0, GOOD)])
def test_a_gap_no_wider_than_steps_may_be_is_noted(covered, grade):
    (found,) = of_turn(Evidence([], [], 12, 0.8, covered_deg=covered))
    assert found[0] == grade
    assert f"seen over {covered:.0f} of 360 degrees" in found[1]
    assert found[2] == (ROUND if grade == DOUBTFUL else "")


@pytest.mark.parametrize(("covered", "grade"), [(300.0, DOUBTFUL), (315.0, GOOD)])
def test_a_gap_inside_the_turn_is_told_by_the_views_on_both_sides(covered, grade):
    between = ("6.png", "8.png")
    (found,) = of_turn(Evidence([], [], 12, 0.8, covered_deg=covered, gap_between=between))
    assert found[0] == grade
    assert found[1].startswith(f"no view between 6.png and 8.png ({360 - covered:.0f} degrees): ")
    advice = "take images from there, or mend those that are there, or their masks"
    assert found[2] == (advice if grade == DOUBTFUL else "")
