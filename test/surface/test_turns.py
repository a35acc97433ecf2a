"""A table that goes on turning, or stops before a whole turn."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rims import SPHERE_RADIUS, sphere_turn
from spheres import Sphere, ring

from occ_recon_ros.geometry import RimReconstructor
from occ_recon_ros.surface import Surface

SAMPLES = 120


@cache
def rims_at(angles, noise=0.0):
    """Rims of a sphere from cameras at angles, degrees."""
    sphere = Sphere(np.zeros(3), SPHERE_RADIUS)
    centres = ring(np.radians(angles))
    reconstructor = RimReconstructor()
    contours = [sphere.contours(C, SAMPLES, stamp_ns=k + 1) for k, C in enumerate(centres)]
    return [rim for c in contours for rim in reconstructor.add(c)]


def surface_of(rims):
    surface = Surface()
    for rim in rims:
        (surface.revise if rim.stamp_ns in surface._placed else surface.add)(rim)
    return surface


def turns(count, step=10.0, offset=0.0):
    return tuple(np.arange(0, 360 * count + 20, step) + offset)


def test_more_turns_are_no_more_layers():
    one, four = surface_of(rims_at(turns(1))), surface_of(rims_at(turns(4, step=9.7)))
    # As many strips as a turn of such steps has, and one more on which the last lies in part.
    strip = len(one) / 35
    assert 360 / 9.7 * strip < len(four) < (360 / 9.7 + 1.1) * strip
    assert four.mesh().area < one.mesh().area * 37 / 35
    assert len(four.whole()) == len(four)
    # Corners of the strips of the last turn are there, none of the first is.
    points = {tuple(p) for p in four.mesh().vertices}
    rims = {rim.stamp_ns: rim for rim in rims_at(turns(4, step=9.7))}
    for stamp, there in ((15, False), (130, True)):
        good = rims[stamp].points[rims[stamp].status == 0]
        assert any(tuple(p) in points for p in good) is there


def test_turns_of_other_places_take_the_place_of_the_first():
    angles = (*np.arange(0.0, 360, 10), *np.arange(364.0, 750, 10))
    one, two = surface_of(rims_at(turns(1))), surface_of(rims_at(angles))
    assert len(two) == pytest.approx(len(one), rel=0.1)


def test_a_second_turn_of_finer_steps_refines_the_surface():
    coarse = surface_of(rims_at(turns(1)))
    fine = surface_of(rims_at((*np.arange(0.0, 360, 10), *np.arange(360.0, 745, 5))))
    away = [
        np.abs(np.linalg.norm(s.mesh().triangles_center, axis=1) - SPHERE_RADIUS)
        for s in (coarse, fine)
    ]
    assert len(fine) == pytest.approx(2 * len(coarse), rel=0.15)
    assert np.mean(away[1]) < 0.4 * np.mean(away[0])


@pytest.mark.slow
def test_memory_stops_growing_after_the_first_turn():
    """The rims of one turn again and again, with stamps of their own."""
    by_stamp = {rim.stamp_ns: rim for rim in sphere_turn()}
    surface, sizes, stamp = Surface(), [], 0
    for _ in range(20):
        for k in range(36):
            stamp += 1
            previous = stamp - 1 if stamp > 1 else None
            surface.add(replace(by_stamp[k + 1], stamp_ns=stamp, prev_stamp_ns=previous))
        sizes.append((len(surface), surface.nbytes, len(surface._placed)))
    triangles, size, rims_kept = np.array(sizes).T
    assert len(set(triangles[1:])) == 1
    # Of at most 50,000 triangles nothing is swept out.
    assert size.max() <= 4 * size[0] + 50_000 * 2 * (24 + 56)
    assert rims_kept.max() <= 38
    assert len(surface.mesh().faces) == len(surface)


def test_a_revision_of_a_rim_that_was_replaced_changes_nothing():
    rims = rims_at(turns(2))
    surface = surface_of(rims)
    assert surface.replaced(rims[5].stamp_ns)
    assert surface.revise(rims[5]) == 0
    with pytest.raises(ValueError, match="before"):
        surface.add(rims[5])


@pytest.mark.parametrize("degrees", [60, 180, 270])
def test_part_of_a_turn_gives_that_part_of_the_surface(degrees):
    part = surface_of(rims_at(tuple(np.arange(0.0, degrees + 1, 10))))
    whole = surface_of(rims_at(turns(1)))
    assert part.mesh().area == pytest.approx(whole.mesh().area * (degrees - 20) / 360, rel=0.06)


def test_a_step_forth_and_back_does_not_lose_what_is_there():
    angles = (*np.arange(0.0, 100, 10), 94.0, 104.0, *np.arange(110.0, 200, 10))
    shaken = surface_of(rims_at(angles))
    steady = surface_of(rims_at(tuple(np.arange(0.0, 200, 10))))
    assert shaken.mesh().area == pytest.approx(steady.mesh().area, rel=0.1)


def test_the_seam_of_a_turn_that_was_closed_too_early_takes_nothing_away():
    rims = rims_at(tuple(np.arange(0.0, 131, 10)))
    last, first = rims[-1], rims[0]
    surface = surface_of(rims)
    before = len(surface)
    late = replace(
        first, stamp_ns=999, prev_stamp_ns=last.stamp_ns, prev=np.full(len(first), np.nan)
    )
    surface.add(late)
    assert len(surface) == before
