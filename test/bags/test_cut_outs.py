"""Masks that are the photograph cut out on a plain colour."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.mask_files import read_mask, read_mask_as
from occ_recon_ros.errors import UserError


@pytest.fixture
def photograph(tmp_path):
    """(90, 120) of noise before other noise, its file, and where the object is, with a hole."""
    rng = np.random.default_rng(3)
    pixels = cv2.GaussianBlur(rng.integers(0, 256, (90, 120, 3)).astype(np.uint8), (0, 0), 2)
    pixels = cv2.convertScaleAbs(pixels, alpha=1.5, beta=-50)
    v, u = np.mgrid[:90, :120]
    inside = (np.hypot(u - 60, v - 45) < 32) & (np.hypot(u - 75, v - 45) > 8)
    pixels[~inside] = pixels[~inside] // 2 + 90
    pixels[40:44, 40:45] = 0  # within the object
    pixels[44:46, 92:97] = 0  # at its side, and beyond
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    return tmp_path / "a.png", pixels, inside


def cut(pixels, inside, colour=0, soft=0.0):
    share = inside.astype(np.float32)
    share = cv2.GaussianBlur(share, (0, 0), soft) if soft else share
    mixed = colour + share[:, :, None] * (pixels.astype(np.float32) - colour)
    return np.rint(mixed).astype(np.uint8), share


@pytest.mark.parametrize("colour", [0, 255])
def test_what_is_left_of_a_photograph_is_its_object(photograph, tmp_path, colour):
    file, pixels, inside = photograph
    cv2.imwrite(str(tmp_path / "m.png"), cut(pixels, inside, colour)[0])
    mask, cut_out = read_mask_as(tmp_path / "m.png", (120, 90), file)
    assert cut_out
    assert np.count_nonzero((mask > 127) != inside) < 10


def test_its_soft_edges_are_coverage(photograph, tmp_path):
    file, pixels, inside = photograph
    shown, share = cut(pixels, inside, soft=1.5)
    cv2.imwrite(str(tmp_path / "m.png"), shown)
    mask = read_mask(tmp_path / "m.png", (120, 90), file)
    usual = pixels.max(axis=2) > 60
    assert np.abs(mask / 255.0 - share)[usual].max() < 0.05


@pytest.mark.parametrize(("name", "scale"), [("m.jpg", 1.0), ("m.png", 0.5)])
def test_pressed_or_smaller_it_is_still_one(photograph, tmp_path, name, scale):
    file, pixels, inside = photograph
    shown = cv2.resize(cut(pixels, inside)[0], None, fx=scale, fy=scale, interpolation=3)
    cv2.imwrite(str(tmp_path / name), shown)
    mask, cut_out = read_mask_as(tmp_path / name, (120, 90), file)
    assert cut_out
    wrong = (mask > 127) != inside
    assert not wrong[cv2.erode(inside.astype(np.uint8), np.ones((5, 5))) > 0].any()
    assert np.count_nonzero(wrong) < 0.1 * np.count_nonzero(inside)


def test_masks_and_other_photographs_are_none(photograph, tmp_path):
    file, pixels, inside = photograph
    soft = cv2.GaussianBlur(255 * inside.astype(np.uint8), (0, 0), 1.5)
    others = np.where(inside[:, :, None], pixels[::-1, ::-1], 0)
    for shown in (soft, soft // 2, others):
        cv2.imwrite(str(tmp_path / "m.png"), shown)
        assert not read_mask_as(tmp_path / "m.png", (120, 90), file)[1]
    # A mask is its own photograph where images are silhouettes.
    cv2.imwrite(str(tmp_path / "m.png"), soft)
    assert not read_mask_as(tmp_path / "m.png", (120, 90), tmp_path / "m.png")[1]


@pytest.mark.parametrize(("name", "share"), [("m.png", 0.0), ("m.png", 0.5), ("m.jpg", 0.5)])
def test_a_photograph_with_the_object_drawn_over_it_is_refused_as_that(
    photograph, tmp_path, name, share
):
    file, pixels, inside = photograph
    red = (1 - share) * pixels + share * np.array([0, 0, 255])
    shown = np.where(inside[:, :, None], red, pixels).astype(np.uint8)
    cv2.imwrite(str(tmp_path / name), shown)
    with pytest.raises(UserError, match="is its photograph, with or without the object drawn over"):
        read_mask(tmp_path / name, (120, 90), file)


@pytest.mark.parametrize("inverted", [False, True])
def test_a_mask_of_an_object_before_a_plain_light_is_no_photograph(photograph, tmp_path, inverted):
    file, _, inside = photograph
    lit = np.where(inside, 20, 250).astype(np.uint8)
    cv2.imwrite(str(file), lit)
    mask = 255 * (inside ^ inverted).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", (120, 90), file), mask)
