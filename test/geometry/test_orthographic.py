"""The limit of a long focal length: Giblin and Weiss 1987, orthographic views and planar motion.

There, with h the distance of the tangent line whose normal has the angle theta (the support
function), the rim point lies h' along the ray and the radius of curvature is h + h''.
"""

from dataclasses import replace

import numpy as np
import pytest
from spheres import Sphere, ring

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.estimators import ESTIMATORS, Rays

A, B = 0.3, 0.2  # half axes of an ellipse, metres
THETA = 0.7


def support(theta):
    return np.sqrt((A * np.cos(theta)) ** 2 + (B * np.sin(theta)) ** 2)


def ray(theta, distance):
    """The ray that grazes the ellipse where its normal has that angle, from far away."""
    N = np.array([np.cos(theta), np.sin(theta), 0])
    T = np.array([-np.sin(theta), np.cos(theta), 0])
    return Rays(support(theta) * N - distance * T, T[None], N[None], np.array([1e-9]))


def estimated(name, step, distance):
    rays = [ray(THETA + k * step, distance) for k in (0, -1, 1)]
    found = ESTIMATORS[name](rays[0], rays[1:])
    return found.depth[0] - distance, 1 / found.curvature[0]


@pytest.mark.parametrize("distance", [2.0, 1e3, 1e6])
@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_the_estimators_are_their_differences_of_the_support_function(name, distance):
    step = np.radians(10)
    before, here, after = support(THETA + step * np.array([-1, 0, 1]))
    depth, radius = estimated(name, step, distance)
    assert depth == pytest.approx(
        (after - before) / (2 * np.sin(step)), abs=1e-16 * distance + 1e-9
    )
    bend = after + before - 2 * here * np.cos(step)
    expected = bend / (2 - 2 * np.cos(step)), bend * np.cos(step) / np.sin(step) ** 2
    # A circle, or the parabola that the paper takes for it.
    assert any(radius == pytest.approx(r, rel=1e-6 + 1e-14 * distance) for r in expected)


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_they_tend_to_the_derivatives_as_the_step_falls(name):
    e = 1e-4
    before, here, after = support(THETA + e * np.array([-1, 0, 1]))
    slope, bend = (after - before) / (2 * e), (after - 2 * here + before) / e**2
    errors = []
    for step in np.radians([8, 4]):
        depth, radius = estimated(name, step, 1e4)
        errors.append([abs(depth - slope), abs(radius - (here + bend))])
    assert (np.divide(*errors) > 3.5).all()
    assert errors[1][0] < 1e-3 * B


@pytest.mark.parametrize("factor", [1.0, 50.0, 1000.0])
def test_a_scan_from_afar_is_as_good_as_one_from_near(factor):
    sphere = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)
    centres = ring(np.radians([0, 10, 23]), distance=1.3 * factor, height=0.3 * factor)
    contours = [sphere.contours(C, 1500, stamp_ns=k + 1) for k, C in enumerate(centres)]
    contours = [replace(c, uv=factor * c.uv) for c in contours]
    reconstructor = RimReconstructor(RimSettings(baseline=0.12))
    (rim,) = [rim for c in contours for rim in reconstructor.add(c)]
    good = rim.status == Status.GOOD
    assert good.mean() > 0.9
    depth = np.einsum("nk,nk->n", rim.points - contours[1].centre, contours[1].T)
    error = np.abs(depth - sphere.depth(contours[1].centre))[good]
    print(f"{factor:g} times as far: median depth error {1e3 * np.median(error):.4f} mm")
    assert np.median(error) < 1e-3
    assert np.nanmedian(rim.curvature[good]) == pytest.approx(1 / 0.2, rel=0.05)
