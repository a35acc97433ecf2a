"""scan without a board, as a user calls it, on rendered views of a turn."""

import inspect
import json
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from turned import RIG, images_of

from occ_recon_ros.bags.photographs import find_masks, open_pictures
from occ_recon_ros.bags.scan_bag import LONG_SIDE, made_small_lines, write_scan_bag
from occ_recon_ros.bags.turn_scanning import find_turn
from occ_recon_ros.bags.turn_steps import ALIKE
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.cli import board_scan, boards
from occ_recon_ros.cli.app import run
from occ_recon_ros.errors import UserError
from occ_recon_ros.poses.camera_yaml import camera_to_yaml, read_camera
from occ_recon_ros.scene import make_object, render, turntable_cameras


@pytest.fixture
def lens(tmp_path):
    """A file that tells the lens: without it is found as well, in twice the time."""
    file = tmp_path / "camera.yaml"
    file.write_text(camera_to_yaml(turntable_cameras(RIG)[0]))
    return file


@pytest.fixture
def photographs(tmp_path):
    folder = tmp_path / "photographs"
    folder.mkdir()
    for k, camera in enumerate(turntable_cameras(RIG)):
        cv2.imwrite(str(folder / f"{k}.png"), render(make_object("gourd"), camera))
    return folder


@pytest.mark.slow
def test_photographs_of_a_turn_become_a_body_of_unknown_size(tmp_path, photographs, capsys) -> None:
    out = tmp_path / "out"
    arguments = ["scan", str(photographs), "--turn", "360", "--distance", "2", "--out", str(out)]
    assert run([*arguments, "--set", "mesher.body_cells=64"]) == 0
    said = capsys.readouterr().out
    assert "the unit is arbitrary" in said
    assert "2 m from the axis" in said
    assert "arbitrary" in (out / "report.html").read_text()
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"]["word"] == "good"
    assert report["source"]["turn"]["elevation_deg"] == pytest.approx(30, abs=1)
    assert report["source"]["turn"]["assumed_distance_m"] == 2
    assert report["source"]["turn"]["names"][9:11] == ["9.png", "10.png"]
    assert read_camera(out / "camera.yaml").K[0, 0] == pytest.approx(RIG.focal_px, rel=0.05)
    # The cameras were 1 m away from the middle, by cos 30 degrees from the axis.
    larger = 2 / np.cos(RIG.elevation)
    body = trimesh.load(out / "closed.ply")
    true = make_object("gourd").mesh(64)
    assert body.volume / true.volume == pytest.approx(larger**3, rel=0.05)
    assert (out / "scan.mcap").exists()


@pytest.mark.slow
def test_a_video_is_begun_and_ended_by_hand_and_turns_by_about_what_is_told(tmp_path) -> None:
    file = tmp_path / "turn.avi"
    video = cv2.VideoWriter(
        str(file), cv2.VideoWriter_fourcc(*"MJPG"), 30, (RIG.width, RIG.height), isColor=False
    )
    for image in images_of(330.0, 24, still=(7, 5)):
        video.write(image)
    video.release()
    found = find_turn(open_pictures(str(file)), None, None, 360.0, 1.0, lambda *_: None)
    assert found.report["turned_deg"] == pytest.approx(21 * 330 / 24, rel=0.005)
    assert found.report["still_images"] == 14  # those, and the ones on which they begin and end
    assert len(found.names) == 36 - 14
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    steps = [
        Rotation.from_matrix(a.R_camera_object.T @ b.R_camera_object).magnitude()
        for a, b in pairwise(found.axis.cameras)
    ]
    assert np.rad2deg(steps) == pytest.approx(np.full(len(steps), 330 / 24), rel=0.005)
    said = "\n".join(found.lines)
    assert "in 14 images the table stood still" in said
    assert "the table turned by 28" in said


@pytest.mark.slow
def test_a_folder_as_it_comes_from_a_camera_names_what_is_of_no_use(tmp_path) -> None:
    for k, image in enumerate(images_of(360.0, 12)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    cv2.imwrite(str(tmp_path / "a dog.jpg"), np.zeros((300, 200, 3), np.uint8))  # sorted first
    for k in (0, 5, 11):
        damaged = tmp_path / f"{k}.png"
        damaged.write_bytes(damaged.read_bytes()[:400])
    (tmp_path / "notes.txt").write_text("a gourd")
    (tmp_path / "._3.png").write_bytes(b"\0\5\x16\7" * 40)  # as macOS leaves them: no steps
    (tmp_path / "raw.jpg").mkdir()
    found = find_turn(open_pictures(str(tmp_path)), None, None, 360.0, 1.0, lambda *_: None)
    assert found.names == [f"{k}.png" for k in range(12) if k not in (0, 5, 11)]
    assert [line for line in found.lines if "left out" in line] == [
        "left out: a dog.jpg: 200x300 and not 320x240",
        "left out: 0.png: truncated or damaged",
        "left out: 5.png: truncated or damaged",
        "left out: 11.png: truncated or damaged",
    ]
    # Those that are damaged are steps as well, the first and the last of the turn too.
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)


@pytest.mark.slow
def test_photographs_whose_masks_cannot_be_used_are_left_out_by_name(tmp_path, lens) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    for k, image in enumerate(images_of(360.0, 12)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
        cv2.imwrite(str(masks / f"{k}.png"), np.uint8(255) * np.uint8(image != image[0, 0]))
    (masks / "3.png").unlink()
    (masks / "5.png").write_bytes((masks / "5.png").read_bytes()[:60])
    found = find_turn(open_pictures(str(tmp_path)), lens, masks, 360.0, 1.0, lambda *_: None)
    assert found.names == [f"{k}.png" for k in range(12) if k not in (3, 5)]
    left_out = found.report["left_out"]
    assert left_out["3.png"] == "without a mask"
    assert "truncated or damaged" in left_out["5.png"]
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    for file in masks.glob("[124].png"):
        cv2.imwrite(str(file), ~cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
    some = find_masks(masks, [f"{k}.png" for k in range(12)])
    assert len(some) == 11, "a few that are inverted are no mistake of all"
    with pytest.raises(UserError, match="3 of 4 masks are white all along the border"):
        find_masks(masks, [f"{k}.png" for k in (1, 2, 4, 6)])


@pytest.mark.parametrize(
    ("there", "used"),
    [
        (["IMG_5_mask.png"], "IMG_5_mask.png"),
        (["IMG_5.mask.png", "IMG_6.mask.png"], "IMG_5.mask.png"),
        (["IMG_5.JPG.png"], "IMG_5.JPG.png"),
        (["IMG_5.JPG_mask.png"], "IMG_5.JPG_mask.png"),
        (["IMG_5.png", "IMG_5_mask.png"], "IMG_5.png"),
        (["IMG_5.JPG.png", "IMG_5.PNG.png"], "IMG_5.JPG.png"),
        (["IMG_5_mask.png", "IMG_5-Mask.png", "IMG_6.png"], None),
    ],
)
def test_masks_may_have_usual_endings_where_one_is_meant(tmp_path, there, used) -> None:
    for name in there:
        cv2.imwrite(str(tmp_path / name), np.zeros((24, 32), np.uint8))
    found = find_masks(tmp_path, ["IMG_5.JPG", "IMG_6.JPG"])
    assert found.get("IMG_5.JPG") == (tmp_path / used if used else None)


def test_masks_of_other_names_are_said_by_an_example(tmp_path) -> None:
    for k in (5, 12):
        cv2.imwrite(str(tmp_path / f"mask_{k:03d}.png"), np.zeros((24, 32), np.uint8))
    with pytest.raises(UserError, match=r"it holds mask_005\.png, wanted is IMG_5\.png"):
        find_masks(tmp_path, ["IMG_5.JPG", "IMG_12.JPG"])


@pytest.mark.parametrize("seen", [0, pytest.param(1, marks=pytest.mark.slow), 7])
def test_images_without_an_outline_are_said_to_be_too_few(tmp_path, seen) -> None:
    for k, image in enumerate(images_of(360.0, 12)):
        shown = image if k < seen else np.full_like(image, 200)
        cv2.imwrite(str(tmp_path / f"{k}.png"), shown)
    with pytest.raises(UserError, match=f": {seen} images can be used: 8 with an outline") as told:
        find_turn(open_pictures(str(tmp_path)), None, None, 360.0, 1.0, lambda *_: None)
    assert f". Left out: {seen}.png" in str(told.value)


def test_what_is_alike_is_named_where_too_few_are_left(tmp_path) -> None:
    images = images_of(360.0, 7)
    images.insert(5, images[4])
    for k, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    words = (
        r"7 images can be used: .* good\. Left out: 5\.png \(like the image before: the table stood"
    )
    with pytest.raises(UserError, match=words):
        find_turn(open_pictures(str(tmp_path)), None, None, 360.0, 1.0, lambda *_: None)


@pytest.mark.slow
def test_of_images_cut_out_of_their_backdrop_the_transparency_is_the_mask(tmp_path, lens) -> None:
    for k, image in enumerate(images_of(360.0, 12)):
        alpha = np.uint8(255) * np.uint8(image != image[0, 0])
        grey = np.where(alpha > 0, 40 + 170 * (np.arange(image.shape[1]) % 40 > 20), 0)
        cut_out = np.dstack([grey, grey, grey, alpha]).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"{k}.png"), cut_out)
    pictures = open_pictures(str(tmp_path))
    found = find_turn(pictures, lens, None, 360.0, 1.0, lambda *_: None)
    assert sorted(found.masks) == sorted(found.names)
    assert len(found.names) == 12
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    write_scan_bag(found.posed(pictures), 12, tmp_path / "scan.mcap", lambda *_: None, 0)
    views = BagViews(tmp_path / "scan.mcap")
    assert all(view.mask is not None for view in views)


@pytest.mark.slow
def test_wrong_outlines_that_are_alike_are_no_table_that_stood_still(tmp_path, lens) -> None:
    all_of_it = np.full((RIG.height, RIG.width), 255, np.uint8)
    all_of_it[[0, 1, -2, -1]] = all_of_it[:, [0, 1, -2, -1]] = 0
    masks = tmp_path / "masks"
    masks.mkdir()
    for k, image in enumerate(images_of(360.0, 12)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
        mask = np.uint8(255) * np.uint8(image != image[0, 0])
        cv2.imwrite(str(masks / f"{k}.png"), all_of_it if 4 <= k < 6 else mask)
    found = find_turn(open_pictures(str(tmp_path)), lens, masks, 360.0, 1.0, lambda *_: None)
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    assert found.report["turned_deg"] == pytest.approx(330)
    assert ALIKE not in found.left_out.values()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--turn 360"),
        (["--turn", "360", "--board", "board.yaml"], "--board and --turn are both given"),
        (["--turn", "360", "--step", "10"], "--step goes with --board"),
        (["--turn", "0"], "--turn a number of degrees"),
        (["--turn", "360", "--distance", "-1"], "--distance must be above 0"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, capsys, arguments, words) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((24, 32), np.uint8))
    assert run(["scan", str(tmp_path), *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("size", "kept", "said"),
    [
        (["--size", "100"], (100, 75), "320 px are made 100 px small"),
        pytest.param([], (320, 240), "", marks=pytest.mark.slow),
    ],
)
def test_photographs_are_made_as_small_as_told(
    tmp_path, photographs, lens, monkeypatch, capsys, size, kept, said
) -> None:
    def seen(*_) -> None:
        raise UserError("enough seen")

    monkeypatch.setattr(board_scan, "run_scan", seen)
    arguments = ["scan", str(photographs), "--turn", "360", "--camera-info", str(lens)]
    assert run([*arguments, "--out", str(tmp_path / "out"), *size]) == 2
    views = list(BagViews(tmp_path / "out.mcap"))
    assert {view.image.shape[1::-1] for view in views} == {kept}
    assert ("are made" in (lines := capsys.readouterr().out)) == bool(said)
    assert said in lines


def test_photographs_of_phones_are_made_smaller_and_those_are_said() -> None:
    default = inspect.signature(boards.scan).parameters["size"].default
    assert default == LONG_SIDE
    phone = replace(turntable_cameras(RIG)[0], width=4000, height=3000)
    assert "4000 px are made 2048 px small" in made_small_lines(phone, default)[0]
    assert made_small_lines(phone, 0) == made_small_lines(phone, 4000) == []
