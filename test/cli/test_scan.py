"""board, scan and calibrate as a user calls them, on rendered views."""

import json
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scenes.standing import Standing, cameras_around, lying_pebble
from sensor_msgs.msg import JointState

from occ_recon_ros.cli import board_scan
from occ_recon_ros.cli.app import run
from occ_recon_ros.cli.board_scan import Posed
from occ_recon_ros.cli.boards import further_steps
from occ_recon_ros.cli.replay import BagSource
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.image_quality import ImageQuality
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.second_look import SecondLook
from occ_recon_ros.evaluation.segmentation import Segmentation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "poses"))

from rendered import CHARUCO, GRID, photograph, view

from msg_adapters import encode_camera_info, encode_image, serialise
from msg_adapters.header import encode_header
from occ_recon_ros.bags.photographs import open_pictures
from occ_recon_ros.bags.scanning import find_poses, read_rig, with_masks
from occ_recon_ros.bags.writer import new_bag
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses import board_to_yaml
from occ_recon_ros.poses.axis import Turntable, read_turntable
from occ_recon_ros.poses.projection import difference
from occ_recon_ros.scene import SceneObject
from occ_recon_ros.scene.shapes import ball


@pytest.fixture
def board(tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(board_to_yaml(CHARUCO))
    return path


def write(folder, images):
    folder.mkdir()
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return str(folder)


def test_a_board_is_written_and_not_over_another(tmp_path, capsys) -> None:
    out = tmp_path / "b.pdf"
    assert run(["board", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    assert (tmp_path / "b.yaml").exists()
    assert run(["board", "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err


def small(k):
    return view(k * 0.9, 0.7 + 0.1 * (k % 5), 0.35, f=600.0, size=(640, 480))


@cache
def shots():
    """Seven photographs of the board, that nobody changes."""
    return [photograph(CHARUCO, small(k), samples=2) for k in range(7)]


def test_the_camera_is_calibrated_from_a_folder(tmp_path, board, capsys) -> None:
    folder = write(tmp_path / "v", shots())
    out = tmp_path / "camera.yaml"
    arguments = ["calibrate", "intrinsics", folder, "--board", str(board), "--out", str(out)]
    assert run(arguments) == 0
    assert "7 of 7 images" in capsys.readouterr().out
    assert out.exists()
    assert cv2.imread(str(out.with_suffix(".png"))) is not None


@pytest.mark.parametrize(
    ("images", "words"),
    [
        (lambda: [np.full((480, 640), 128, np.uint8)] * 3, "no board is in view"),
        (lambda: [shots()[1][:, ::-1].copy()] * 3, "mirrored"),
        (lambda: [cv2.hconcat([shots()[1]] * 2)] * 3, "two boards"),
    ],
    ids=["no board", "mirrored", "two boards"],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, board, capsys, images, words) -> None:
    folder = write(tmp_path / "v", images())
    code = run(["scan", folder, "--board", str(board), "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert code == 2
    assert words in error
    assert error.count("\n") == 1


def test_photographs_that_are_damaged_or_of_another_size_are_left_out_by_name(
    tmp_path, board
) -> None:
    folder = Path(write(tmp_path / "v", shots()))
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:1000])
    cv2.imwrite(str(folder / "a dog.png"), np.zeros((300, 200), np.uint8))  # sorted first
    spec, _ = read_rig(board)
    found = find_poses(open_pictures(str(folder)), spec, None, 0.0, lambda *_: None)
    assert found.poses.left_out == {"a dog.png": "other_size", "3.png": "damaged"}
    assert "1 of another size (a dog.png), 1 truncated or damaged (3.png)" in found.lines[1]


def test_photographs_without_a_mask_that_can_be_used_are_kept_and_named(tmp_path, board) -> None:
    folder = Path(write(tmp_path / "v", shots()))
    spec, _ = read_rig(board)
    found = find_poses(open_pictures(str(folder)), spec, None, 0.0, lambda *_: None)
    masks = Path(write(tmp_path / "m", [np.zeros((480, 640), np.uint8)] * 4))
    (masks / "1.png").unlink()
    (masks / "2.png").write_bytes((masks / "2.png").read_bytes()[:60])
    cv2.imwrite(str(masks / "3.png"), np.zeros((30, 30), np.uint8))
    masked = with_masks(found, masks, open_pictures(str(folder)))
    assert [posed.shot.name for posed in masked.poses.kept] == [f"{k}.png" for k in range(7)]
    assert [p.name for p in masked.posed(open_pictures(str(folder))) if p.mask] == ["0.png"]
    said = "\n".join(masked.lines)
    assert "masks not used: 2.png, 3.png: damaged, or of another size than their images" in said
    assert "6 images without a mask get theirs from all views together" in said
    assert masked.report["masks"] == {"used": 1, "not_used": ["2.png", "3.png"]}
    (masks / "0.png").unlink()
    with pytest.raises(UserError, match="no mask there can be used"):
        with_masks(found, masks, open_pictures(str(folder)))


@pytest.mark.slow
def test_a_sheet_in_the_older_layout_is_used_as_it_is_and_named(tmp_path, board) -> None:
    older = replace(CHARUCO, legacy=True)
    folder = write(tmp_path / "v", [photograph(older, small(k), samples=2) for k in range(7)])
    found = find_poses(open_pictures(folder), read_rig(board)[0], None, 0.0, lambda *_: None)
    assert found.poses.board == older
    assert any("older ChArUco layout: write legacy: true" in line for line in found.lines)
    again = find_poses(open_pictures(folder), older, None, 0.0, lambda *_: None)
    assert not any("layout" in line for line in again.lines)


@pytest.mark.slow
def test_a_frame_of_markers_is_taken_for_one_and_named(tmp_path) -> None:
    middle = tuple(5 * row + column for row in range(1, 6) for column in (1, 2, 3))
    scene = Standing(lying_pebble(), replace(GRID, not_printed=middle))
    cameras = [view(0.785 * k, 0.7, 0.5, 420.0, (480, 360)) for k in range(8)]
    folder = write(tmp_path / "v", [scene.photograph(c, k, 2) for k, c in enumerate(cameras)])
    found = find_poses(open_pictures(folder), GRID, cameras[0], 0.0, lambda *_: None)
    assert found.poses.board == scene.board
    assert "markers 6-8, 11-13, 16-18, 21-23, 26-28 are seen in no image" in found.lines[-1]
    assert found.report["not_printed"] == list(middle)
    # Board.yaml may say so.
    again = find_poses(open_pictures(folder), scene.board, cameras[0], 0.0, lambda *_: None)
    assert again.poses.board == scene.board
    assert not any("seen in no image" in line for line in again.lines)


def test_copies_of_a_photograph_do_not_calibrate_a_camera(tmp_path, board, capsys) -> None:
    folder = write(tmp_path / "v", shots())
    for k in range(7, 10):
        (Path(folder) / f"{k}.png").write_bytes((Path(folder) / "2.png").read_bytes())
    out = tmp_path / "camera.yaml"
    arguments = ["calibrate", "intrinsics", folder, "--board", str(board), "--out", str(out)]
    assert run(arguments) == 0
    said = capsys.readouterr().out
    assert "7 of 10 images" in said
    assert "3 images are copies of what another shows, and left out (7.png, 8.png, " in said


@pytest.mark.slow
def test_a_gap_that_is_not_that_of_the_sheet_calibrates_no_camera(tmp_path, capsys) -> None:
    sheet = [photograph(GRID, small(k), samples=2) for k in range(7)]
    folder, board, out = write(tmp_path / "v", sheet), tmp_path / "b.yaml", tmp_path / "camera.yaml"
    board.write_text(board_to_yaml(replace(GRID, gap_m=0.014)))
    arguments = ["calibrate", "intrinsics", folder, "--board", str(board), "--out", str(out)]
    assert run(arguments) == 2
    error = capsys.readouterr().err
    assert "gaps between them measure about 8 mm where board.yaml says 14 mm" in error
    assert not out.exists()


def test_a_picture_of_a_board_is_no_board_file(tmp_path, capsys) -> None:
    picture = tmp_path / "b.jpg"
    picture.write_bytes(b"\xff\xd8\xff\xe0")
    assert run(["scan", str(tmp_path), "--board", str(picture)]) == 2
    assert "b.jpg is no text: give a YAML file" in capsys.readouterr().err


def test_a_missing_board_file_says_how_to_make_one(tmp_path, capsys) -> None:
    assert run(["scan", str(tmp_path), "--board", str(tmp_path / "none.yaml")]) == 2
    assert "occ-recon board" in capsys.readouterr().err


@pytest.mark.usefixtures("coarse")
def test_photographs_of_a_thing_on_a_board_become_its_surface(tmp_path, board, monkeypatch) -> None:
    looks = []

    def source(*arguments, steps):
        looks.extend(type(step) for step in steps)
        return BagSource(*arguments, steps=steps)

    monkeypatch.setattr(board_scan, "BagSource", source)
    # A smaller one lies beside the sheet.
    body, beside = lying_pebble(), ball((0.02, 0.02, 0.015), (0.16, 0.0, 0.015))
    scene = Standing(SceneObject("two", (*body.parts, beside)), CHARUCO)
    cameras = cameras_around(8, (320, 240), 420.0)
    folder = write(tmp_path / "v", [scene.photograph(c, k, 2) for k, c in enumerate(cameras)])
    out = tmp_path / "out"
    few_cells = ("--set", "mesher.body_cells=48", "--quiet")
    assert run(["scan", folder, "--board", str(board), "--out", str(out), *few_cells]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["source"]["segmentation"]["way"] == "joint"
    assert looks == [Segmentation, Refine, SecondLook, Misplaced, Posed, ImageQuality]
    names = sorted(path.name for path in Path(folder).iterdir())
    expected = {"images": 8, "used": 8, "left_out": {}, "names": names}
    assert report["source"]["board"] == expected
    assert report["verdict"]["word"] == "good"
    off = np.abs(body.distance(np.asarray(trimesh.load(out / "rims.ply").vertices)))
    # A pixel is 1 mm at the pebble.
    assert len(off) > 300
    assert 1e3 * np.median(off) < 0.4
    low, high = trimesh.load(out / "closed.ply").bounds
    assert low[2] > -1e-9  # the board is at 0
    assert high[0] < 0.05
    assert (out / "scan.mcap").exists()


def test_advice_that_scan_has_no_option_for_comes_with_the_command_that_has_it() -> None:
    verdict = {"word": "doubtful", "reasons": ["off"], "advice": ["try --segment joint, or a box"]}
    command = (
        "  with these: occ-recon replay 'my cup/scan.mcap' --segment joint --out 'my cup_again'"
    )
    assert further_steps(verdict, Path("my cup")) == [command]
    assert further_steps({"reasons": ["try --refine"], "advice": []}, Path("cup"))[0].endswith(
        "cup/scan.mcap --refine --out cup_again"
    )
    leaving = "leave it out: --segment joint --set contour_tracker.volume_z=-0.02"
    assert (
        "--segment joint --set contour_tracker.volume_z=-0.02 --out"
        in further_steps(verdict | {"advice": [*verdict["advice"], leaving]}, Path("cup"))[0]
    )
    assert further_steps(verdict | {"advice": ["more light"]}, Path("cup")) == []


# The axis of a turntable.

AXIS = np.array([0.05, -0.03, 1.0]) / np.linalg.norm([0.05, -0.03, 1.0])
POINT = np.array([0.012, -0.02, 0.0])


def turning(slip_at=99):
    """Views of a board on a table with a tilted axis; what an encoder says that counts against
    it, begins at 1 and may slip by 3 degrees."""
    first = small(1)
    base = CameraPose(first.R_camera_object.T, first.centre)
    table = Turntable(POINT - (POINT @ AXIS) * AXIS, AXIS, base)
    for k in range(13):
        phi = np.deg2rad(25.0 * k)
        encoder = 1.0 - phi + np.deg2rad(3.0) * (k >= slip_at)
        yield first.at(table.camera_at(phi)), encoder


@cache
def photographs():
    """Of the board, as the turn shows it."""
    views = enumerate(turning())
    return [photograph(CHARUCO, camera, samples=2, seed=k) for k, (camera, _) in views]


def record_turn(bag, slip_at=99):
    with new_bag(bag, "mcap") as writer:
        for k, (camera, encoder) in enumerate(turning(slip_at)):
            stamp = (k + 1) * 10**9
            image = photographs()[k]
            for late in (-(10**8), 10**8):
                joint = JointState(
                    header=encode_header(stamp + late, ""),
                    name=["wheel", "table"],
                    position=[0.3 * k, encoder],
                )
                writer.write(
                    "/joint_states", "sensor_msgs/msg/JointState", stamp + late, serialise(joint)
                )
            for topic, kind, message in (
                ("/camera_info", "CameraInfo", encode_camera_info(camera, stamp, "camera")),
                ("/image", "Image", encode_image(image, stamp, "camera")),
            ):
                writer.write(topic, f"sensor_msgs/msg/{kind}", stamp, serialise(message))
    return str(bag)


@pytest.mark.slow
def test_the_axis_of_a_table_is_found_with_its_encoder(tmp_path, board, capsys) -> None:
    bag, out = record_turn(tmp_path / "turn.mcap"), tmp_path / "axis.yaml"
    arguments = ["calibrate", "axis", bag, "--board", str(board), "--joint", "table"]
    assert run([*arguments, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "13 of 13 images" in said
    assert "counts against the axis" in said
    assert "slipped" not in said
    table = read_turntable(out)
    assert np.rad2deg(np.arccos(min(1.0, table.direction @ AXIS))) < 0.1
    off = table.point - POINT
    assert np.linalg.norm(off - (off @ AXIS) * AXIS) < 0.2e-3
    for camera, encoder in turning():
        error = difference(table.camera_at(encoder), camera.pose)
        assert np.linalg.norm(error[:3]) < 0.5e-3


@pytest.mark.slow
def test_an_encoder_that_slips_is_told_of(tmp_path, board, capsys) -> None:
    bag = record_turn(tmp_path / "turn.mcap", slip_at=6)
    arguments = ["calibrate", "axis", bag, "--board", str(board), "--joint", "table"]
    assert run([*arguments, "--out", str(tmp_path / "axis.yaml")]) == 0
    assert "slipped before 7.000 s" in capsys.readouterr().out


def test_a_joint_that_is_not_there_is_named(tmp_path, board, capsys) -> None:
    bag = record_turn(tmp_path / "turn.mcap")
    arguments = ["calibrate", "axis", bag, "--board", str(board), "--joint", "arm"]
    assert run([*arguments, "--out", str(tmp_path / "axis.yaml")]) == 2
    assert "'arm' is not among wheel, table" in capsys.readouterr().err
