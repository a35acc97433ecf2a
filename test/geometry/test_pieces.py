"""Outlines of several pieces of surface: a match stays on its own piece."""

from dataclasses import replace

import numpy as np
import pytest
from spheres import Sphere

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.belief import contradicts_neighbour
from occ_recon_ros.geometry.links import long_links
from occ_recon_ros.geometry.quadric import Crossing
from occ_recon_ros.geometry.rim import empty_rim
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras


def test_no_match_passes_the_corner_where_two_pieces_of_the_outline_meet():
    """The hole of a torus is bounded by its near and its far side. Beside the corners where
    they meet, a piece is hidden in one of the partners, and the other lies in its place."""
    torus = make_object("torus")
    cameras = turntable_cameras(TurntableSettings(elevation=np.radians(35), frames=7))
    views = [torus.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(cameras)]
    reconstructor = RimReconstructor(RimSettings(baseline=0.17))
    rims = {rim.stamp_ns: rim for c in views for rim in reconstructor.add(c)}
    errors = []
    for view in views[2:-2]:
        rim, depth = rims[view.stamp_ns], torus.exact_depth(view)[0]
        found = np.linalg.norm(rim.points - view.centre, axis=1)
        errors.append((found - depth)[rim.status == Status.GOOD])
    error = np.abs(np.concatenate(errors))
    print(f"{len(error)} good points, depth error at most {1e3 * error.max():.2f} mm")
    assert len(error) > 1500
    assert error.max() < 3e-3


@pytest.mark.parametrize(("name", "first", "size"), [("mug", 11, 0.09), ("figure", 11, 0.2)])
def test_a_piece_that_is_hidden_in_one_partner_is_not_taken_for_the_one_that_hides_it(
    name, first, size
):
    """A handle before a body, limbs before each other: all silhouettes may hold a point of
    the wrong match, but not the rim of the other partner."""
    thing = make_object(name)
    cameras = turntable_cameras(TurntableSettings())[first : first + 7]
    views = [thing.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(cameras)]
    reconstructor = RimReconstructor()
    rims = [rim for c in views for rim in reconstructor.add(c)] + reconstructor.finish()
    # The last frames on either side lack the views that tell.
    rims = [{rim.stamp_ns: rim for rim in rims}[stamp] for stamp in (3, 4, 5)]
    good = [rim.points[rim.status == Status.GOOD] for rim in rims]
    away = np.abs(thing.distance(np.concatenate(good)))
    share = len(away) / sum(len(rim) for rim in rims)
    print(f"{name}: {share:.1%} good, at most {1e3 * away.max():.2f} mm from the surface")
    assert share > 0.8
    assert away.max() < 0.01 * size


def test_long_links_lead_to_where_their_positions_say_also_past_the_last_row():
    camera = turntable_cameras(TurntableSettings())[0]
    contours = make_object("vase").exact_contours(camera, stamp_ns=1)
    points = contours.centre + contours.T
    n = len(points)
    prev = np.arange(n) + 0.5
    prev[-2:] = n, np.nan  # the whole step from the last row to the first
    moved = points.copy()
    moved[-2] += 1.0
    links = long_links(moved, replace(empty_rim(contours), points=points), prev, contours)
    assert links.rows.tolist() == [n - 2]
    np.testing.assert_allclose(links.middle[0], (moved[-2] + points[contours.next_row[-1]]) / 2)


def test_a_neighbour_allows_what_its_own_circle_may_bend_by_at_any_step():
    contours = Sphere(np.zeros(3), 0.2).contours(np.array([1.3, 0.0, 0.3]), 200)
    sin, d = np.sin(np.deg2rad([10.0, 20.0])), np.full(2, 1.2)
    cross = Crossing(d, sin, sin, np.ones(2), d)

    def contradicted(off, their_radius):
        """Of points on a flat that is met in the place of what is hidden."""
        q, sigma = np.full(2, 0.3), np.full(2, 1e-5)
        there = np.full(2, 0.5 * their_radius)
        return contradicts_neighbour(contours, cross, d + off, q, sigma**2, d, there, sigma**2)

    # An arm 8 mm in radius cannot be 10 mm away from its circle, a trunk of 15 cm can.
    assert contradicted(0.01, 0.008).all()
    assert contradicted(0.01, 0.15).tolist() == [True, False]
    assert not contradicted(0.5 * 0.008 * sin**2, 0.008).any()
