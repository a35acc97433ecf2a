"""A recorded turn of a plaster figure, made small, how masks of it are judged, and a joint pass
that is rougher where a test asks for something else."""

import json

import cv2
import numpy as np
import pytest


def iou(a, b):
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def half_as_large(image):
    return cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def plaster(shared_data, tmp_path_factory):
    """Every fourth view of a plaster figure before black cloth, half as large, without masks."""
    folder = tmp_path_factory.mktemp("plaster")
    content = json.loads((shared_data / "dino_ring" / "cameras.json").read_text())
    content["frames"] = content["frames"][::4]
    for frame in content["frames"]:
        image = cv2.imread(str(shared_data / "dino_ring" / frame["file"]))
        cv2.imwrite(str(folder / frame["file"]), half_as_large(image))
        mask = cv2.imread(str(shared_data / "dino_ring" / frame.pop("mask")), 0)
        np.save(folder / f"{frame['file']}.npy", half_as_large(mask) > 127)
        frame["width"], frame["height"] = frame["width"] // 2, frame["height"] // 2
        K = np.array(frame["K"])
        K[:2] /= 2
        K[:2, 2] -= 0.25
        frame["K"] = K.tolist()
    (folder / "cameras.json").write_text(json.dumps(content))
    return folder


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
