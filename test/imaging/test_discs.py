"""The measuring tool of the contour tests, checked against analytic area and moments."""

import numpy as np
import pytest
from discs import coverage, ellipse_error, photograph


@pytest.mark.parametrize(("a", "b", "angle"), [(8.0, 8.0, 0.0), (60.3, 31.7, 0.7)])
def test_coverage_has_the_area_and_moments_of_the_ellipse(a, b, angle):
    centre = np.array([70.3, 64.8])
    share = coverage((130, 140), centre, np.array([a, b]), angle)
    y, x = np.mgrid[:130, :140]
    assert share.sum() == pytest.approx(np.pi * a * b, rel=2e-5)
    assert (share * x).sum() / share.sum() == pytest.approx(centre[0], abs=2e-3)
    assert (share * y).sum() / share.sum() == pytest.approx(centre[1], abs=2e-3)
    # Integrating over a pixel adds nothing to the cross moment.
    xy = (share * (x - centre[0]) * (y - centre[1])).sum() / share.sum()
    assert xy == pytest.approx((a * a - b * b) * np.sin(2 * angle) / 8, abs=2e-2)


def test_blur_leaves_the_mean_grey_value():
    share = coverage((100, 100), np.array([50.2, 49.1]), np.array([20.0, 20.0]), 0.0)
    sharp, soft = photograph(share, blur=0), photograph(share, blur=2.0)
    assert soft.mean() == pytest.approx(sharp.mean(), abs=0.02)


def test_ellipse_error_is_the_distance_along_the_normal():
    t = np.linspace(0, 2 * np.pi, 50)
    radii, angle, centre = np.array([90.0, 30.0]), 0.4, np.array([5.0, 7.0])
    e = np.column_stack([radii[0] * np.cos(t), radii[1] * np.sin(t)])
    n = np.column_stack([np.cos(t) / radii[0], np.sin(t) / radii[1]])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    c, s = np.cos(angle), np.sin(angle)
    points = (e + 1.3 * n) @ np.array([[c, s], [-s, c]]) + centre
    np.testing.assert_allclose(ellipse_error(points, centre, radii, angle), 1.3, atol=1e-9)
