"""import: a COLMAP model or transforms.json that is wrong is one line, and leaves nothing."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from colmap_nerf import N, name, turn, write_binary, write_images, write_text, write_transforms


def spoilt(change):
    """A change of the first frames of a transforms.json, as of all of it."""

    def spoil(path: Path) -> None:
        content = json.loads((path / "transforms.json").read_text())
        change(content)
        (path / "transforms.json").write_text(json.dumps(content))

    return spoil


def each(**values: Any):
    return spoilt(lambda content: [entry.update(values) for entry in content["frames"]])


def by_matrix(K: Any):
    return spoilt(lambda c: c.update(fl_x=None, fl_y=None, cx=None, K=K))


def matrices(change):
    def all_(content):
        for entry in content["frames"]:
            entry["transform_matrix"] = change(np.array(entry["transform_matrix"])).tolist()

    return spoilt(all_)


def beside(folder: Path) -> None:
    """An image of the folder's name."""
    write_images(folder.parent, 1, called=lambda k: f"{folder.name}.png")


TWICE = np.diag([2.0, 2, 2, 1])
BACK = np.diag([1.0, -1, -1, 1])
BAD_TRANSFORMS = {
    "not JSON": (lambda p: (p / "transforms.json").write_text("{"), "not JSON"),
    "no frames": (spoilt(lambda c: c.update(frames=[])), "at least one frame"),
    "a frame is a number": (spoilt(lambda c: c.update(frames=[3])), "frames[0]"),
    "NaN": (matrices(lambda T: T * np.nan), "transform_matrix is not finite"),
    "scale within": (matrices(lambda T: T @ TWICE), "columns have lengths 2, 2, 2"),
    "beyond numbers": (matrices(lambda T: T @ TWICE * 1e200), "columns have lengths inf"),
    "mirrored": (matrices(lambda T: T @ np.diag([-1.0, 1, 1, 1])), "its rotation mirrors"),
    "axes of OpenCV": (
        matrices(lambda T: T @ BACK),
        "look past each other; they seem to be of a camera with y down that looks along z (OpenCV, "
        "COLMAP): change the sign of the second and third column of transform_matrix",
    ),
    "far away": (matrices(lambda T: T + 1e300 * np.eye(4)[:, :1] @ np.eye(4)[3:]), "no common"),
    "one place": (matrices(lambda T: T * [1, 1, 1, 0] + np.diag([0.0, 0, 0, 1])), "no common"),
    "3x3": (matrices(lambda T: T[:3, :3]), "numbers, not 3x3"),
    "no matrix": (each(transform_matrix=None), "has no 'transform_matrix'"),
    "no name": (each(file_path=""), "file_path"),
    "a folder": (lambda p: (beside(p / "images"), each(file_path="images/")(p)), "is not in"),
    "a name with a zero": (each(file_path="a\0b"), "file_path must be the name of a file"),
    "half a letter": (each(file_path="\ud800.png"), "file_path must be the name of a file"),
    "a mask with a zero": (each(mask_path="a\0b"), "mask_path must be the name of a file"),
    "half a letter of a mask": (each(mask_path="\ud800"), "mask_path must be the name of a file"),
    "no such name": (each(file_path="a" * 400), "is not in"),
    "no plane": (spoilt(lambda c: c.update(camera_model="EQUIRECTANGULAR")), "EQUIRECTANGULAR"),
    "p1 of a fisheye": (
        spoilt(lambda c: c.update(p1=0.1, is_fisheye=True)),
        "'p1' and a fisheye",
    ),
    "last row": (matrices(lambda T: np.diag([1.0, 1, 1, 2]) @ T), "last row must be 0 0 0 1"),
    "k4": (spoilt(lambda c: c.update(k4=0.1)), "'k4' and no fisheye"),
    "no focal length": (
        spoilt(lambda c: c.update(fl_x=None, fl_y=None)),
        "neither 'fl_x' nor 'camera_angle_x'",
    ),
    "K aslant": (by_matrix([[130, 9, 48], [0, 130, 36], [0, 0, 1]]), "K must be [[fl_x, 0"),
    "K transposed": (by_matrix([[130, 0, 0], [0, 130, 0], [48, 36, 1]]), "K must be [[fl_x"),
    "K of two rows": (by_matrix([[130, 0, 48], [0, 130, 36]]), "K must be 3x3 numbers"),
    "K a bit aslant": (by_matrix([[130, 0.2, 48], [0, 130, 36], [0, 0, 1]]), "K must be [[fl_x"),
    "K not rounded": (by_matrix([[130, 0, 48], [2e-6, 130, 36], [0, 0, 1]]), "K must be [[fl_x"),
    "K by columns": (by_matrix([130, 0, 0, 0, 130, 0, 48, 36, 1]), "K must be [[fl_x"),
    "K of 9 words": (by_matrix(["a"] * 9), "K must be 9 numbers"),
    "K of 4 numbers": (by_matrix([130, 130, 48, 36]), "'camera_angle_x', and its 'K' must be 3x3"),
    "K a word": (by_matrix("130"), "'camera_angle_x', and its 'K' must be 3x3 numbers"),
    "no K": (by_matrix(None), "'camera_angle_x', and no matrix 'K'"),
    "k5": (spoilt(lambda c: c.update(k5=0.1)), "has the coefficient 'k5', which cannot be used: "),
    "k6 of a fisheye": (
        spoilt(lambda c: c.update(k6=0.1, is_fisheye=True)),
        "has the coefficient 'k6', which cannot be used: ",
    ),
    "a fisheye's angle": (
        spoilt(lambda c: c.update(fl_x=None, fl_y=None, camera_angle_x=1.0, is_fisheye=True)),
        "has no 'fl_x'",
    ),
    "no angle": (spoilt(lambda c: c.update(fl_x=None, camera_angle_x=0)), "between 0 and pi"),
    "no lens": (spoilt(lambda c: c.update(k1=1e200)), "are of no lens: the distortion folds back"),
    "of a smooth can": (
        spoilt(lambda c: c.update(fl_x=60, fl_y=171, k1=46.6, k2=-3690, p1=0.4, p2=2.4)),
        "(fy is 2.85 times fx); calibrate again with fewer coefficients",
    ),
    "a number of 400 digits": (spoilt(lambda c: c.update(cx=10**400)), "'cx' is not finite"),
    "no size": (spoilt(lambda c: c.update(w=0)), "above 0"),
    "another shape": (spoilt(lambda c: c.update(w=72, h=96)), "is 96x72, its calibration is of"),
    "masks gone": (each(mask_path="m.png"), "m.png does not exist"),
}


@pytest.mark.parametrize("case", BAD_TRANSFORMS)
def test_a_bad_transforms_json_is_one_line(command, tmp_path, case):
    spoil, words = BAD_TRANSFORMS[case]
    write_images(tmp_path / "images")
    write_transforms(tmp_path, turn())
    spoil(tmp_path)
    refused(command, tmp_path, words)


def refused(command, folder: Path, *words: str) -> None:
    code, out, err = command("import", folder, folder / "a.mcap")
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert all(some in err for some in words), err
    assert not (folder / "a.mcap").exists()


def edited(file: str, old: str, new: str):
    def edit(model: Path) -> None:
        text = (model / file).read_text()
        changed = re.sub(old, new, text, flags=re.MULTILINE)
        assert changed != text
        (model / file).write_text(changed)

    return edit


BAD_TEXT = {
    "bent": (edited("cameras.txt", "PINHOLE", "THIN_PRISM_FISHEYE"), "image_undistorter"),
    "a parameter missing": (edited("cameras.txt", r" \S+$", ""), "has 4 finite parameters"),
    "no size": (edited("cameras.txt", "96 72", "0 72"), "0x72"),
    "text for a number": (edited("cameras.txt", "96 72", "96 x"), "line 2"),
    "no focal length": (edited("cameras.txt", "130.0", "0"), "focal"),
    "NaN": (edited("images.txt", r"^(\d+) \S+", r"\1 nan"), "not finite"),
    "no unit quaternion": (edited("images.txt", r"^(\d+) \S+", r"\1 4"), "length 1"),
    "a quaternion 6 % long": (
        edited("images.txt", r"^(\d+)( \S+){4}", r"\1 1.06 0 0 0"),
        "length 1, got 1.06",
    ),
    "a line cut": (edited("images.txt", r" \S+ view .*$", ""), "line 2 is too short"),
    "beyond numbers": (edited("images.txt", r"^(\d+) \S+", r"\1 1e200"), "length 1"),
    "another camera": (edited("images.txt", r" \d+ view", " 99 view"), "camera 99"),
    "no images": (lambda m: (m / "images.txt").write_text("# none\n"), "lists no images"),
    "not UTF-8": (lambda m: (m / "images.txt").write_bytes(b"\xff\xfe"), "images.txt"),
    "other images": (edited("images.txt", "view", "IMG"), "IMG 0.png is not in"),
}


@pytest.mark.parametrize("case", BAD_TEXT)
def test_a_bad_text_model_is_one_line(command, tmp_path, case):
    spoil, words = BAD_TEXT[case]
    write_images(tmp_path / "images")
    write_text(tmp_path / "sparse", turn(), "PINHOLE")
    spoil(tmp_path / "sparse")
    refused(command, tmp_path, words)


OTHER_MASKS = {
    "of other images": (lambda k: f"IMG_{k}.png", (72, 96), "of the photographs"),
    "white all around": (name, (72, 96), "white all along the border"),
    "of another shape": (name, (44, 48), "is 48x44, its image 96x72"),
}


@pytest.mark.parametrize("case", OTHER_MASKS)
def test_masks_that_are_none_of_these_images_can_be_left_out(command, tmp_path, case):
    called, size, words = OTHER_MASKS[case]
    write_images(tmp_path / "images")
    write_transforms(tmp_path, turn())
    (tmp_path / "masks").mkdir()
    around = np.full(size, 255, np.uint8)
    around[9:-9, 9:-9] = 0
    for k in range(N):
        shown = ~around if case == "of another shape" else around
        cv2.imwrite(str(tmp_path / "masks" / called(k)), shown)
    refused(command, tmp_path, words, "--no-masks leaves them out")
    assert command("import", tmp_path, tmp_path / "a.mcap", "--no-masks")[0] == 0


def test_one_bad_frame_is_left_out_by_name(command, tmp_path):
    write_images(tmp_path / "images")
    write_transforms(tmp_path, turn())
    spoilt(lambda c: c["frames"][4].update(transform_matrix=[[2, 0, 0, 0]] * 4))(tmp_path)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "left out: " in out
    assert "frames[4].transform_matrix: it holds no rotation" in out
    assert "/image 11" in out


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin"])
@pytest.mark.parametrize("kept", [0, 4, 9, 300, -1])
def test_a_binary_model_that_was_cut_is_one_line(command, tmp_path, file, kept):
    write_images(tmp_path / "images")
    write_binary(tmp_path / "sparse", turn(), "PINHOLE")
    data = (tmp_path / "sparse" / file).read_bytes()
    (tmp_path / "sparse" / file).write_bytes(data[:kept])
    refused(command, tmp_path, "truncated or not of COLMAP")


@pytest.mark.parametrize(("number", "words"), [(7, "FOV"), (77, "number 77")])
def test_a_binary_model_that_is_not_ours_is_named(command, tmp_path, number, words):
    write_images(tmp_path / "images")
    write_binary(tmp_path / "sparse", turn(), "PINHOLE")
    data = bytearray((tmp_path / "sparse" / "cameras.bin").read_bytes())
    data[12] = number
    (tmp_path / "sparse" / "cameras.bin").write_bytes(bytes(data))
    refused(command, tmp_path, f"of the model {words} cannot be used")


def test_a_folder_without_any_cameras_says_what_it_needs(command, tmp_path):
    write_images(tmp_path / "images")
    refused(command, tmp_path, "cameras.json, a sparse model of COLMAP")


@pytest.mark.parametrize(
    ("file", "maker"),
    [
        ("reconstruction/sfm_data.json", "of openMVG: make a model of COLMAP"),
        ("MeshroomCache/StructureFromMotion/7f3a/cameras.sfm", "of Meshroom: make a model"),
    ],
)
def test_cameras_in_a_file_that_is_not_read_are_named_with_what_to_make_of_them(
    command, tmp_path, file, maker
):
    write_images(tmp_path / "images")
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_bytes(b"{}")
    (tmp_path / "cameras.txt").touch()  # of another maker
    refused(
        command,
        tmp_path,
        f"{file} is {maker}",
        "or a transforms.json, and put the images beside it",
    )
    write_text(tmp_path / "sparse", turn(), "PINHOLE")
    assert command("import", tmp_path, tmp_path / "a.mcap")[0] == 0


@pytest.mark.parametrize("write", [write_text, write_binary])
@pytest.mark.parametrize(
    ("lost", "kept", "holds"), [("images", "cameras", "poses"), ("cameras", "images", "lenses")]
)
def test_a_model_of_which_a_file_was_not_copied_says_so(
    command, tmp_path, write, lost, kept, holds
):
    write_images(tmp_path / "images")
    model = tmp_path / "sparse" / "0"
    write(model, turn(), "PINHOLE")
    (there,) = model.glob(f"{lost}.*")
    there.unlink()
    there.mkdir()
    (tmp_path / "poses_bounds.npy").touch()
    words = f"/{kept}{there.suffix} has no {there.name} beside it, where a model of COLMAP has its"
    refused(command, tmp_path, f"{model}{words} {holds}")
    (tmp_path / "poses_bounds.npy").unlink()
    refused(command, model, f"{model}{words} {holds}")


def test_cameras_and_images_of_a_model_are_of_one_kind(command, tmp_path):
    write_images(tmp_path / "images")
    write_binary(tmp_path / "sparse", turn(), "PINHOLE")
    (tmp_path / "sparse" / "cameras.bin").rename(tmp_path / "sparse" / "cameras.txt")
    refused(command, tmp_path, "/sparse/images.bin has no cameras.bin beside it")


@pytest.mark.parametrize("empty", ["test", "train"])
def test_a_part_without_frames_is_remarked_upon(command, tmp_path, empty):
    write_images(tmp_path / "images")
    write_transforms(tmp_path, turn())
    (tmp_path / "transforms.json").rename(tmp_path / "transforms_val.json")
    (tmp_path / f"transforms_{empty}.json").write_text('{"frames": []}')
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert f"/transforms_{empty}.json lists no frames" in out
    assert f"unit and origin of {tmp_path}/transforms_val.json are arbitrary" in out
    assert "/image 12" in out


def test_parts_of_which_none_has_frames_are_refused(command, tmp_path):
    write_images(tmp_path / "images")
    for part in ("train", "test"):
        (tmp_path / f"transforms_{part}.json").write_text('{"frames": []}')
    refused(command, tmp_path, "transforms_train.json: 'frames' must be a list with at least one")
