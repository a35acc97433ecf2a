"""A page is sent what is new, and the whole only now and then."""

import numpy as np

from occ_recon_ros.surface import Strip
from occ_recon_ros.viewer.live_surface import LiveSurface
from occ_recon_ros.viewer.patch import merged


def strip(stamp, triangles=100, shift=0.0):
    corners = np.random.default_rng(stamp).random((triangles, 3, 3), np.float32) + shift
    return Strip(stamp, "turntable", corners, corners, corners[..., 0])


def whole(stamp, triangles):
    return strip(stamp, triangles)


class Page:
    """What somebody sees who has applied all changes, and what was sent to that end."""

    def __init__(self, surface):
        self.surface, self.there, self.sent = surface, {}, 0

    def apply(self, now):
        for change in self.surface.changes(now):
            if change.patch is None:
                del self.there[change.name]
            else:
                self.there[change.name] = change.patch
                self.sent += len(change.patch)

    @property
    def triangles(self):
        return sum(map(len, self.there.values()))


def test_a_strip_is_seen_without_the_whole():
    surface = LiveSurface()
    page = Page(surface)
    surface.add(merged(strip(1)), 0.0)
    page.apply(0.0)
    assert page.triangles == 100
    page.apply(0.2)
    assert page.sent == 100  # and not sent twice


def test_the_whole_takes_the_place_of_the_strips_in_it():
    surface = LiveSurface()
    page = Page(surface)
    for stamp in (1, 2, 3):
        surface.add(merged(strip(stamp)), 0.0)
        page.apply(0.0)
    surface.replace(whole(2, 180))  # two points were taken back since
    page.apply(0.1)
    assert page.triangles == 180 + 100


def test_the_whole_comes_when_all_is_quiet():
    surface = LiveSurface()
    page = Page(surface)
    surface.replace(whole(1, 1000))
    page.apply(0.0)
    surface.add(merged(strip(2)), 1.0)
    surface.replace(whole(2, 1090))
    page.apply(1.1)
    assert page.triangles == 1100  # not worth it yet
    page.apply(3.0)
    assert page.triangles == 1090


def test_a_turning_table_sends_each_triangle_a_few_times_and_keeps_few_pieces():
    surface = LiveSurface()
    page = Page(surface)
    produced = 0
    for k in range(1500):
        surface.add(merged(strip(k, 20)), 0.1 * k)
        produced += 20
        if k % 10 == 9:
            surface.replace(whole(k, min(produced, 10_000)))
        page.apply(0.1 * k)
    assert page.sent < 8 * produced
    assert len(page.there) < 70
    assert page.triangles < 1.3 * 10_000


def test_a_new_scan_clears_the_page():
    surface = LiveSurface()
    page = Page(surface)
    surface.replace(whole(100, 500))
    page.apply(0.0)
    surface.add(merged(strip(101)), 0.1)
    page.apply(0.1)
    surface.clear()
    assert surface.latest() is None
    surface.add(merged(strip(5)), 0.2)  # its stamps may be earlier
    page.apply(0.2)
    assert page.triangles == 100


def test_an_empty_whole_clears_it_too():
    surface = LiveSurface()
    page = Page(surface)
    surface.replace(whole(100, 500))
    page.apply(0.0)
    surface.replace(whole(0, 0))
    page.apply(0.1)
    assert page.there == {}
