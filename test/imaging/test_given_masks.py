"""Masks that others made: of 0 and 1, of 0 and 255, and of 8 bits of coverage."""

import numpy as np
import pytest
from discs import camera_for, coverage, ellipse_error, photograph

from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker, mask_coverage

SHAPE, CENTRE, RADII, ANGLE = (240, 320), np.array([158.3, 121.7]), np.array([90.0, 61.0]), 0.4
SHARE = coverage(SHAPE, CENTRE, RADII, ANGLE)


def errors(image, mask, **settings):
    found = ContourTracker(ContourSettings(**settings)).process(
        image, camera_for(image), 1, "turntable", mask
    )
    seen = np.isfinite(found.sigma)
    return ellipse_error(found.uv[seen], CENTRE, RADII, ANGLE), found.sigma[seen]


def test_coverage_gives_outlines_finer_than_pixels_where_the_image_shows_none():
    even = np.full(SHAPE, 100, np.uint8)
    graded = np.rint(255 * SHARE).astype(np.uint8)
    error, _ = errors(even, graded)
    assert np.abs(error).mean() < 0.04
    assert np.abs(error).max() < 0.2
    coarse, _ = errors(even, np.where(graded > 127, 255, 0).astype(np.uint8))
    assert np.abs(error).mean() < np.abs(coarse).mean()


def test_coverage_is_believed_before_an_edge_beside_it():
    image = photograph(coverage(SHAPE, CENTRE, RADII + 0.6, ANGLE))
    error, _ = errors(image, np.rint(255 * SHARE).astype(np.uint8))
    assert np.abs(error).mean() < 0.05


def test_a_mask_of_numbers_is_the_object_wherever_it_is_above_0():
    numbered = np.where(SHARE > 0.5, 1 + (np.arange(SHAPE[1]) > 150), 0).astype(np.uint8)
    assert (mask_coverage(numbered) == np.where(SHARE > 0.5, 255, 0)).all()
    error, _ = errors(photograph(SHARE), numbered)
    assert np.abs(error).mean() < 0.05


def test_a_faint_mask_is_no_object():
    faint = np.zeros(SHAPE, np.uint8)
    faint[0, 0], faint[50:90, 50:90] = 255, 100
    with pytest.raises(ContourError) as error:
        errors(photograph(SHARE), faint)
    assert error.value.reason == "no_object"


@pytest.mark.parametrize("tracking", ["snake", "none"])
@pytest.mark.parametrize("inside", [0, 255], ids=["inverted", "all white"])
@pytest.mark.parametrize("of_numbers", [False, True])
def test_a_mask_that_is_white_around_is_named(tracking, inside, of_numbers):
    mask = np.where(SHARE > 0.5, inside, 255).astype(np.uint8)
    if of_numbers:
        mask = mask // 255
    with pytest.raises(ContourError, match="white all along the border: the object must") as error:
        errors(photograph(SHARE), mask, tracking=tracking)
    assert error.value.reason == "no_object"
