"""The numbers of a run."""

import numpy as np
import pytest

from occ_recon_ros.geometry import Status
from occ_recon_ros.report.heard import Heard, Sent
from occ_recon_ros.report.numbers import summarise


def turned(at_rest: int, without_rim: int = 0) -> Heard:
    """36 frames of 100 samples each, half of them good, and more of the last; metres."""
    heard = Heard()
    counts = np.zeros(len(Status), np.int64)
    counts[Status.GOOD] = counts[Status.NO_CORRESPONDENT] = 50
    for k in range(36 + at_rest):
        angle = np.deg2rad(10 * min(k, 35))
        heard.centres[k] = np.array([2 * np.cos(angle), 2 * np.sin(angle), 0.7])
        heard.samples[k], heard.loops[k] = 100, 1
        if without_rim <= k < 36:
            heard.statuses[k] = counts
    return heard


@pytest.mark.parametrize("at_rest", [0, 1, 9])
def test_a_table_that_comes_to_rest_makes_a_scan_no_worse(at_rest):
    report = summarise(turned(at_rest), Sent(36 + at_rest), {})
    turn = report["turn"]
    assert (turn["covered_deg"], turn["mean_step_deg"], turn["closed"]) == (360.0, 10.0, True)
    assert turn["usual_step_deg"] == pytest.approx(10)
    assert turn["views_follow_each_other"]
    assert report["samples"]["fraction_good"] == 0.5
    assert report["samples"]["of_a_table_at_rest"] == 100 * at_rest
    assert len(report["per_frame"]) == 36 + at_rest


def test_frames_without_a_rim_elsewhere_count_as_not_good():
    report = summarise(turned(0, without_rim=6), Sent(36), {})
    assert report["samples"]["without_rim"] == 600
    assert report["samples"]["fraction_good"] == pytest.approx(0.5 * 30 / 36)


def test_frames_in_no_order_are_known_by_their_steps():
    heard = turned(0)
    mixed = np.random.default_rng(1).permutation(36)
    heard.centres = {k: heard.centres[int(other)] for k, other in enumerate(mixed)}
    turn = summarise(heard, Sent(36), {})["turn"]
    assert not turn["views_follow_each_other"]
    assert turn["usual_step_deg"] > 60
    assert turn["between_neighbours_deg"] == pytest.approx(10)
    assert turn["covered_deg"] == pytest.approx(360)


def test_views_added_to_a_whole_turn_leave_it_closed():
    heard = turned(0)
    for stamps, degrees in (
        ((*range(8),), 45.0 * np.arange(8)),
        ((8, 9, 10, 11), 27 + 91.0 * np.arange(4)),
    ):
        for k, angle in zip(stamps, np.deg2rad(degrees), strict=True):
            heard.centres[k] = np.array([2 * np.cos(angle), 2 * np.sin(angle), 0.7])
    for centres in (heard.samples, heard.loops, heard.statuses, heard.centres):
        for k in range(12, 36):
            centres.pop(k)
    turn = summarise(heard, Sent(12), {})["turn"]
    assert (turn["covered_deg"], turn["closed"]) == (360.0, True)


@pytest.mark.parametrize(("lost", "covered"), [(range(9, 16), 280), (range(9, 11), 330)])
def test_a_gap_in_the_middle_is_as_one_at_the_seam(lost, covered):
    heard = turned(0)
    for each in (heard.samples, heard.loops, heard.statuses, heard.centres):
        for k in lost:
            each.pop(k)
    turn = summarise(heard, Sent(36 - len(lost)), {})["turn"]
    assert (round(turn["covered_deg"]), turn["closed"]) == (covered, False)
    assert turn["gap_between_ns"] == [lost[0] - 1, lost[-1] + 1]


def test_what_is_missing_at_the_end_is_between_no_views():
    heard = turned(0)
    for each in (heard.samples, heard.loops, heard.statuses, heard.centres):
        for k in range(30, 36):
            each.pop(k)
    assert summarise(heard, Sent(30), {})["turn"]["gap_between_ns"] == []
