"""Contours and rims of two scans are told apart, whichever comes first."""

import pytest

from occ_recon_ros.streams.epochs import Epochs


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def fed(epochs, stamps):
    return [item for stamp in stamps for item in epochs.add(stamp, stamp)]


def test_items_of_the_next_scan_wait_for_it_to_begin(clock):
    epochs = Epochs(clock)
    assert fed(epochs, [10, 11, 12]) == [10, 11, 12]
    epochs.add_end(3)
    assert fed(epochs, [3, 4, 13]) == []
    assert epochs.begin() == [3, 4, 13]
    assert fed(epochs, [14]) == [14]


def test_items_of_the_scan_that_is_over_are_left_out(clock):
    epochs = Epochs(clock)
    assert fed(epochs, [10, 11]) == [10, 11]
    assert epochs.begin() == []
    assert fed(epochs, [12]) == []  # the other topic had been quicker
    epochs.add_end(3)
    assert fed(epochs, [3, 4]) == [3, 4]


def test_a_jump_without_an_end_is_seen_from_three_stamps(clock):
    epochs = Epochs(clock)
    fed(epochs, [10, 11, 12])
    assert fed(epochs, [1, 2, 3, 4]) == []
    assert epochs.begin() == [1, 2, 3, 4]


@pytest.mark.parametrize("ahead", [True, False])
def test_a_beginning_that_never_comes_is_not_waited_for_for_ever(clock, ahead):
    epochs = Epochs(clock)
    fed(epochs, [10])
    if ahead:
        epochs.add_end(3)
    else:
        epochs.begin()
    assert fed(epochs, [13]) == []
    assert epochs.overdue() == []
    clock.now = 6.0
    assert epochs.overdue() == ([13] if ahead else [])
    assert fed(epochs, [14]) == [14]
