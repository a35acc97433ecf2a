"""Numbers that are missing in the names of photographs are found where the rest is a count."""

import pytest

from occ_recon_ros.bags.numbering import gaps_in


def test_numbers_that_are_missing_are_named_and_leave_their_places():
    names = ["a/b1_0007.jpg", "a/b1_0008.jpg", "a/b1_0010.jpg", "a/b1_0011.jpg"]
    found = gaps_in(names)
    assert list(found.places.values()) == [0, 1, 3, 4]
    assert found.missing == ("0009",)
    assert found.said() == "the names lack 0009"


def test_a_count_may_be_in_steps():
    found = gaps_in([f"{angle}.png" for angle in (0, 10, 20, 50, 60, 70)])
    assert list(found.places.values()) == [0, 1, 2, 5, 6, 7]
    assert found.said() == "the names lack 30, 40"


@pytest.mark.parametrize(
    "names",
    [
        [f"{k}.png" for k in range(6)],
        ["120301.jpg", "120306.jpg", "120312.jpg", "120317.jpg"],  # the time of day
        ["1_7.jpg", "2_8.jpg", "3_10.jpg"],
        ["a.jpg", "b.jpg", "d.jpg"],
        ["1.jpg", "2.jpg", "3a.jpg"],
        ["1.jpg", "2.jpg", "3.jpg", "90.jpg", "91.jpg"],
        ["1.jpg", "01.jpg", "3.jpg"],
        ["1.jpg", "3.jpg"],
    ],
)
def test_no_count_or_none_with_gaps(names):
    assert gaps_in(names) is None
