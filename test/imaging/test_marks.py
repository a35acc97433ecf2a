"""Bends of an outline: which may be the rim of a smooth surface, and how well it is known there."""

import numpy as np
import pytest
from discs import camera_for, coverage, ellipse_error, photograph

from occ_recon_ros.imaging import ContourTracker

SHAPE = (240, 320)


def contours_of(share, blur):
    image = photograph(share, blur=blur, noise=2.0)
    contours = ContourTracker().process(image, camera_for(image), 0, "turntable")
    return contours.uv, contours.sigma / contours.radians_per_pixel


@pytest.mark.parametrize("blur", [0.7, 1.5])
def test_where_one_disc_ends_before_another_nothing_may_be_made(blur):
    left, right, radius = np.array([120.3, 120.6]), np.array([200.4, 120.6]), np.array([55.0, 55.0])
    share = coverage(SHAPE, left, radius, 0.0) + coverage(SHAPE, right, radius, 0.0)
    uv, sigma = contours_of(np.minimum(share, 1.0), blur)
    half = 0.5 * (right - left)[0]
    rise = np.sqrt(55.0**2 - half**2)
    crossings = np.array([[left[0] + half, 120.6 - rise], [left[0] + half, 120.6 + rise]])
    away = np.linalg.norm(uv[:, None] - crossings, axis=2)
    assert np.isinf(sigma[away.argmin(axis=0)]).all()
    away = away.min(axis=1)
    assert np.isfinite(sigma[away > 5]).all()
    error = np.where(
        uv[:, 0] < left[0] + half,
        ellipse_error(uv, left, radius, 0.0),
        ellipse_error(uv, right, radius, 0.0),
    )
    seen = np.isfinite(sigma)
    assert (np.abs(error[seen]) < 5 * sigma[seen]).all()


@pytest.mark.parametrize("blur", [0.7, 1.5])
def test_a_tight_tip_is_known_less_well_but_known(blur):
    centre, radii = np.array([160.3, 120.7]), np.array([80.0, 15.0])  # radius 2.8 px at the tips
    uv, sigma = contours_of(coverage(SHAPE, centre, radii, 0.0), blur)
    assert np.isfinite(sigma).all()
    tip = np.abs(uv[:, 0] - centre[0]) > 76
    assert np.median(sigma[tip]) > 2 * np.median(sigma[~tip])
    error = ellipse_error(uv, centre, radii, 0.0)
    assert (np.abs(error) < 4.5 * sigma).all()
    assert 0.5 < np.std(error[tip] / sigma[tip]) < 1.5
