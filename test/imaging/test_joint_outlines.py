"""Where the object ends before a dark backdrop, and which of the pixels on its edge are its own."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from occ_recon_ros.imaging.joint.finer import partly_covered
from occ_recon_ros.imaging.joint.light import empty_scene, excess_light, is_clean
from occ_recon_ros.scene import coverage

HEIGHT, WIDTH = 120, 160
RADII = 30.0, 120.0  # px
ANGLE = np.linspace(0, 2 * np.pi, 600, endpoint=False)


def covered(radius):
    """What a disc covers of each pixel of a picture around it, of 4 to 3."""
    width, height = int(WIDTH * radius / 30.0), int(HEIGHT * radius / 30.0)
    middle = np.array([width, height]) / 2
    rim = middle + radius * np.column_stack([np.cos(ANGLE), -np.sin(ANGLE)])
    return coverage([rim], width, height)


DISCS = {radius: covered(radius) for radius in RADII}
DISC = DISCS[30.0]


def photograph(inside, outside, seed=0, noise=1.5, disc=DISC):
    """A disc before a backdrop, blurred as by a lens, with noise."""
    image = outside + (np.asarray(inside, float) - outside) * disc[..., None]
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("off", [-1, 0, 1])
@pytest.mark.parametrize(
    ("inside", "outside"),
    [((150, 150, 150), (12, 12, 12)), ((60, 40, 190), (60, 160, 40)), ((90, 90, 90), (240,) * 3)],
    ids=["light before black", "red before green", "dark before white"],
)
def test_the_outline_does_not_depend_on_the_rough_one_and_is_within_a_fifth_of_a_pixel(
    inside, outside, off, radius
):
    disc = DISCS[radius]
    rough = (disc > 0.5).astype(np.uint8)
    square = np.ones((3, 3), np.uint8)
    rough = {-1: cv2.erode, 0: cv2.erode, 1: cv2.dilate}[off](rough, square, iterations=abs(off))
    image = photograph(inside, np.array(outside, float), disc=disc)
    found = partly_covered(rough > 0, image)
    assert np.sqrt(np.count_nonzero(found) / np.pi) == pytest.approx(radius, abs=0.2)


def test_the_dim_edge_of_a_ball_that_is_lit_from_the_camera_is_its_own_before_black():
    height, width = DISCS[120.0].shape
    y, x = np.mgrid[:height, :width] + 0.5
    away = np.hypot(x - width / 2, y - height / 2) / 120.0
    light = 3 + 190 * np.sqrt(np.clip(1 - away**2, 0, 1))
    image = photograph(np.repeat(light[..., None], 3, axis=2), 3.0, disc=DISCS[120.0])
    found = partly_covered(DISCS[120.0] > 0.5, image)
    assert np.sqrt(np.count_nonzero(found) / np.pi) == pytest.approx(120.0, abs=0.5)


def test_an_outline_without_contrast_stays():
    rough = cv2.dilate((DISC > 0.5).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    np.testing.assert_array_equal(partly_covered(rough, photograph((30,) * 3, 30.0)), rough)


@pytest.fixture(scope="module")
def dark():
    """A disc in the middle of all views, five grey levels lighter than its backdrop on one side
    and as the backdrop on the other; the backdrop itself is lit unevenly, and flickers."""
    x = np.arange(WIDTH)
    outside = (10 + 4 * x / WIDTH)[None, :, None] * np.ones((HEIGHT, 1, 3))
    lit = np.where(x < 80, 5.0, 0.0)[None, :, None]
    images = [
        cv2.medianBlur(photograph(outside + lit, outside + (k % 3), seed=k), 5) for k in range(8)
    ]
    beyond = cv2.dilate((DISC > 0).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    return SimpleNamespace(images=images, beyond=beyond, x=x)


def test_a_few_grey_levels_tell_a_dark_object_from_a_dark_backdrop(dark):
    scene = empty_scene(dark.images, [dark.beyond] * 8)
    assert scene is not None
    excess = excess_light(dark.images[3], scene, dark.beyond)
    lit = (DISC > 0.99) & (dark.x < 76)
    assert np.mean(excess[lit] > 20) > 0.95
    assert np.mean(excess[dark.beyond] > 20) < 0.002
    assert is_clean(dark.images, scene, [dark.beyond] * 8)


def test_cloth_that_moves_is_no_clean_backdrop(dark):
    images = []
    for k, image in enumerate(dark.images):
        moved = image.copy()
        moved[:, 12 * k + 4 : 12 * k + 14] += 12
        images.append(moved)
    scene = empty_scene(images, [dark.beyond] * 8)
    assert scene is not None
    assert not is_clean(images, scene, [dark.beyond] * 8)


def test_the_blur_beside_a_bright_object_is_no_light_of_its_own(dark):
    image = cv2.medianBlur(photograph((220,) * 3, 12.0), 5)
    scene = empty_scene(dark.images, [dark.beyond] * 8)
    ring = (DISC == 0) & (cv2.dilate((DISC > 0).astype(np.uint8), np.ones((5, 5))) > 0)
    assert np.mean(excess_light(image, scene, dark.beyond)[ring] > 20) < 0.1


def test_views_of_different_size_have_no_scene_in_common(dark):
    images = [*dark.images[:7], dark.images[7][:, :-2]]
    assert empty_scene(images, [dark.beyond] * 8) is None
