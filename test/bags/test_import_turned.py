"""import: photographs that their EXIF data turn are taken as they are stored, or shown."""

import numpy as np
import pytest
from PIL import ExifTags, Image, ImageOps

from occ_recon_ros.bags.images import read_image
from occ_recon_ros.bags.mask_files import read_mask
from occ_recon_ros.bags.photographs import image_size
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.errors import UserError

PIXELS = np.zeros((48, 64), np.uint8)
PIXELS[:20, :30] = 255


def save(path, pixels, orientation):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    Image.fromarray(pixels).save(path, exif=exif)


@pytest.mark.parametrize("orientation", [3, 6, 8])
@pytest.mark.parametrize("suffix", ["png", "tif", "webp", "jpg"])
def test_an_image_is_read_as_it_is_stored(tmp_path, orientation, suffix):
    path = tmp_path / f"a.{suffix}"
    save(path, PIXELS, orientation)
    assert image_size(path) == (64, 48)
    for pixels in (read_image(path), read_mask(path)):
        grey = pixels if pixels.ndim == 2 else pixels[:, :, 0]
        np.testing.assert_array_equal(grey > 127, PIXELS > 127)


def test_a_big_endian_tiff_too(tmp_path):
    path, exif = tmp_path / "a.tif", Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    deep = (PIXELS.astype(np.uint16) * 200).astype(">u2")
    Image.frombytes("I;16B", (64, 48), deep.tobytes()).save(path, exif=exif)
    assert path.read_bytes().startswith(b"MM")
    np.testing.assert_array_equal(read_image(path), deep)
    path.write_bytes(path.read_bytes()[:12])
    with pytest.raises(UserError, match="cannot read"):
        read_image(path)


@pytest.mark.parametrize("suffix", ["tif", "jpg"])
def test_a_calibration_of_the_stored_pixels_is_taken(command, folder, tmp_path, suffix):
    for k, entry in enumerate(folder.content["frames"]):
        entry["file"] = f"turned_{k}.{suffix}"
        save(folder.image(k), PIXELS, 6)
    folder.save()
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "/image 3" in out


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_calibration_of_what_is_shown_is_taken(command, folder, tmp_path, orientation):
    shown = PIXELS.copy()
    shown[:9, :9] = 100
    way = Image.Transpose
    back = {5: way.TRANSPOSE, 6: way.ROTATE_90, 7: way.TRANSVERSE, 8: way.ROTATE_270}[orientation]
    stored = np.asarray(Image.fromarray(shown).transpose(back))
    for k, entry in enumerate(folder.content["frames"]):
        entry["file"] = f"turned_{k}.png"
        save(folder.image(k), stored, orientation)
    folder.save()
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "3 images are turned as their EXIF data say" in out
    for view in BagViews(tmp_path / "a.mcap"):
        np.testing.assert_array_equal(view.image, shown)
    upright = ImageOps.exif_transpose(Image.open(folder.image(0)))
    np.testing.assert_array_equal(np.asarray(upright), shown)  # as Pillow, too, shows it


@pytest.mark.parametrize(
    ("cx", "cy", "shown"), [(23.5, 31.5, True), (21, 34, True), (31.5, 23.5, False)]
)
def test_where_no_size_is_said_the_principal_point_tells_which(
    command, folder, tmp_path, cx, cy, shown
):
    for k, entry in enumerate(folder.content["frames"]):
        entry.pop("width", None), entry.pop("height", None)
        entry["K"] = [[80, 0, cx], [0, 80, cy], [0, 0, 1]]
        save(folder.image(k), PIXELS, 6)
    folder.save()
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert ("3 images are turned as their EXIF data say" in out) == shown
    for view in BagViews(tmp_path / "a.mcap"):
        assert view.image.shape == (PIXELS.T if shown else PIXELS).shape
        assert (view.camera.height, view.camera.width) == view.image.shape


def test_of_another_size_without_exif_it_is_refused(command, folder, tmp_path):
    for k in range(3):
        save(folder.image(k), np.zeros((64, 48), np.uint8), 3)
    code, _, err = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 2
    assert "is 48x64, its calibration is of 64x48: correct width, height and K" in err
