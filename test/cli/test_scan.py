"""board, scan and calibrate as a user calls them, on rendered views."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from occ_recon_ros.cli.app import run

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "poses"))

from rendered import CHARUCO, photograph, view

from occ_recon_ros.poses import board_to_yaml


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


def test_the_camera_is_calibrated_from_a_folder(tmp_path, board, capsys) -> None:
    folder = write(tmp_path / "v", [photograph(CHARUCO, small(k), samples=2) for k in range(7)])
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
        (lambda: [photograph(CHARUCO, small(1), samples=2)[:, ::-1].copy()] * 3, "mirrored"),
        (lambda: [cv2.hconcat([photograph(CHARUCO, small(1), samples=2)] * 2)] * 3, "two boards"),
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


def test_a_missing_board_file_says_how_to_make_one(tmp_path, capsys) -> None:
    assert run(["scan", str(tmp_path), "--board", str(tmp_path / "none.yaml")]) == 2
    assert "occ-recon board" in capsys.readouterr().err
