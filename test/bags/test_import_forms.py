"""import: a cameras.json whose meaning is plain, written in other ways than ours."""

import shutil

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.foreign_files import find_masks_beside
from occ_recon_ros.bags.views import BagViews


def in_images(folder):
    (folder.path / "images").mkdir()
    for i in range(3):
        folder.image(i).rename(folder.path / "images" / folder.image(i).name)


def in_capitals(folder):
    for i in range(3):
        folder.image(i).rename(folder.image(i).with_suffix(folder.image(i).suffix.upper()))


def without_suffix(folder):
    for entry in folder.content["frames"]:
        entry["file"] = entry["file"].split(".")[0]


def k_of_four(folder):
    for entry in folder.content["frames"]:
        entry["K"] = [80.0, 82, 31.5, 23.5]


def as_text(folder):
    for entry in folder.content["frames"]:
        entry |= {key: np.array(entry[key]).astype(str).tolist() for key in ("K", "D", "R", "t")}
    folder.content["unit_in_metres"] = "0.001"


def in_one_matrix(folder):
    for entry in folder.content["frames"]:
        Rt = np.column_stack([entry.pop("R"), entry.pop("t")])
        entry["transform"] = [*Rt.tolist(), [0, 0, 0, 1]]


@pytest.mark.parametrize(
    "change",
    [in_images, in_capitals, without_suffix, k_of_four, as_text, in_one_matrix],
)
def test_what_is_plain_is_taken(command, folder, tmp_path, change):
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    change(folder)
    folder.save()
    code, out, err = command("import", folder.path, tmp_path / "b.mcap")
    assert (code, err) == (0, "")
    assert "left out" not in out
    views = zip(BagViews(tmp_path / "a.mcap"), BagViews(tmp_path / "b.mcap"), strict=True)
    for ours, theirs in views:
        np.testing.assert_array_equal(ours.image, theirs.image)
        np.testing.assert_array_equal(ours.mask, theirs.mask)
        for name in ("K", "D", "R_camera_object", "t_camera_object"):
            np.testing.assert_allclose(getattr(ours.camera, name), getattr(theirs.camera, name))


def test_of_two_files_that_a_name_may_mean_none_is_taken(command, folder, tmp_path):
    shutil.copy(folder.image(0), folder.path / "0.PNG")
    folder.content["frames"][0]["file"] = "0"
    folder.save()
    code, _, err = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 2
    assert "does not exist: correct its name" in err


def test_four_numbers_in_another_order_are_refused(command, folder, tmp_path):
    folder.content["frames"][1]["K"] = [80.0, 31.5, 82, 23.5]
    folder.save()
    _, _, err = command("import", folder.path, tmp_path / "a.mcap")
    assert "K of four numbers must be fx, fy, cx, cy" in err


def test_one_file_in_many_poses_is_said(command, folder, tmp_path):
    for entry in folder.content["frames"]:
        entry |= {"file": "0.png"}
    folder.save()
    _, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert "3 of 3 frames name" in out
    assert "a photograph has one, check the names" in out


def test_masks_that_are_black_are_counted(command, folder, tmp_path):
    for i in range(3):
        cv2.imwrite(str(folder.mask(i)), np.zeros((48, 64), np.uint8))
    _, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert "3 of 3 masks are black, and show no object\n" in out


def test_black_and_white_masks_among_others_are_named(command, folder, tmp_path):
    farther = folder.content["frames"][2] | {"file": "3.png", "mask": "m/3.png"}
    farther["t"] = [*farther["t"][:2], farther["t"][2] + 1]
    folder.content["frames"].append(farther)
    folder.save()
    shutil.copy(folder.image(2), folder.image(3))
    shutil.copy(folder.mask(2), folder.mask(3))
    cv2.imwrite(str(folder.mask(1)), np.zeros((48, 64), np.uint8))
    cv2.imwrite(str(folder.mask(2)), np.full((48, 64), 255, np.uint8))
    code, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 0
    assert "1 of 4 masks are black, and show no object: 1.jpg" in out
    assert f"left out: {folder.mask(2)} is white nearly everywhere: the object alone must" in out
    assert "/image 4, /mask 3" in out


def test_images_that_were_not_cut_out_unlike_the_others_are_named(command, folder, tmp_path):
    for k, entry in enumerate(folder.content["frames"]):
        picture, alpha = cv2.imread(str(folder.image(k))), cv2.imread(str(folder.mask(k)), 0)
        entry["file"] = f"rgba_{k}.png"
        del entry["mask"]
        alpha = np.full_like(alpha, 255) if k == 1 else alpha
        cv2.imwrite(str(folder.image(k)), np.dstack([picture, alpha]))
    folder.save()
    code, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 0
    assert "1 of 3 images that should hold their masks have none" in out
    assert "cuts out: rgba_1.png" in out


@pytest.mark.parametrize("place", ["masks", "images_mask", "Silhouettes"])
@pytest.mark.parametrize("name", ["{}.png", "{}-cut-out.png", "sil_{}.png", "{}.jpg.mask.png"])
def test_masks_are_found_by_what_is_about_all_names(tmp_path, place, name):
    images = [tmp_path / "images" / f"{k}.jpg" for k in (1, 2, 11, 12)]
    for image in images:
        mask = tmp_path / place / name.format(image.stem)
        for path, pixels in ((image, 90), (mask, 0)):
            path.parent.mkdir(exist_ok=True)
            drawn = np.full((40, 40), pixels, np.uint8)
            drawn[10:30, 15:25] = 255
            cv2.imwrite(str(path), drawn)
    found = find_masks_beside(images, tmp_path)
    assert {image: mask.name for image, mask in found.items()} == {
        image: name.format(image.stem) for image in images
    }
