"""import: an image of another size among others that have its K, where nobody says sizes."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.views import BagViews


@pytest.fixture
def unsized(folder):
    for entry in folder.content["frames"]:
        entry["K"] = folder.content["frames"][0]["K"]
        entry.pop("D", None)
        for key in ("width", "height"):
            entry.pop(key, None)
    folder.save()
    return folder


def resize(folder, frame, width, height):
    image = cv2.imread(str(folder.image(frame)), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(folder.image(frame)), cv2.resize(image, (width, height)))


def test_k_of_the_others_is_scaled_to_a_smaller_copy(command, unsized, tmp_path):
    resize(unsized, 2, 32, 24)
    code, out, _ = command("import", unsized.path, tmp_path / "a.mcap")
    assert code == 0
    assert "1 images are not 64x48 as the others, and have their K: it is scaled" in out
    assert "2.png, 32x24" in out
    whole, _, small = BagViews(tmp_path / "a.mcap").cameras().values()
    assert (small.width, small.height) == (32, 24)
    np.testing.assert_allclose(small.K, whole.resized(32, 24).K)


def test_one_of_another_shape_is_left_out_by_its_name(command, unsized, tmp_path):
    resize(unsized, 2, 32, 32)
    _, out, err = command("import", unsized.path, tmp_path / "a.mcap")
    assert f"{unsized.image(2)} is 32x32, and has the K of the others, 64x48" in out + err


def test_a_smaller_one_with_a_k_of_its_own_keeps_it(command, unsized, tmp_path):
    resize(unsized, 2, 32, 24)
    own = (np.diag([0.5, 0.5, 1]) @ unsized.content["frames"][0]["K"]).tolist()
    unsized.content["frames"][2]["K"] = own
    unsized.save()
    code, out, _ = command("import", unsized.path, tmp_path / "a.mcap")
    assert code == 0
    assert "scaled" not in out
    np.testing.assert_allclose([*BagViews(tmp_path / "a.mcap").cameras().values()][2].K, own)


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ((32, 24), "(32, 24) is far from the middle of images of 32x24: K seems to be of images"),
        ((96, 72), "images about 0.67 times as large"),
        ((64, 48), ""),
        ((56, 30), ""),  # cut, at one side more
    ],
)
def test_k_of_images_of_another_size_is_doubted(command, unsized, tmp_path, size, said):
    for k in range(3):
        resize(unsized, k, *size)
    code, out, _ = command("import", unsized.path, tmp_path / "a.mcap", "--no-masks")
    assert code == 0
    assert said in out
    assert ("the principal point" in out) == bool(said)
