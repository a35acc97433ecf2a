"""The numbers of messages tell how many never came, whoever sends beside."""

from collections import Counter

import pytest

from occ_recon_ros.streams.loss import LossCount


def taken(*numbers):
    """The count after numbers of one topic, and how many were missing before each."""
    loss = LossCount()
    return loss, [loss.take("image", number)[0] for number in numbers]


def test_gaps_are_counted_but_not_what_came_before_the_first():
    loss, missing = taken(5, 6, 9, 10)
    assert missing == [0, 0, 2, 0]
    assert loss.missed == Counter(image=4)
    assert loss.last("image") == 10


@pytest.mark.parametrize("start", [1, 40])
def test_two_publishers_by_turns_lose_nothing_nor_does_the_one_that_stays(start):
    both = [n for k in range(20) for n in (300 + k, start + k)]
    loss, missing = taken(*both, *range(320, 330))
    assert sum(missing) == 0
    assert loss.restarts == Counter(image=1)


def test_publishers_that_began_together():
    loss, missing = taken(*(n for k in range(1, 10) for n in (k, k)), 12)
    assert sum(missing) == 2
    assert loss.restarts == Counter(image=1)


def test_what_one_of_two_loses_is_missing():
    assert taken(300, 1, 301, 2, 305, 3)[1] == [0, 0, 0, 0, 3, 0]


def test_a_publisher_that_is_started_again_begins_anew_however_often():
    loss, missing = taken(*([*range(50, 60), *range(1, 8)] * 3))
    assert loss.restarts["image"] >= 1
    assert sum(missing) <= 3 * 43


def test_another_publisher_is_told_of_with_each_change():
    loss = LossCount()
    assert [loss.take("image", n)[1] for n in (300, 5, 301, 6, 7)] == [
        False,
        True,
        False,
        True,
        False,
    ]
