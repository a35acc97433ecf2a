"""Square masks of a network are read as it saw their images, where the edges of these tell how."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from two_parts import frames_of_two_parts

from occ_recon_ros.bags.mask_files import PLACINGS, read_mask
from occ_recon_ros.bags.mask_layout import masks_laid_out

SIZE, SIDE = (240, 180), 224


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    return frames_of_two_parts(tmp_path_factory.mktemp("turn"), SIZE, 300, 0.02)


def seen_by_a_network(mask, placing):
    """(SIDE, SIDE) of a mask (h, w)."""
    height, width = mask.shape
    if placing == "cut":
        first = (width - height) // 2
        mask = mask[:, first : first + height]
    elif placing != "stretched":
        bars = width - height
        above = bars // 2 if placing == "in the middle" else 0
        mask = np.pad(mask, ((above, bars - above), (0, 0)))
    return cv2.resize(mask, (SIDE, SIDE), interpolation=cv2.INTER_AREA)


def with_square_masks(frames, folder, placing, turn=0):
    found = []
    for frame in frames:
        mask = np.ascontiguousarray(np.rot90(cv2.imread(str(frame.mask), 0), turn))
        path = folder / frame.mask.name
        cv2.imwrite(str(path), seen_by_a_network(mask, placing))
        found.append(replace(frame, mask=path))
    return found


def agreement(frame, right):
    mask = read_mask(frame.mask, SIZE, frame.image, frame.layout) > 127
    wanted = cv2.imread(str(right.mask), 0) > 127
    return np.count_nonzero(mask & wanted) / np.count_nonzero(mask | wanted)


@pytest.mark.parametrize("placing", [p for p in PLACINGS if p not in ("cut", "pixel for pixel")])
def test_square_masks_are_read_as_the_edges_of_their_images_tell(frames, tmp_path, placing):
    found, (remark,) = masks_laid_out(with_square_masks(frames, tmp_path, placing))
    assert {frame.layout.placing for frame in found} == {placing}
    assert "of another shape than their images" in remark
    assert min(map(agreement, found, frames)) > 0.98


def test_square_masks_of_images_turned_upright_are_turned_back(frames, tmp_path):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    turned = []
    for frame in with_square_masks(frames, tmp_path, "stretched", turn=-1):
        image = tmp_path / frame.image.with_suffix(".jpg").name
        Image.open(frame.image).convert("RGB").save(image, exif=exif, quality=95)
        turned.append(replace(frame, image=image))
    found, _ = masks_laid_out(turned)
    assert found[0].layout == ("stretched", True)
    assert min(map(agreement, found, frames)) > 0.98


def test_where_all_around_the_middle_is_cut_nothing_is_made_up(frames, tmp_path):
    cut = with_square_masks(frames, tmp_path, "cut")
    assert masks_laid_out(cut) == (cut, [])


@pytest.mark.parametrize("border", [40, 70])
def test_masks_without_a_border_are_read_pixel_for_pixel_where_no_object_is_cut(
    frames, tmp_path, border
):
    # They were to be stretched, which is wrong.
    trimmed = []
    for frame in frames:
        mask = cv2.imread(str(frame.mask), 0)
        path = tmp_path / frame.mask.name
        cv2.imwrite(str(path), mask[border:-border, border:-border])
        trimmed.append(replace(frame, mask=path))
    found, remarks = masks_laid_out(trimmed)
    if border == 40:
        assert found[0].layout.placing == "pixel for pixel"
        assert "pixel for pixel, without a border: they are read so" in remarks[0]
        assert min(map(agreement, found, frames)) == 1
    else:
        assert (found, remarks) == (trimmed, [])


def test_masks_that_lie_on_no_edges_and_those_of_their_shape_stay(frames, tmp_path):
    assert masks_laid_out(frames) == (frames, [])
    strange = with_square_masks(frames, tmp_path, "stretched")
    for frame in strange:
        mask = cv2.imread(str(frame.mask), 0)
        cv2.imwrite(str(frame.mask), np.ascontiguousarray(np.rot90(mask)))
    assert masks_laid_out(strange) == (strange, [])
