"""Strays are told from time that jumped back, and a new scan loses no frame."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from occ_recon_ros.streams.scan_order import ScanOrder


class Feed:
    def __init__(self, **settings):
        self.drops = []
        self.order = ScanOrder(lambda reason, item: self.drops.append((reason, item)), **settings)
        self.scans = [[]]

    def add(self, *stamps):
        for stamp in stamps:
            new, due = self.order.add(stamp, stamp)
            if new:
                self.scans.append([])
            self.scans[-1] += due
        return self


def test_what_comes_in_order_goes_through_at_once():
    assert Feed().add(1, 2, 5).scans == [[1, 2, 5]]


def test_a_stray_is_dropped_by_name_when_the_next_one_comes():
    feed = Feed().add(10, 20, 30, 20, 40, 15, 50)
    assert feed.scans == [[10, 20, 30, 40, 50]]
    assert feed.drops == [("duplicate", 20), ("out_of_order", 15)]


def test_a_loop_of_the_same_stamps_is_a_new_scan_that_loses_nothing():
    feed = Feed().add(10, 20, 30, 40, 10, 20, 30, 40, 50)
    assert feed.scans == [[10, 20, 30, 40], [10, 20, 30, 40, 50]]
    assert not feed.drops


def test_old_stamps_that_do_not_rise_are_no_new_scan():
    feed = Feed().add(10, 20, 30, 40, 20, 20, 10, 50)
    assert feed.scans == [[10, 20, 30, 40, 50]]
    assert [reason for reason, _ in feed.drops] == ["duplicate"] * 3


def test_one_stamp_far_ahead_is_a_stray_and_no_new_scan():
    feed = Feed(far=1000).add(10, 20, 9000, 30, 40, 50, 60)
    assert feed.scans == [[10, 20, 30, 40, 50, 60]]
    assert feed.drops == [("far_ahead", 9000)]


def test_stamps_that_go_on_far_ahead_lose_nothing():
    feed = Feed(far=1000).add(10, 20, 9000, 9010, 9020, 99_000, 99_010)
    assert feed.scans == [[10, 20, 9000, 9010, 9020, 99_000, 99_010]]
    assert not feed.drops


def test_time_that_goes_back_after_a_stamp_far_ahead_is_a_new_scan():
    feed = Feed(far=1000).add(10_000, 10_010, 20_000, 10, 20, 30, 40)
    assert feed.scans == [[10_000, 10_010], [10, 20, 30, 40]]
    assert feed.drops == [("far_ahead", 20_000)]


@given(st.lists(st.integers(0, 10**6), max_size=60))
def test_after_any_stream_with_leaps_a_good_scan_passes_whole(stamps):
    feed = Feed(far=1000).add(*stamps)
    good = list(range(2_000_000, 2_000_020))
    assert feed.add(*good).scans[-1][-20:] == good
    assert sum(map(len, feed.scans)) + len(feed.drops) == len(stamps) + 20


@given(st.lists(st.integers(0, 30), max_size=60))
def test_every_item_goes_through_is_dropped_or_waits_and_scans_rise(stamps):
    feed = Feed().add(*stamps)
    for scan in feed.scans:
        assert all(a < b for a, b in pairwise(scan))
    passed = sum(map(len, feed.scans))
    assert 0 <= len(stamps) - passed - len(feed.drops) < 3


@given(st.lists(st.integers(0, 10**6), max_size=60))
def test_after_any_stream_a_good_scan_passes_whole(stamps):
    feed = Feed().add(*stamps)
    good = list(range(2_000_000, 2_000_020))
    assert feed.add(*good).scans[-1][-20:] == good


@given(st.lists(st.integers(100, 10**6), max_size=60))
def test_after_any_stream_an_earlier_good_scan_passes_whole(stamps):
    feed = Feed().add(*stamps, 10**6 + 1)  # the last of them gives up what waited aside
    good = list(range(20))
    assert feed.add(*good).scans[-1] == good
