"""import: poses_bounds.npy of LLFF, and cameras.json of Gaussian splatting."""

import json

import cv2
import numpy as np
import pytest
from colmap_nerf import N, Q, elsewhere, turn, write_images

from occ_recon_ros.bags.views import BagViews

FOCAL, SIZE = 130.0, (96, 72)


def letter(k):
    """A name of the k-th of which the order is that of its text: 10 before 9."""
    return f"{sorted(map(str, range(N)))[k]}.png"


def write_llff(folder, change=lambda rows: rows, scale=1):
    rows = []
    for camera in turn():
        (right, down, forward), centre = elsewhere(camera)
        hwf = scale * np.array([SIZE[1], SIZE[0], FOCAL])
        rows.append([*np.column_stack([down, right, -forward, centre, hwf]).ravel(), 1.0, 2.0])
    np.save(folder / "poses_bounds.npy", change(np.array(rows)))


def write_splats(folder, called=lambda k: f"{k}.png"):
    rows = []
    for k, camera in enumerate(turn()):
        axes, centre = elsewhere(camera)
        row = {"id": k, "img_name": called(k), "width": SIZE[0], "height": SIZE[1]}
        row |= {"position": centre.tolist(), "rotation": axes.T.tolist()}
        rows.append(row | {"fx": FOCAL, "fy": FOCAL + 1})
    (folder / "cameras.json").write_text(json.dumps(rows))


@pytest.fixture
def imports(command, tmp_path):
    """The views of the folder, which must be those of the turn, and what is said of it."""

    def check(focal=FOCAL, fy=0.0, middle=(47.5, 35.5)):
        code, out, err = command("import", tmp_path, tmp_path / "a.mcap", "--overwrite")
        assert (code, err) == (0, "")
        views = sorted(BagViews(tmp_path / "a.mcap"), key=lambda view: view.image[0, 0])
        assert [int(view.image[0, 0]) - 10 for view in views] == list(range(N))
        for view, camera in zip(views, turn(), strict=True):
            K = [[focal, 0, middle[0]], [0, focal + fy, middle[1]], [0, 0, 1]]
            np.testing.assert_allclose(view.camera.K, K, atol=1e-7)
            np.testing.assert_allclose(view.camera.R_camera_object, elsewhere(camera)[0], atol=1e-7)
        there, written = (
            np.array([c.centre for c in some]) for some in ([v.camera for v in views], turn())
        )
        there, written = there - there.mean(axis=0), (written - written.mean(axis=0)) @ Q.T
        np.testing.assert_allclose(
            there / np.linalg.norm(there), written / np.linalg.norm(written), atol=1e-6
        )
        assert "no distortion is told of, and none assumed" in out
        return views, out

    return check


@pytest.mark.parametrize("place", ["", "images", "images_4"])
def test_poses_of_llff_are_of_the_images_in_the_order_of_their_names(imports, tmp_path, place):
    write_images(tmp_path / place, called=letter)
    write_llff(tmp_path)
    _, out = imports()
    assert "in the order of their names, from 0.png to 9.png" in out


def test_images_of_another_size_have_a_focal_length_of_theirs(imports, tmp_path):
    write_images(tmp_path / "images_8", called=letter)
    write_llff(tmp_path, scale=8)
    assert "K is scaled to theirs" in imports()[1]


def test_of_two_folders_that_with_as_many_images_is_taken_and_its_masks(imports, tmp_path):
    write_images(tmp_path / "images", N + 3)
    write_images(tmp_path / "images_4", called=letter)
    write_llff(tmp_path)
    (tmp_path / "masks_4").mkdir()
    for k in range(N):
        mask = np.zeros(SIZE[::-1], np.uint8)
        mask[20:40, 30 : 50 + k] = 255
        cv2.imwrite(str(tmp_path / "masks_4" / letter(k)), mask)
    views, _ = imports()
    assert [int((view.mask[30] > 0).sum()) for view in views] == [20 + k for k in range(N)]


@pytest.mark.parametrize("called", [lambda k: f"{k}.png", lambda k: f"{k}"])
def test_cameras_of_gaussian_splatting(imports, tmp_path, called):
    write_images(tmp_path / "images", called=lambda k: f"{k}.png")
    write_splats(tmp_path, called)
    _, out = imports(fy=1.0)
    assert "cameras.json is of Gaussian splatting" in out


BAD = {
    "more images": (lambda p: write_images(p / "images", N + 1), f"{N + 1} in"),
    "no images": (lambda p: None, "there are none. Leave there"),
    "other numbers": (lambda p: write_llff(p, lambda rows: rows[:, :15]), "17 numbers an image"),
    "one row": (lambda p: write_llff(p, lambda rows: rows[0]), "not 17 in all"),
    "no array": (lambda p: (p / "poses_bounds.npy").write_text("x"), "cannot be read"),
    "NaN": (
        lambda p: [write_images(p), write_llff(p, lambda rows: rows * np.nan)],
        "must be finite, with sizes above 0",
    ),
    "splats alone": (lambda p: write_splats(p), "put those there that it was made of"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_one_line(command, tmp_path, case):
    write_llff(tmp_path)
    spoil, words = BAD[case]
    spoil(tmp_path)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_folder_above_is_told_where_they_are(command, tmp_path):
    (tmp_path / "a").mkdir()
    write_llff(tmp_path / "a")
    assert f"import instead: {tmp_path}/a\n" in command("import", tmp_path, tmp_path / "b.mcap")[2]
