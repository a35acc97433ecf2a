"""import: the cameras of multi-view stereo, of Middlebury, and of IDR and NeuS."""

import cv2
import numpy as np
import pytest
from colmap_nerf import N, Q, elsewhere, turn, write_images

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.poses.convention import from_projection


def pose(camera):
    R, centre = elsewhere(camera)
    return R, -R @ centre


def write_parameters(folder, change=lambda K: K):
    lines = [str(N)]
    for k, camera in enumerate(turn(square=False)):
        R, t = pose(camera)
        numbers = [*change(camera.K).ravel(), *R.ravel(), *t]
        lines.append(" ".join([f"ring {k:04d}.png", *(f"{x:.12g}" for x in numbers)]))
    (folder / "ring_par.txt").write_text("\n".join(lines) + "\n")


def write_matrices(folder, name="cameras_sphere.npz", change=lambda P: P, digits=1):
    arrays = {}
    for k, camera in enumerate(turn(square=False)):
        P = np.eye(4)
        P[:3] = camera.K @ np.column_stack(pose(camera))
        arrays[f"world_mat_{k:0{digits}d}"] = change(P)
        arrays[f"scale_mat_{k}"] = np.diag([7.0, 7, 7, 1])
    np.savez(folder / name, **arrays)


@pytest.fixture
def imports(command, tmp_path):
    """The views of the folder, which must be those of the turn, and what is said of it."""

    def check():
        code, out, err = command("import", tmp_path, tmp_path / "a.mcap", "--overwrite")
        assert (code, err) == (0, "")
        views = list(BagViews(tmp_path / "a.mcap"))
        assert [int(view.image[0, 0]) - 10 for view in views] == list(range(N))
        given = turn(square=False)
        for view, camera in zip(views, given, strict=True):
            np.testing.assert_allclose(view.camera.K, camera.K, atol=1e-7)
            np.testing.assert_allclose(view.camera.R_camera_object, pose(camera)[0], atol=1e-7)
        there, written = (
            np.array([c.centre for c in some]) for some in ([v.camera for v in views], given)
        )
        there, written = there - there.mean(axis=0), (written - written.mean(axis=0)) @ Q.T
        np.testing.assert_allclose(
            there / np.linalg.norm(there), written / np.linalg.norm(written), atol=1e-6
        )
        assert "unit and origin of" in out
        assert "no distortion is told of, and none assumed" in out
        return views, out

    return check


@pytest.mark.parametrize("place", ["", "images"])
def test_parameters_of_middlebury(imports, tmp_path, place):
    write_images(tmp_path / place, called=lambda k: f"ring {k:04d}.png")
    write_parameters(tmp_path)
    (tmp_path / "notes_par.txt").write_text("of something else\n")
    imports()


@pytest.mark.parametrize("scale", [1.0, -0.02])
def test_matrices_of_idr(imports, tmp_path, scale):
    write_images(tmp_path / "image", called=lambda k: f"{k:06d}.png")
    (tmp_path / "mask").mkdir()
    for k in range(N):
        mask = np.zeros((72, 96), np.uint8)
        mask[20:40, 30 : 50 + k] = 255
        cv2.imwrite(str(tmp_path / "mask" / f"{k:03d}.png"), mask)
    write_matrices(tmp_path, change=lambda P: P * scale)
    write_matrices(tmp_path, "cameras_linear_init.npz", change=lambda P: P * np.nan)
    views, out = imports()
    assert [int((view.mask[30] > 0).sum()) for view in views] == [20 + k for k in range(N)]
    assert "its world_mat are of the images by their number" in out


def test_white_masks_are_none(imports, tmp_path):
    write_images(tmp_path / "image", called=lambda k: f"{k:03d}.png")
    write_images(tmp_path / "mask", called=lambda k: f"{k:03d}.png")
    for path in (tmp_path / "mask").iterdir():
        cv2.imwrite(str(path), np.full((72, 96), 255, np.uint8))
    write_matrices(tmp_path, digits=3)
    views, _ = imports()
    assert all(view.mask is None for view in views)


def test_of_more_images_those_of_the_numbers_are_taken(imports, tmp_path):
    write_images(tmp_path / "image", N + 2, called=lambda k: f"{k:03d}.png")
    write_matrices(tmp_path)
    imports()


def renamed(images):
    for path in list(images.iterdir()):
        path.rename(path.with_name(f"x{path.name}"))
    write_images(images, 1)


BAD = {
    "aslant": (lambda p: write_parameters(p, lambda K: K + 9 * np.eye(3, k=1)), "K must be finite"),
    "no K": (lambda p: write_parameters(p, lambda K: K * 0), "K must be finite"),
    "NaN": (lambda p: write_matrices(p, change=lambda P: P * np.nan), "is not finite, or of no"),
    "flat": (lambda p: write_matrices(p, change=lambda P: P * 0), "of no camera that has a place"),
    "3x3": (
        lambda p: write_matrices(p, change=lambda P: P[:3, :3]),
        "must be 4x4 numbers, not 3x3",
    ),
    "other images": (lambda p: [write_matrices(p), renamed(p / "image")], "must be in"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_one_line(command, tmp_path, case):
    write_images(tmp_path, called=lambda k: f"ring {k:04d}.png")
    write_images(tmp_path / "image", called=lambda k: f"{k}.png")
    spoil, words = BAD[case]
    spoil(tmp_path)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_matrix_comes_apart():
    for camera in turn(square=False):
        for scale in (1.0, -3.0):
            K, R, t = from_projection(scale * camera.K @ np.column_stack(pose(camera)))
            np.testing.assert_allclose(K, camera.K, atol=1e-9)
            np.testing.assert_allclose(R, pose(camera)[0], atol=1e-9)
            np.testing.assert_allclose(t, pose(camera)[1], atol=1e-6)
