"""Objects that hardly stand out, empty rigs, and regions of interest, in 8 and in 16 bits."""

import cv2
import numpy as np
import pytest
from discs import camera_for, coverage, ellipse_error

from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker

CENTRE, RADII = np.array([60.0, 45.0]), np.array([30.0, 24.0])
DISC = cv2.GaussianBlur(coverage((90, 120), CENTRE, RADII, 0.0), (0, 0), 1.0)
DEPTHS = {"8 bit": (1.0, 255), "16 bit": (257.0, 65535), "12 of 16 bit": (16.0, 4095)}


def contours(levels, depth, sigma=1.0, **settings):
    """Of an image in levels of 255, with noise of so many of them."""
    scale, most = DEPTHS[depth]
    noisy = levels + np.random.default_rng(1).normal(0, sigma, levels.shape)
    image = np.clip(np.round(scale * noisy), 0, most)
    image = image.astype(np.uint8 if most == 255 else np.uint16)
    return ContourTracker(ContourSettings(**settings)).process(image, camera_for(image), 1, "o")


def refused(*given, **settings):
    with pytest.raises(ContourError) as error:
        contours(*given, **settings)
    return error.value.reason


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("sigma", [0.3, 1.0, 4.0])
def test_an_empty_rig_gives_no_object_however_its_noise_is_spread(depth, sigma):
    assert refused(np.full((90, 120), 100.0), depth, sigma) == "no_object"


@pytest.mark.parametrize("depth", DEPTHS)
def test_light_that_fades_over_the_backdrop_is_no_object(depth):
    y, x = np.mgrid[:90, :120]
    fading = 100 - 9 * np.exp(-((x - 60) ** 2 + (y - 45) ** 2) / 2 / 20**2)
    assert refused(fading, depth, 0.3) == "no_object"


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("way", ["threshold", "background"])
def test_a_contrast_of_six_levels_that_clears_the_noise_is_taken(depth, way, tmp_path):
    settings = {"segmentation": way}
    if way == "background":
        scale, most = DEPTHS[depth]
        empty = np.full((90, 120), 100 * scale, np.uint8 if most == 255 else np.uint16)
        cv2.imwrite(str(tmp_path / "empty.png"), empty)
        settings["background_image"] = str(tmp_path / "empty.png")
    found = contours(100 + 6 * DISC, depth, 0.3, **settings)
    assert len(set(found.loop)) == 1
    away = np.abs(ellipse_error(found.uv, CENTRE, RADII, 0.0))
    assert np.median(away) < 0.3
    assert away.max() < 1.5


@pytest.mark.parametrize("depth", DEPTHS)
def test_what_lies_outside_of_the_region_of_interest_changes_nothing(depth):
    """A lamp and a black post beside the table would else set the threshold."""
    levels = 120 - 20 * DISC
    alone = contours(levels, depth, 0.0, roi_x=20, roi_width=80, segmentation="threshold")
    levels[:, :18], levels[:, 102:] = 255, 0
    beside = contours(levels, depth, 0.0, roi_x=20, roi_width=80, segmentation="threshold")
    np.testing.assert_allclose(beside.uv, alone.uv, atol=0.02)
