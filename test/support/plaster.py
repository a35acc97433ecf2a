"""Recorded turns of a plaster figure and of a toy, made small, how masks of them are judged, and a
joint pass that is rougher where a test asks for something else."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from occ_recon_ros.geometry import Camera


def iou(a, b):
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def half_as_large(image):
    return cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def halved(source, folder, step):
    """Write every so many view of a recorded turn half as large, its mask as an array beside it;
    what is then known of them, without masks."""
    content = json.loads((source / "cameras.json").read_text())
    content["frames"] = content["frames"][::step]
    for frame in content["frames"]:
        image = cv2.imread(str(source / frame["file"]))
        frame["file"] = Path(frame["file"]).name
        cv2.imwrite(str(folder / frame["file"]), half_as_large(image))
        mask = cv2.imread(str(source / frame.pop("mask")), 0)
        np.save(folder / f"{frame['file']}.npy", half_as_large(mask) > 127)
        frame["width"], frame["height"] = frame["width"] // 2, frame["height"] // 2
        K = np.array(frame["K"])
        K[:2] /= 2
        K[:2, 2] -= 0.25
        frame["K"] = K.tolist()
    (folder / "cameras.json").write_text(json.dumps(content))
    return folder


@pytest.fixture(scope="module")
def plaster(shared_data, tmp_path_factory):
    """Every fourth view of a plaster figure before black cloth, half as large, without masks."""
    return halved(shared_data / "dino_ring", tmp_path_factory.mktemp("plaster"), 4)


@pytest.fixture(scope="module")
def toy(shared_data, tmp_path_factory):
    """Every fourth view of a toy dinosaur before blue paper, half as large, without masks."""
    return halved(shared_data / "oxford_dino", tmp_path_factory.mktemp("toy"), 4)


def write_mask(folder, name, mask):
    """Write a mask (h, w), bool, into a folder; its name."""
    cv2.imwrite(str(folder / name), np.uint8(255) * mask)
    return name


def views_in(folder):
    """Image, true mask (bool) and camera of each view of such a folder, unit as recorded."""
    for frame in json.loads((folder / "cameras.json").read_text())["frames"]:
        camera = Camera(
            np.array(frame["K"]),
            frame["width"],
            frame["height"],
            np.array(frame["R"]),
            np.array(frame["t"]),
        )
        yield (
            cv2.imread(str(folder / frame["file"])),
            np.load(folder / f"{frame['file']}.npy"),
            camera,
        )


@pytest.fixture
def few_heights(monkeypatch):
    """The ground is sought at a quarter of the heights."""
    monkeypatch.setattr("occ_recon_ros.imaging.joint.plane._HEIGHTS", 41)


@pytest.fixture
def coarse(monkeypatch, few_heights):
    """Voxels half as fine, too."""
    monkeypatch.setattr("occ_recon_ros.imaging.joint.solve._GRIDS", (24, 32, 36))


def imported(command, content, folder):
    """The bag that ``import`` makes of the frames of a cameras.json, with files of any folder."""
    (folder / "cameras.json").write_text(json.dumps(content))
    assert command("import", folder, folder / "given.mcap")[0] == 0
    return folder / "given.mcap"
