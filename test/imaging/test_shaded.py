"""An object whose own shades are many, before a backdrop that has one."""

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.imaging.chroma import chroma_mask, discriminant
from occ_recon_ros.imaging.segment import threshold_mask
from occ_recon_ros.imaging.segmenter import Segmenter, best_segmentation
from occ_recon_ros.imaging.settings import ContourError
from occ_recon_ros.imaging.window import Window
from occ_recon_ros.scene import (
    RenderSettings,
    TurntableSettings,
    make_object,
    render,
    turntable_cameras,
)

ROWS, COLUMNS = 240, 320


def ball(radius, dark, light, backdrop, noise=1.5, fold=0.0):
    """A lit ball and its exact mask; a soft fold hangs beside it."""
    y, x = np.mgrid[:ROWS, :COLUMNS].astype(float)
    u, v = (x - 160) / radius, (y - 120) / radius
    inside = u**2 + v**2 < 1
    depth = np.sqrt(np.maximum(1 - u**2 - v**2, 0))
    lit = np.clip(0.3 * depth - 0.8 * u - 0.5 * v, 0, 1)
    behind = backdrop + fold * np.exp(-(((x - 40) / 15) ** 2))
    image = np.where(inside, dark + (light - dark) * lit, behind)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    image += noise * np.random.default_rng(0).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), inside


def iou(mask, truth):
    return np.count_nonzero((mask > 0) & truth) / np.count_nonzero((mask > 0) | truth)


@pytest.mark.parametrize("radius", [12, 80])
def test_its_dark_side_is_kept(radius):
    # Otsu's level divides the ball itself: a third of it was lost.
    image, truth = ball(radius, dark=55.0, light=200.0, backdrop=40.0)
    assert iou(threshold_mask(image), truth) > (0.85 if radius == 12 else 0.97)
    negative = 255 - image
    assert iou(threshold_mask(negative), truth) > (0.85 if radius == 12 else 0.97)


def test_a_soft_fold_of_the_backdrop_is_not_taken_with_it():
    image, truth = ball(80, dark=55.0, light=200.0, backdrop=20.0, fold=14.0)
    mask = threshold_mask(image)
    assert not mask[:, :80].any()
    assert iou(mask, truth) > 0.5  # as Otsu's level gives it


def test_an_image_whose_colour_says_nothing_is_not_lost():
    grey, truth = ball(30, dark=90.0, light=220.0, backdrop=40.0)
    coloured = np.dstack([grey // 3, grey // 2, grey])
    coloured[~truth] = 40
    segmenter = Segmenter(ContourSettings())
    window = Window.of(coloured, ContourSettings())
    segmenter.mask(coloured, None, window)
    assert segmenter.chosen == "chroma"
    noise = 3 * np.random.default_rng(1).standard_normal((ROWS, COLUMNS, 3))
    image = np.clip(grey[..., None] + noise, 0, 255).astype(np.uint8)
    with pytest.raises(ContourError):
        chroma_mask(image)
    assert iou(segmenter.mask(image, None, window), truth) > 0.95
    with pytest.raises(ContourError):
        Segmenter(ContourSettings(segmentation="chroma")).mask(image, None, window)


@pytest.mark.parametrize("quality", [95, 90, 50])
def test_what_jpeg_strews_about_an_edge_is_no_object(quality):
    # A plain backdrop has no noise once it is compressed, but 16 px about an edge its colour
    # wavers: outlines ran up to 13 px beside the object.
    gourd = make_object("gourd")
    (camera,) = turntable_cameras(
        TurntableSettings(frames=1, width=320, height=240, focal_px=400.0)
    )
    image = render(gourd, camera, RenderSettings(encoding="bgr8"))
    code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    seen = [
        ContourTracker(ContourSettings(segmentation="chroma")).process(shown, camera, 0, "object")
        for shown in (image, cv2.imdecode(code, cv2.IMREAD_COLOR))
    ]
    away = cKDTree(seen[0].uv).query(seen[1].uv)[0]  # and along: samples are a pixel apart
    assert away.max() < 0.8
    assert len(np.unique(seen[1].loop)) == 1


@pytest.mark.parametrize("quality", [95, 85, 60])
def test_whole_levels_in_the_dark_are_no_colour(quality):
    # A wall of 14 levels, bluish by one: of steps of a level colour made an object, 57
    # standard deviations away from a backdrop that showed no noise.
    grey, thing = ball(50, dark=90.0, light=220.0, backdrop=14.0, noise=0.5)
    image = np.dstack([grey] * 3)
    image[~thing & (np.arange(COLUMNS) % 90 < 45)] += np.array([1, 0, 0], np.uint8)
    image[thing] = (image[thing] * [0.93, 0.98, 1.0]).astype(np.uint8)
    image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 1)
    assert best_segmentation(image) == "threshold"
    assert iou(threshold_mask(image), thing) > 0.9


def test_a_coloured_plate_is_not_taken_for_the_grey_thing_that_stands_on_it():
    # Colour alone shows the plate, and no surface came of it.
    grey, thing = ball(50, dark=120.0, light=220.0, backdrop=40.0)
    image = np.dstack([grey] * 3)
    plate = np.zeros(thing.shape, np.uint8)
    cv2.ellipse(plate, (160, 165), (110, 40), 0, 0, 360, 1, -1)
    below = (plate > 0) & ~thing
    image[below] = (30, 100, 190)
    assert iou(chroma_mask(image), below) > 0.95
    assert best_segmentation(image) == "threshold"
    assert iou(threshold_mask(image), below | thing) > 0.95


def test_the_shadow_of_a_coloured_thing_is_not_taken_with_it():
    # It is a part of what is darker than the backdrop, and colour is right to leave it out.
    grey, thing = ball(50, dark=90.0, light=150.0, backdrop=200.0)
    image = np.dstack([grey] * 3)
    image[thing] = (0.3, 0.5, 1.0) * image[thing]
    shadow = np.zeros(thing.shape, np.uint8)
    cv2.ellipse(shadow, (215, 165), (70, 20), 0, 0, 360, 1, -1)
    image[(shadow > 0) & ~thing] //= 2
    assert best_segmentation(image) == "chroma"


def test_before_retouched_white_what_is_light_grey_is_of_the_object_too():
    # Colour alone took the black and tan leather of a shoe, and left out its shiny toe.
    grey, thing = ball(50, dark=35.0, light=60.0, backdrop=255.0, noise=0.5)
    image = np.dstack([grey] * 3)
    heel, toe = thing & (np.arange(COLUMNS) < 140), thing & (np.arange(COLUMNS) > 175)
    image[heel] = (60, 140, 200)
    image[toe] = (225, 222, 220)
    assert iou(chroma_mask(image), thing & ~toe) > 0.95
    assert best_segmentation(image) == "threshold"
    found = threshold_mask(image) > 0
    assert not (thing & ~found).any()
    near = cv2.dilate(thing.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert not (found & ~near).any()  # the lens blurs by as much


def two_colours(second: tuple[int, int, int], noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture of an object whose left half has a second colour, and where the object is."""
    rng = np.random.default_rng(1)
    inside = np.zeros((110, 110), bool)
    inside[30:80, 25:75] = True
    colour = np.where(inside[..., None], [60, 80, 150], [90, 120, 60])
    colour[30:80, 25:50] = second
    light = rng.uniform(0.6, 1.4, (110, 110, 1))
    image = np.clip(light * colour + rng.normal(0, noise, colour.shape), 0, 255)
    return image.astype(np.uint8), inside


@pytest.mark.parametrize(
    ("second", "noise", "error", "wrong"),
    [((60, 80, 150), 1.5, 1e-6, 0), ((80, 106, 92), 1, 0.05, 8)],
)
def test_colours_are_told_apart_along_fishers_direction(second, noise, error, wrong):
    """The direction of the true classes, with their covariances by NumPy; a second colour near the
    backdrop's needs all three rounds."""
    image, inside = two_colours(second, noise)
    blue, green, red = image.reshape(-1, 3).T.astype(float)
    shares = np.stack([red, blue]) / (blue + green + red + 40)
    one, two = shares[:, inside.ravel()], shares[:, ~inside.ravel()]
    spread = 0.5 * (np.cov(one) + np.cov(two)) + 2e-6 * np.eye(2)
    expected = np.linalg.solve(spread, one.mean(axis=1) - two.mean(axis=1))
    w, limit, separation = discriminant(image)
    np.testing.assert_allclose(w, expected, rtol=error)
    assert np.count_nonzero((w @ shares > limit) != inside.ravel()) <= wrong
    z_in, z_out = w @ one, w @ two
    deviation = 1.4826 * np.median(np.abs(z_out - np.median(z_out)))
    expected = (np.median(z_in) - np.median(z_out)) / deviation
    if not wrong:  # else it is of the medians of the round before
        assert separation == pytest.approx(expected, rel=1e-6)
    assert np.count_nonzero((chroma_mask(image) > 0) != inside) <= wrong
