"""import: models of COLMAP and transforms.json beside files that are not where these say."""

import re
import unicodedata
from pathlib import Path

import cv2
import numpy as np
import pytest
from colmap_nerf import (
    N,
    frames_of,
    name,
    turn,
    write_binary,
    write_images,
    write_text,
    write_transforms,
)
from PIL import ExifTags, Image

from occ_recon_ros.bags.views import BagViews


def taken(bag) -> list[int]:
    """Numbers of the images, which ``write_images`` made as bright."""
    return [int(view.image[0, 0]) - 10 for view in BagViews(bag)]


@pytest.fixture
def imports(command, tmp_path):
    """What is said of the folder, whose images come in order or in that given."""

    def check(*order: int, folder=tmp_path) -> str:
        code, out, err = command("import", folder, tmp_path / "a.mcap", "--overwrite")
        assert (code, err) == (0, "")
        assert taken(tmp_path / "a.mcap") == list(order or range(N))
        return out

    return check


@pytest.fixture
def refuses(command, tmp_path):
    """What is said of the folder that cannot be imported."""

    def check(folder=tmp_path) -> str:
        code, out, err = command("import", folder, tmp_path / "a.mcap")
        assert (code, out, err.count("\n")) == (2, "", 1)
        return err

    return check


def two_folders(k: int) -> str:
    return f"cam{1 + k // 6}/IMG {k % 6}.png"


def write_masks(folder, called) -> None:
    """The k-th is one pixel wider than that before."""
    for k in range(N):
        drawn = np.zeros((72, 96), np.uint8)
        drawn[20:50, 30 : 60 + k] = 255
        path = folder / called(k)
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), drawn)


def widths(bag) -> list[int | None]:
    masks = [view.mask for view in BagViews(bag)]
    return [None if mask is None else int((mask[30] > 127).sum()) - 30 for mask in masks]


NAMED = {
    "Windows, absolute": lambda k: f"C:\\Users\\Jörg\\scan\\images\\two\\{k}.png",
    "Windows, relative": lambda k: f"images\\two\\{k}.png",
    "absolute, elsewhere": lambda k: f"/home/somebody/scan/images/two/{k}.png",
    "beside": lambda k: f"../scan/images/two/{k}.png",
    "in images": lambda k: f"two/{k}.png",
    "without suffix": lambda k: f"./images/two/{k}",
    "as JPEG": lambda k: f"images/two/{k}.JPG",
}


@pytest.mark.parametrize("case", NAMED)
def test_names_may_have_been_of_another_place(imports, tmp_path, case):
    write_images(tmp_path / "images" / "two", called=lambda k: f"{k}.png")
    write_transforms(tmp_path, turn(), frames=frames_of(turn(), NAMED[case]))
    assert "left out" not in imports()
    (tmp_path / "transforms.json").unlink()
    write_text(tmp_path / "sparse", turn(), "PINHOLE", NAMED[case])
    assert "left out" not in imports()


def test_the_first_folder_of_smaller_copies_is_taken_where_the_images_are_gone(imports, tmp_path):
    write_images(tmp_path / "images_2", size=(48, 36))
    write_images(tmp_path / "images_4", size=(24, 18))
    write_transforms(tmp_path, turn())
    assert "(48x36, not 96x72)" in imports()


def test_a_file_is_no_folder(refuses, tmp_path):
    write_transforms(tmp_path, turn())
    assert "transforms.json is a file: give one that" in refuses(tmp_path / "transforms.json")


@pytest.mark.parametrize(("listed", "there"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_umlauts_may_be_composed_or_not(imports, tmp_path, listed, there):
    def called(form):
        return lambda k: unicodedata.normalize(form, f"süß und schön/Schüssel {k}.png")

    write_images(tmp_path / "images", called=called(there))
    write_text(tmp_path / "sparse", turn(), "PINHOLE", called(listed))
    assert "left out" not in imports()


def test_names_may_be_written_as_windows_did(imports, tmp_path):
    write_images(tmp_path / "images", called=lambda k: f"Schüssel zu 5 € {k}.png")
    write_text(tmp_path / "sparse", turn(), "PINHOLE", lambda k: f"Schüssel zu 5 € {k}.png")
    text = (tmp_path / "sparse" / "images.txt").read_text()
    (tmp_path / "sparse" / "images.txt").write_bytes(text.encode("cp1252"))
    assert "left out" not in imports()
    write_binary(
        tmp_path / "sparse", turn(), "PINHOLE", called=lambda k: f"Sch#ssel zu 5 ~ {k}.png"
    )
    data = (tmp_path / "sparse" / "images.bin").read_bytes()
    (tmp_path / "sparse" / "images.bin").write_bytes(
        data.replace(b"#", b"\xfc").replace(b"~", b"\x80")
    )
    assert "left out" not in imports()


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_of_points_may_have_been_lost(imports, tmp_path, end):
    write_images(tmp_path / "images")
    write_text(tmp_path / "sparse", turn(), "PINHOLE")
    for file in ("images.txt", "cameras.txt"):
        lines = (tmp_path / "sparse" / file).read_text().splitlines()
        text = end.join([*filter(None, lines), ""])
        (tmp_path / "sparse" / file).write_bytes(b"\xef\xbb\xbf" + text.encode())
    imports()


@pytest.mark.parametrize("place", ["sparse", "dense/sparse", "dense/0/sparse"])
def test_undistorted_images_are_beside_their_model(imports, tmp_path, place):
    model = tmp_path / place
    write_images(model.parent / "images")
    write_binary(model, turn(), "PINHOLE")
    if place != "sparse":
        write_images(tmp_path / "images", size=(97, 73))  # those that bend
    imports()
    assert all(view.image.shape == (72, 96) for view in BagViews(tmp_path / "a.mcap"))
    imports(folder=model)


@pytest.mark.parametrize("model", ["", "sparse"])
@pytest.mark.parametrize("gone", [0, 1])
def test_images_above_the_folder_are_of_another_scan(imports, tmp_path, model, gone):
    write_images(tmp_path / "images", called=lambda k: f"view {N - 1 - k}.png")
    write_images(tmp_path / "scan" / "images")
    for k in range(gone):
        (tmp_path / "scan" / "images" / f"view {k}.png").unlink()
    write_text(tmp_path / "scan" / model, turn(), "PINHOLE")
    out = imports(*range(gone, N), folder=tmp_path / "scan")
    assert out.count("left out: ") == gone


def test_the_model_is_of_the_pixels_as_the_file_has_them(imports, tmp_path):
    """COLMAP does not turn images as their EXIF data say: its K is of the sensor's rows."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    (tmp_path / "images").mkdir()
    for k in range(N):
        pixels = np.full((72, 96), 10 + k, np.uint8)
        pixels[40:, 48:] = 250
        Image.fromarray(pixels).save(tmp_path / "images" / f"{k}.jpg", exif=exif, quality=100)
    write_text(tmp_path / "sparse", turn(), "PINHOLE", lambda k: f"{k}.jpg")
    imports()
    for view in BagViews(tmp_path / "a.mcap"):
        assert view.image.shape == (72, 96)
        assert (view.image[45:, 53:] > 200).all()
        assert (view.image[:35] < 100).all()
    model = (tmp_path / "sparse" / "cameras.txt").read_text()
    (tmp_path / "sparse" / "cameras.txt").write_text(model.replace("96 72", "72 96"))
    (tmp_path / "a.mcap").unlink()
    imports()  # of others that turned them first
    for view in BagViews(tmp_path / "a.mcap"):
        assert view.image.shape == (96, 72)
        assert (view.image[53:, :27] > 200).all()
        assert (view.image[:, 37:] < 100).all()


COLMAP_MASKS = {
    "as COLMAP names them": lambda k: f"{two_folders(k)}.png",
    "of the same names": two_folders,
    "in images": lambda k: f"images/{two_folders(k)}",
}


@pytest.mark.parametrize("case", COLMAP_MASKS)
def test_masks_are_in_folders_as_their_images_are(imports, tmp_path, case):
    write_images(tmp_path / "images", called=two_folders)
    write_text(tmp_path / "sparse", turn(), "PINHOLE", two_folders)
    write_masks(tmp_path / "masks", COLMAP_MASKS[case])
    imports()
    assert widths(tmp_path / "a.mcap") == list(range(N))


def test_masks_of_one_folder_alone_are_taken(imports, tmp_path):
    write_images(tmp_path / "images", called=lambda k: f"a/{two_folders(k)}")
    write_text(tmp_path / "sparse", turn(), "PINHOLE", lambda k: f"a/{two_folders(k)}")
    write_masks(tmp_path / "masks" / "a", two_folders)
    for k in range(6, N):
        (tmp_path / "masks" / "a" / two_folders(k)).unlink()
    imports()
    assert widths(tmp_path / "a.mcap") == [*range(6), *[None] * 6]


def test_masks_in_one_folder_may_be_of_some_images_alone(imports, tmp_path):
    def called(k: int) -> str:
        return f"cam{1 + k // 6}/IMG {k}.png"

    write_images(tmp_path / "images", called=called)
    write_text(tmp_path / "sparse", turn(), "PINHOLE", called)
    write_masks(tmp_path / "masks", lambda k: f"IMG {min(k, 5)}.png")
    imports()
    assert widths(tmp_path / "a.mcap") == [*range(5), 11, *[None] * 6]


def test_masks_of_smaller_copies_are_named_as_these(imports, tmp_path):
    write_images(tmp_path / "images_4")
    write_transforms(tmp_path, turn())
    write_masks(tmp_path / "masks_4", lambda k: f"view {k}.png")
    imports()
    assert widths(tmp_path / "a.mcap") == list(range(N))


def test_a_binary_model_goes_before_the_text_beside_it(imports, tmp_path):
    write_images(tmp_path / "images")
    write_text(tmp_path / "sparse", turn(), "PINHOLE", lambda k: f"view {N - 1 - k}.png")
    write_binary(tmp_path / "sparse", turn()[:6], "PINHOLE")
    imports(*range(6))


def test_names_may_lead_out_of_the_folder(imports, tmp_path):
    write_images(tmp_path / "photos", called=lambda k: f"{k}.png")
    write_images(tmp_path / "scan" / "photos", called=lambda k: f"{N - 1 - k}.png")
    named = frames_of(turn(), lambda k: f"../photos/{k}.png")
    write_transforms(tmp_path / "scan", turn(), frames=named)
    imports(folder=tmp_path / "scan")


def test_a_mask_is_of_one_image(refuses, tmp_path):
    write_images(tmp_path / "images", called=two_folders)
    write_text(tmp_path / "sparse", turn(), "PINHOLE", two_folders)
    write_masks(tmp_path / "masks", lambda k: f"IMG {k % 6}.png")
    assert "IMG 0.png is the mask of" in (said := refuses())
    assert "--no-masks" in said


def test_depths_and_normals_beside_the_images_are_no_images_without_a_camera(command, tmp_path):
    write_transforms(tmp_path, turn())
    images = tmp_path / "images"
    write_images(images, N + 1)
    for ending in ("_depth_0001", "_normal_0001"):
        for k in range(N):
            (images / f"{Path(name(k)).stem}{ending}.png").write_bytes(b"a map")
    (images / "in_depth_0001.png").write_bytes(b"of nothing that is there")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "2 images have no camera in" in out
    assert f"in_depth_0001.png, {name(N)}\n" in out


def test_images_of_a_model_may_be_in_a_folder_of_any_name(command, tmp_path):
    write_images(tmp_path / "sil")
    (tmp_path / "masks").mkdir()
    write_text(tmp_path / "sparse" / "0", turn(), "PINHOLE")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap", "--no-masks")
    assert (code, err) == (0, "")
    assert f"/image {N}" in out


@pytest.mark.parametrize(
    "write", [lambda p, cameras: write_text(p, cameras, "PINHOLE"), write_transforms]
)
def test_a_quarter_of_the_images_of_a_model_is_taken(command, tmp_path, write):
    write(tmp_path, turn())
    write_images(tmp_path / "images")
    for k in range(N):
        if k % 4:
            (tmp_path / "images" / name(k)).unlink()
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "left out" not in out
    assert re.search(r"9 images of \S+ are not there \(.*, \.\.\.\): the others are taken", out)
    assert taken(tmp_path / "a.mcap") == [0, 4, 8]
