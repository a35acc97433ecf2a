"""Soft shadow on the ground, told from the object; outlines along its border."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.imaging.joint.colours import COUNT, colour_bins, histogram
from occ_recon_ros.imaging.joint.edges import SOME_WITHOUT_EDGE, faint, in_small, small_contrast
from occ_recon_ros.imaging.joint.shadow import in_shadow, soft_shadow
from occ_recon_ros.scene import coverage

HEIGHT, WIDTH = 150, 200
ANGLE = np.linspace(0, 2 * np.pi, 200, endpoint=False)
Y, X = np.mgrid[:HEIGHT, :WIDTH]
DEPTH = np.exp(-(((X - 100) / 50.0) ** 2) - ((Y - 95) / 22.0) ** 2)  # of the shadow


def disc(radius):
    return coverage(
        [np.array([100, 70]) + radius * np.column_stack([np.cos(ANGLE), -np.sin(ANGLE)])],
        WIDTH,
        HEIGHT,
    )


def photograph(ground, colour=(40, 150, 90), dark=0.6):
    """A green disc on even ground, in a shadow that is darkest at its foot."""
    floor = np.array(ground, float) * (1 - dark * DEPTH)[..., None]
    image = floor + (np.array(colour, float) - floor) * disc(30)[..., None]
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    image += np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def shadow_in(image, enlarged=1.0):
    bins = colour_bins(image)
    open_ground = (DEPTH < 0.01) & (disc(34) == 0)
    shaded = in_shadow(histogram(bins[open_ground]))
    return soft_shadow(cv2.medianBlur(image, 5), bins, open_ground, shaded, enlarged)


@pytest.mark.parametrize("ground", [(222, 226, 228), (150, 90, 50)], ids=["white", "blue"])
def test_soft_shadow_is_found_and_the_object_in_it_is_not(ground):
    found = shadow_in(photograph(ground))
    beside = (disc(34) == 0) & (DEPTH > 0.05)
    assert np.mean(found[beside]) > 0.95
    assert np.mean(found[disc(28) == 1]) < 0.01


def test_a_part_of_the_colour_of_shadow_behind_an_edge_is_no_shadow():
    image = photograph((220, 220, 220), colour=(110, 110, 110), dark=0.0)
    assert np.mean(shadow_in(image)[disc(28) == 1]) < 0.01


def test_a_soft_outline_at_which_the_hue_turns_is_an_edge():
    image = photograph((90, 130, 160), colour=(150, 150, 150), dark=0.0)
    image = cv2.GaussianBlur(image, (0, 0), 3)
    image[:20] = 190  # a wall, of which the disc has the colour in shadow
    assert np.mean(shadow_in(image)[disc(24) == 1]) < 0.01


def test_an_edge_is_as_much_flatter_as_its_image_was_blown_up():
    image = photograph((220, 220, 220), colour=(110, 110, 110), dark=0.0)
    image = cv2.GaussianBlur(image, (0, 0), 6)
    assert np.mean(shadow_in(image, enlarged=1.0)[disc(20) == 1]) > 0.9
    assert np.mean(shadow_in(image, enlarged=2.0)[disc(20) == 1]) < 0.01


def test_a_dark_backdrop_shows_no_shadow():
    assert in_shadow(histogram(colour_bins(np.full((9, 9, 3), 14, np.uint8)))) is None
    assert in_shadow(np.zeros(COUNT)) is None


def test_an_outline_along_the_border_of_a_shadow_is_without_an_edge():
    image = photograph((222, 226, 228))
    right = (255 * (disc(30) > 0.5)).astype(np.uint8)
    with_shadow = np.where(DEPTH > 0.3, np.uint8(255), right)
    views = [small_contrast(*in_small(image, mask)) for mask in (right, with_shadow)]
    share = faint(views)
    assert share[0] < 0.5 * SOME_WITHOUT_EDGE
    assert share[1] > 2 * SOME_WITHOUT_EDGE
