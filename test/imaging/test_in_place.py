"""What stands still in all views, and is taken along by one trial and left out by another."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.imaging.joint.in_place import told_in_place
from occ_recon_ros.imaging.joint.judge import ViewReport
from occ_recon_ros.imaging.joint.masks import JointMasks

SIZE = 400, 300
VIEWS = 12
Y, X = np.mgrid[: SIZE[1], : SIZE[0]]
WINDOW = 60, 30, 340, 270


def found(stand, moves=0.0):
    """Masks of a bar that turns, and of what is below it, if that is taken along."""
    report, masks = ViewReport(1.0, 1.0, 0.0, ""), []
    for k in range(VIEWS):
        turn = 2 * np.pi * k / VIEWS
        wide = 30 + 60 * abs(np.cos(turn))
        mask = (np.abs(X - 200) < wide) & (np.abs(Y - 110) < 60)
        foot = (np.abs(X - 200 - moves * np.cos(turn)) < 25) & (Y >= 170) & (Y < 230)
        masks.append((mask | (foot & stand))[30:270:2, 60:340:2])
    views = (report,) * VIEWS
    return JointMasks("joint", 1.0, (), views, tuple(masks), None, (WINDOW,) * VIEWS)


def test_a_stand_that_is_left_out_is_doubted():
    told = told_in_place(found(False), [found(True)], SIZE)
    assert told.belief == pytest.approx(0.65)
    assert "stands still was left out, " in told.warnings[0]
    assert "in one trial by 18% of their area: " in told.warnings[0]
    assert not told.notes


def test_a_stand_that_is_taken_along_is_said():
    told = told_in_place(found(True), [found(False)], SIZE)
    assert told.belief == 1.0
    assert not told.warnings
    assert "15% of the area of the masks stands still" in told.notes[0]
    assert "was taken along" in told.notes[0]


def test_a_stand_that_is_left_out_counts_before_what_is_taken_along():
    nothing = replace(found(False), small=tuple(np.zeros_like(m) for m in found(False).small))
    told = told_in_place(found(False), [nothing, found(True)], SIZE)
    assert told.belief == pytest.approx(0.65)


def test_what_moves_is_no_stand():
    """A leg that one trial lost was looked for by the other."""
    masks = found(False)
    assert told_in_place(masks, [found(True, moves=60.0)], SIZE) is masks


def test_trials_that_agree_say_nothing():
    masks = found(True)
    assert told_in_place(masks, [found(True)], SIZE) is masks
    assert told_in_place(masks, [], SIZE) is masks
