"""import: poses as COLMAP and the makers of transforms.json write them, by formulas of our own."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from colmap_nerf import (
    FISHEYES,
    MODELS,
    SCALE,
    SHIFT,
    D,
    N,
    Q,
    elsewhere,
    frames_of,
    mixed,
    name,
    turn,
    write_binary,
    write_images,
    write_text,
    write_transforms,
)

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera

PIXELS = np.array([[0.0, 0], [95, 0], [40.25, 60.5], [0, 71], [95, 71]])


def check(
    bag: Path,
    cameras: list[Camera],
    out: str,
    K: np.ndarray | None = None,
    shift: np.ndarray = SHIFT,
) -> None:
    """The bag holds these cameras in the other world, which was made smaller and moved to what
    they look at, in order."""
    found = list(BagViews(bag).cameras().values())
    assert len(found) == len(cameras)
    unit = 1 / (SCALE * 0.8)
    said = re.search(r"unit and origin of \S+ are arbitrary.* one unit is (\S+) m.*\((.*)\)", out)
    assert float(said.group(1)) == pytest.approx(unit, rel=0.03)
    others = [elsewhere(c, shift)[1] for c in cameras]
    unit = np.linalg.norm(np.ptp([c.centre for c in found], axis=0)) / np.linalg.norm(
        np.ptp(others, axis=0)
    )
    assert unit == pytest.approx(float(said.group(1)), rel=1e-3)
    origin = np.array(said.group(2).split(", "), float)
    np.testing.assert_allclose(origin, shift, atol=0.05 / unit)
    offset = np.mean([c.centre for c in found], axis=0) - unit * np.mean(others - origin, axis=0)
    np.testing.assert_allclose(offset, 0, atol=1e-3)
    tiny = max(1e-8, 1e-15 * np.abs(shift).max())
    for there, given in zip(found, cameras, strict=True):
        R, centre = elsewhere(given, shift)
        np.testing.assert_allclose(there.R_camera_object, R, atol=1e-9)
        np.testing.assert_allclose(there.centre, unit * (centre - origin) + offset, atol=tiny)
        np.testing.assert_allclose(there.K, given.K if K is None else K, atol=1e-9)
        if K is None:
            rays, before = there.viewing_directions(PIXELS), given.viewing_directions(PIXELS)
            np.testing.assert_allclose(rays, before @ Q.T, atol=1e-9)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("write", [write_text, write_binary])
def test_a_model_of_colmap_is_what_was_written(command, tmp_path, write, kind):
    cameras = turn(MODELS[kind][1], square="OPENCV" not in kind and kind != "PINHOLE")
    write(tmp_path / "sparse" / "0", cameras, kind)
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "left out" not in out
    check(tmp_path / "a.mcap", cameras, out)
    shown = [int(view.image[0, 0]) for view in BagViews(tmp_path / "a.mcap")]
    assert shown == [10 + k for k in range(N)]


def stretched(model: Path, by: np.ndarray) -> None:
    """The quaternions of a text model, times a number each."""
    lines = (model / "images.txt").read_text().split("\n")
    for k, factor in enumerate(by):
        words = lines[1 + 2 * k].split(" ")
        words[1:5] = [str(factor * float(word)) for word in words[1:5]]
        lines[1 + 2 * k] = " ".join(words)
    (model / "images.txt").write_text("\n".join(lines))


def test_quaternions_that_are_a_little_long_or_short_are_made_unit(command, tmp_path):
    cameras = turn()
    write_images(tmp_path / "images")
    write_text(tmp_path / "sparse", cameras, "PINHOLE")
    stretched(tmp_path / "sparse", np.array([1.01, 0.97, *[1.0005] * (N - 2)]))
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "sparse: the quaternions of 2 of 12 images differ from length 1 by up to 3 %" in out
    check(tmp_path / "a.mcap", cameras, out)


def test_of_the_images_that_are_taken_alone_quaternions_are_counted(command, tmp_path):
    write_images(tmp_path / "images")
    (tmp_path / "images" / name(mixed(turn())[0])).unlink()
    write_text(tmp_path / "sparse", turn(), "PINHOLE")
    stretched(tmp_path / "sparse", np.array([1.04, 0.97, 1.06, *[1.0] * (N - 3)]))
    out = command("import", tmp_path, tmp_path / "a.mcap")[1]
    assert "sparse: the quaternions of 1 of 10 images differ from length 1 by up to 3 %" in out


def test_quaternions_that_three_digits_leave_unequal_to_1_are_not_worth_a_word(command, tmp_path):
    write_images(tmp_path / "images")
    write_text(tmp_path / "sparse", turn(), "PINHOLE")
    stretched(tmp_path / "sparse", np.full(N, 1.0005))
    assert "from length 1" not in command("import", tmp_path, tmp_path / "a.mcap")[1]


@pytest.mark.parametrize("coefficients", [0, 4, 5])
def test_transforms_json_is_what_was_written(command, tmp_path, coefficients):
    cameras = [
        replace(c, D=np.array(D[:coefficients]), distortion="plumb_bob") for c in turn(square=False)
    ]
    write_transforms(tmp_path, cameras)
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check(tmp_path / "a.mcap", cameras, out)


@pytest.mark.parametrize("more", [{"fl_y": 130.0}, {"camera_angle_y": 2 * np.arctan(36 / 130)}])
def test_pixels_are_square_where_one_focal_length_is_given(command, tmp_path, more):
    write_transforms(tmp_path, turn(), **{"fl_x": None, "fl_y": None, **more})
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check(tmp_path / "a.mcap", turn(), out)


def matrix(camera: Camera, n: int = 3) -> list[list[float]]:
    """K as (0, 0) at the corner of the first pixel has it."""
    K = np.eye(n)
    K[:2, :2], K[:2, 2] = camera.K[:2, :2], camera.K[:2, 2] + 0.5
    return K.tolist()


NO_NUMBERS = {"fl_x": None, "fl_y": None, "cx": None, "cy": None}


@pytest.mark.parametrize(("key", "n"), [("K", 3), ("intrinsics", 4), ("camera_matrix", 3)])
@pytest.mark.parametrize("of_each", [True, False])
@pytest.mark.parametrize("flat", [True, False])
def test_intrinsics_may_be_a_matrix(command, tmp_path, key, n, of_each, flat):
    cameras = turn(square=False)
    rows = matrix(cameras[0], n)
    K = {key: np.ravel(rows).tolist() if flat else rows}
    frames = [entry | (K if of_each else {}) for entry in frames_of(cameras)]
    write_transforms(tmp_path, cameras, frames=frames, **NO_NUMBERS, **({} if of_each else K))
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check(tmp_path / "a.mcap", cameras, out)


@pytest.mark.parametrize(("place", "off"), [((0, 1), 0.05), ((1, 0), 5e-7), ((2, 2), 5e-7)])
def test_a_matrix_may_be_a_little_aslant_or_rounded(command, tmp_path, place, off):
    K = np.array(matrix(turn()[0]))
    K[place] += off
    write_transforms(tmp_path, turn(), K=K.tolist(), **NO_NUMBERS)
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check(tmp_path / "a.mcap", turn(), out)


def test_the_matrix_of_a_frame_comes_before_that_of_all(command, tmp_path):
    frames = frames_of(turn())
    for entry in frames:
        entry["intrinsics"] = matrix(turn()[0])
    frames[mixed(turn()).index(5)]["intrinsics"] = [1.0, 2.0, 3.0, 4.0]  # of another maker
    del frames[mixed(turn()).index(6)]["intrinsics"]
    of_all = [[99.0, 0.0, 46.0], [0.0, 99.0, 36.0], [0.0, 0.0, 1.0]]
    write_transforms(tmp_path, turn(), frames=frames, K=of_all, **NO_NUMBERS)
    write_images(tmp_path / "images")
    assert command("import", tmp_path, tmp_path / "a.mcap")[0] == 0
    found = [camera.K[0, 0] for camera in BagViews(tmp_path / "a.mcap").cameras().values()]
    assert found == [{5: 99.0, 6: 99.0}.get(k, 130.0) for k in range(N)]


@pytest.mark.parametrize("told", ["fl_x", "camera_angle_x"])
@pytest.mark.parametrize(
    "other",
    [
        np.eye(4).tolist(),  # a pose
        [[1.35, 0.0, 0.48], [0.0, 1.8, 0.51], [0.0, 0.0, 1.0]],
        [[260.0, 0.0, 92.0], [0.0, 260.0, 70.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0], [0.0, 1.0]],
    ],
)
def test_a_matrix_says_nothing_where_numbers_tell_the_lens(command, tmp_path, told, other):
    cameras = turn()
    of_all = NO_NUMBERS | {told: 130.0 if told == "fl_x" else 0.7, "camera_matrix": other}
    frames = [entry | {"K": other} for entry in frames_of(cameras)]
    write_transforms(tmp_path, cameras, frames=frames, **of_all)
    path = tmp_path / "transforms.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps({k: v for k, v in content.items() if v is not None}))
    write_images(tmp_path / "images")
    code, _, error = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 0, error
    width, height = cameras[0].width, cameras[0].height
    focal = 130.0 if told == "fl_x" else 0.5 * width / np.tan(0.35)
    for camera in BagViews(tmp_path / "a.mcap").cameras().values():
        np.testing.assert_allclose(np.diag(camera.K)[:2], focal)
        np.testing.assert_allclose(camera.K[:2, 2], [width / 2 - 0.5, height / 2 - 0.5])


def test_a_matrix_in_shares_of_the_image_is_refused(command, tmp_path):
    shares = [[1.35, 0.0, 0.48], [0.0, 1.8, 0.51], [0.0, 0.0, 1.0]]
    write_transforms(tmp_path, turn(), K=shares, **NO_NUMBERS)
    write_images(tmp_path / "images")
    code, _, error = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 2
    assert "K must be in pixels" in error


def test_a_frame_may_have_its_own_intrinsics(command, tmp_path):
    frames = frames_of(turn())
    frames[mixed(turn()).index(4)]["fl_x"] = 131.0
    write_transforms(tmp_path, turn(), frames=frames)
    write_images(tmp_path / "images")
    assert command("import", tmp_path, tmp_path / "a.mcap")[0] == 0
    found = [camera.K[0, 0] for camera in BagViews(tmp_path / "a.mcap").cameras().values()]
    assert found == [131.0 if k == 4 else 130.0 for k in range(N)]


def test_matrices_may_be_of_three_rows_and_three_digits(command, tmp_path):
    frames = frames_of(turn())
    for entry in frames:
        entry["transform_matrix"] = np.round(entry["transform_matrix"][:3], 3).tolist()
    write_transforms(tmp_path, turn(), frames=frames)
    write_images(tmp_path / "images")
    assert command("import", tmp_path, tmp_path / "a.mcap")[0] == 0
    found = BagViews(tmp_path / "a.mcap").cameras().values()
    for there, given in zip(found, turn(), strict=True):
        R = there.R_camera_object
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(R, elsewhere(given)[0], atol=2e-3)


def check_fisheyes(bag: Path, cameras: list[Camera], coefficients: int) -> None:
    """They project as OpenCV does, far to the side too."""
    X = np.random.default_rng(0).uniform([-4, -3, 0.5], [4, 3, 2], (40, 3))
    bent = np.array(D[:coefficients] + (0.0,) * (4 - coefficients))
    found = list(BagViews(bag).cameras().values())
    assert len(found) == len(cameras)
    for there, given in zip(found, cameras, strict=True):
        expected = cv2.fisheye.projectPoints(X[:, None], np.zeros(3), np.zeros(3), given.K, bent)[0]
        points = there.centre + X @ there.R_camera_object
        np.testing.assert_allclose(there.project(points), expected[:, 0], atol=1e-8)


@pytest.mark.parametrize("kind", FISHEYES)
@pytest.mark.parametrize("write", [write_text, write_binary])
def test_fisheyes_of_colmap_project_as_those_of_opencv(command, tmp_path, write, kind):
    cameras = turn(square=kind.startswith(("SIMPLE", "RADIAL")))
    write(tmp_path / "sparse", cameras, kind)
    write_images(tmp_path / "images")
    code, _, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check_fisheyes(tmp_path / "a.mcap", cameras, FISHEYES[kind][1])


@pytest.mark.parametrize("said", [{"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_a_fisheye_of_transforms_json_projects_as_that_of_opencv(command, tmp_path, said):
    cameras = turn(square=False)
    names = dict(zip(("k1", "k2", "k3", "k4"), D, strict=False))
    write_transforms(tmp_path, cameras, **said, **names)
    write_images(tmp_path / "images")
    code, _, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check_fisheyes(tmp_path / "a.mcap", cameras, 4)


EARTH = np.array([4156305.25, 671404.5, 4774508.75])  # of its middle, as georeferenced models are


def test_a_model_far_from_its_origin_is_moved_to_what_the_cameras_look_at(command, tmp_path):
    cameras = turn()
    write_binary(tmp_path / "sparse", cameras, "PINHOLE", EARTH)
    write_images(tmp_path / "images")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    check(tmp_path / "a.mcap", cameras, out, shift=EARTH)


def test_parts_of_blender_have_an_angle_only_and_names_without_suffix(command, tmp_path):
    cameras = turn()
    frames = frames_of(cameras)
    angle = 2 * np.arctan(48 / 130)
    (tmp_path / "train").mkdir()
    for k in range(N):
        alpha = np.zeros((72, 96), np.uint8)
        alpha[20:50, 30:60] = 255
        picture = np.dstack([np.full((72, 96, 3), 10 + k, np.uint8), alpha])
        cv2.imwrite(str(tmp_path / "train" / f"r_{k}.png"), picture)
    for entry, k in zip(frames, mixed(cameras), strict=True):
        entry["file_path"] = f"./train/r_{k}"
    for part, some in (("train", frames[:8]), ("test", frames[8:])):
        content = {"camera_angle_x": angle, "frames": some}
        (tmp_path / f"transforms_{part}.json").write_text(json.dumps(content))
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    # The middle of the image is that of its edges.
    check(tmp_path / "a.mcap", cameras, out, np.array([[130, 0, 47.5], [0, 130, 35.5], [0, 0, 1]]))
    assert "/mask 12" in out


@pytest.mark.parametrize("size", [(24, 18), (20, 15), (19, 15), (192, 144)])
def test_copies_of_another_size_scale_the_calibration(command, tmp_path, size):
    cameras = turn(1)
    write_text(tmp_path / "sparse", cameras, "SIMPLE_RADIAL")
    write_images(tmp_path / "images_4", size=size)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert f"12 images are of another size than their calibration ({size[0]}x{size[1]}, not" in out
    (sx, sy), K = np.array(size) / (96, 72), cameras[0].K
    corner = [sx * (K[0, 2] + 0.5), sy * (K[1, 2] + 0.5)]
    scaled = [[sx * 130, 0, corner[0] - 0.5], [0, sy * 130, corner[1] - 0.5], [0, 0, 1]]
    check(tmp_path / "a.mcap", cameras, out, np.array(scaled))


def test_images_and_a_model_need_not_be_the_same(command, tmp_path):
    cameras = turn()
    write_binary(tmp_path / "colmap" / "sparse" / "0", cameras, "PINHOLE")
    write_images(tmp_path / "images", N + 7)
    (tmp_path / "images" / name(3)).unlink()
    (tmp_path / "images" / name(4)).rename(tmp_path / "images" / "view 4.JPG")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "/image 11" in out
    assert f"left out: {tmp_path}/colmap/sparse/0: view 3.png is not in {tmp_path} or" in out
    assert "7 images have no camera in" in out
    assert "view 12.png, view 13.png, view 14.png, view 15.png, view 16.png, ..." in out


@pytest.mark.parametrize("masks", ["masks", "{}.png", "mask_path"])
def test_masks_beside_the_images_are_taken(command, tmp_path, masks):
    cameras = turn()
    write_images(tmp_path / "images")
    drawn = np.zeros((72, 96), np.uint8)
    drawn[20:50, 30:60] = 255
    folder = tmp_path / ("m" if masks == "mask_path" else "masks")
    folder.mkdir()
    frames = frames_of(cameras)
    for k, entry in zip(mixed(cameras), frames, strict=True):
        drawn[20, 30 + k] = 0
        file = folder / (f"{name(k)}.png" if "{" in masks else name(k))
        cv2.imwrite(str(file), drawn)
        if masks == "mask_path":
            entry["mask_path"] = f"m/{name(k)}"
    write_transforms(tmp_path, cameras, frames=frames)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "/mask 12" in out
    assert "/mask" not in command("import", tmp_path, tmp_path / "b.mcap", "--no-masks")[1]


def test_cameras_json_comes_first_and_a_model_before_transforms_json(command, folder, tmp_path):
    cameras = turn()
    write_transforms(folder.path, turn())
    write_text(folder.path / "sparse" / "0", cameras, "PINHOLE")
    code, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 0
    assert out.count("\n") == 1
    (folder.path / "cameras.json").unlink()
    write_images(folder.path / "images")
    code, out, _ = command("import", folder.path, tmp_path / "b.mcap")
    assert code == 0
    assert "the cameras are those of" in out
    assert "/sparse/0, not of" in out


def test_of_the_parts_that_colmap_could_not_join_the_largest_is_taken(command, tmp_path):
    cameras = turn()
    write_binary(tmp_path / "sparse" / "0", cameras[:3], "PINHOLE")
    write_binary(tmp_path / "sparse" / "1", cameras, "PINHOLE")
    write_images(tmp_path / "images")
    code, out, _ = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 0
    assert "/image 12" in out
