"""Masks as strangers keep them: soft, in parts, of another size, turned upright, white all over."""

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from occ_recon_ros.bags.mask_files import misdrawn, read_mask
from occ_recon_ros.errors import UserError


def disc(radius=20.5, soft=1.0):
    """(60, 80) coverage of a disc, whose edge is so many pixels wide."""
    v, u = np.mgrid[:60, :80]
    return np.clip(0.5 + (radius - np.hypot(u - 40, v - 30)) / soft, 0, 1)


def saved(path, levels):
    cv2.imwrite(str(path), np.asarray(levels).astype(np.uint8))
    return path


def test_the_transparency_of_an_image_is_its_mask(tmp_path):
    levels = np.array([[0, 60, 255], [0, 130, 255]], np.uint8)
    picture = np.dstack([np.full((2, 3, 3), 200, np.uint8), levels])
    cv2.imwrite(str(tmp_path / "alpha.png"), picture)
    np.testing.assert_array_equal(read_mask(tmp_path / "alpha.png"), levels)
    cv2.imwrite(str(tmp_path / "bits.png"), (levels > 100).astype(np.uint8))
    np.testing.assert_array_equal(read_mask(tmp_path / "bits.png"), 255 * (levels > 100))


@pytest.mark.parametrize(
    ("levels", "whole"),
    [
        ((1, 5, 18), True),  # numbers of arms, shirt and shoes
        ((60, 120, 255), True),  # colours of them
        ((2, 2, 1), True),
        ((255, 128, 255), True),
        ((255, 255, 255), False),
    ],
)
def test_where_parts_have_numbers_the_object_is_all_of_them(tmp_path, levels, whole):
    mask = np.zeros((60, 80), np.uint8)
    for k, level in enumerate(levels):
        mask[10:50, 10 + 20 * k : 30 + 20 * k] = level
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    found = read_mask(tmp_path / "m.png")
    np.testing.assert_array_equal(found > 0, mask > 0)
    np.testing.assert_array_equal(found, 255 * (mask > 0) if whole else mask)


def test_coverage_along_the_edges_of_a_mask_stays(tmp_path):
    v, u = np.mgrid[:60, :80]
    mask = np.clip(20.5 - np.hypot(u - 40, v - 30), 0, 1) * 200
    cv2.imwrite(str(tmp_path / "m.png"), mask.astype(np.uint8))
    found = read_mask(tmp_path / "m.png")
    assert found.max() == 255
    assert np.count_nonzero((found > 0) & (found < 255)) > 60


@pytest.mark.parametrize(("inner", "outer"), [(3, 0), (3, 3), (6, 12), (1, 1)])
def test_a_soft_matte_stays_one_though_its_ends_are_not_all_of_one_level(tmp_path, inner, outer):
    inside = disc(soft=6.0)
    waves = 0.5 + 0.5 * np.sin(np.arange(80) / 9.0)
    levels = np.where(inside > 0.5, 255 * inside - inner * waves, 255 * inside + outer * waves)
    found = read_mask(saved(tmp_path / "m.png", np.clip(np.rint(levels), 0, 255)))
    sure = np.abs(inside - 0.5) > 0.06
    np.testing.assert_array_equal((found > 127)[sure], (inside > 0.5)[sure])
    assert np.count_nonzero((found > 30) & (found < 225)) > 200


@pytest.mark.parametrize("band", [(128,), (85, 170)])
def test_a_border_where_nobody_knows_is_no_part(tmp_path, band):
    levels = 255 * (disc(16) > 0.5)
    for k, level in enumerate(band[::-1], 1):
        levels = np.where((levels == 0) & (disc(16 + 4 * k) > 0.5), level, levels)
    found = read_mask(saved(tmp_path / "m.png", levels))
    np.testing.assert_array_equal(found, levels)


@pytest.mark.parametrize("levels", [(52, 220), (38, 220), (147, 220), (5, 255)])
def test_a_brighter_border_around_an_object_of_a_number_is_cut_in_the_middle(tmp_path, levels):
    mask = np.select([disc(18) > 0.5, disc(22) > 0.5], levels, 0)
    found = read_mask(saved(tmp_path / "m.png", mask))
    assert set(np.unique(found)) == {0, 255}
    assert np.count_nonzero((found > 0) != (disc(20) > 0.5)) < 0.02 * disc(20).sum()


@pytest.mark.parametrize("quality", [30, 60, 95])
@pytest.mark.parametrize("level", [120, 200, 255])
def test_the_ripples_of_a_jpeg_are_no_border(tmp_path, level, quality):
    path, mask = tmp_path / "m.jpg", (level * disc(20)).astype(np.uint8)
    assert cv2.imwrite(str(path), mask, [cv2.IMWRITE_JPEG_QUALITY, quality])
    found = read_mask(path)
    assert np.count_nonzero((found > 127) != (disc(20) > 0.5)) < 0.03 * disc(20).sum()


def test_a_matte_that_is_thin_within_stays_one(tmp_path):
    levels = 255 * np.where(disc(12) > 0.5, 0.4, disc(20, soft=3.0))
    found = read_mask(saved(tmp_path / "m.png", levels))
    np.testing.assert_allclose(found, levels, atol=1)


def test_codes_of_grabcut_tell_the_object_by_odd_ones(tmp_path):
    codes = np.select([disc(12) > 0.5, disc(16) > 0.5, disc(25) > 0.5], [1, 3, 2], 0)
    found = read_mask(saved(tmp_path / "m.png", codes))
    np.testing.assert_array_equal(found, 255 * (disc(16) > 0.5))


def test_parts_of_all_that_is_in_the_picture_are_no_mask(tmp_path):
    levels = np.full((60, 80), 14)
    levels[20:] = 75  # the table
    levels[10:50, 30:50] = 113
    with pytest.raises(UserError, match="has no black"):
        read_mask(saved(tmp_path / "m.png", levels))


@pytest.mark.parametrize("size", [(160, 120), (40, 30), (80, 61)])
def test_a_mask_of_another_size_is_made_as_large_as_its_image(tmp_path, size):
    path = saved(tmp_path / "m.png", 255 * disc())
    found = read_mask(path, size)
    assert found.shape == size[::-1]
    wanted = disc(20.5).mean()
    assert abs((found > 127).mean() - wanted) < 0.03 * wanted
    with pytest.raises(
        UserError, match="is 80x60, its image 80x64: make it as large by taking back"
    ):
        read_mask(path, (80, 64))


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_mask_drawn_upright_is_turned_as_its_photograph_is_stored(tmp_path, orientation):
    stored = np.zeros((60, 80), np.uint8)
    stored[5:30, 8:60] = 255
    stored[30:40, 8:20] = 255
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    photograph = tmp_path / "a.jpg"
    Image.fromarray(stored).save(photograph, exif=exif, quality=95)
    upright = cv2.imread(str(photograph), cv2.IMREAD_GRAYSCALE)  # as programs that draw masks do
    assert upright.shape == (80, 60)
    path = saved(tmp_path / "m.png", 255 * (upright > 127))
    np.testing.assert_array_equal(read_mask(path, (80, 60), photograph), stored)
    with pytest.raises(UserError, match="is 60x80, its image 80x60"):
        read_mask(path, (80, 60))


def test_masks_of_no_object_are_told(tmp_path):
    mask = (255 * disc()).astype(np.uint8)
    assert misdrawn(mask) == ""
    assert "invert" in misdrawn(255 - mask)
    assert "white nearly everywhere" in misdrawn(np.full_like(mask, 255))


def test_a_mask_is_inverted_too_where_its_object_leaves_the_picture():
    v, u = np.mgrid[:60, :80]
    mask = np.uint8(255) * (np.hypot(u - 40, v - 45) < 20)  # cut by the lower edge
    assert misdrawn(mask) == ""
    assert "invert" in misdrawn(~mask)
    close = np.uint8(255) * (np.hypot(u - 40, v - 30) < 47)  # and one that leaves it all around
    close[58:, 20:60] = 0
    assert misdrawn(close) == ""
