"""import: files of cameras that are known but not read are named, with the way to go on."""

import json

import numpy as np
import pytest
from colmap_nerf import turn, write_images, write_text, write_transforms


def text(name, content):
    def write(folder):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)

    return write


def transforms(name):
    def write(folder):
        write_transforms(folder, turn())
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / "transforms.json").rename(folder / name)

    return write


def archive(folder):
    np.savez(folder / "cameras.npz", K=np.eye(3), R_0=np.eye(3), T_0=np.zeros(3))


METASHAPE = '<?xml version="1.0"?>\n<document version="1.5.0">\n  <chunk label="Chunk 1">'
MATRIX = f"<camera>\n{'  -1.5e-3 7' * 6}\n</camera>"
FOUND = {
    "Metashape": (text("cameras.xml", METASHAPE), "cameras.xml is of Metashape: export"),
    "a matrix": (text("calibration/cam0.xml", MATRIX), "cam0.xml is a 3x4 matrix of a camera"),
    "Bundler": (text("out/bundle.out", "# Bundle file v0.3\n"), "bundle.out is of Bundler: give"),
    "VisualSFM": (text("scan.nvm", "NVM_V3 \n"), "scan.nvm is of VisualSFM: give"),
    "MVSNet": (text("cams/00000000_cam.txt", "extrinsic\n1 0 0 0\n"), "_cam.txt is of MVSNet"),
    "one letter": (transforms("transform_train.json"), "transform_train.json is a transforms.json"),
    "other arrays": (archive, "cameras.npz holds K, R_0, T_0, but no world_mat_0"),
    "one deeper": (transforms("data/transforms.json"), "import instead: {}/data\n"),
    "a model deeper": (
        lambda p: write_text(p / "a" / "sparse" / "0", turn(), "PINHOLE"),
        "import instead: {}/a\n",
    ),
    "two deeper": (
        lambda p: [text(f"{a}/cameras.json", "{}")(p) for a in "ab"],
        "import instead: {0}/a or {0}/b\n",
    ),
    "splats": (text("a/cameras.json", "[]"), "it needs cameras.json"),
    "another XML": (text("a.xml", "<a>1 2 3</a>"), "it needs cameras.json"),
    "another JSON": (text("a.json", json.dumps({"a": 1})), "it needs cameras.json"),
    "no archive": (text("cameras.npz", "PK"), "holds nothing that can be read, but no world_mat_0"),
}


@pytest.mark.parametrize("case", FOUND)
def test_what_is_there_is_named(command, tmp_path, case):
    folder = tmp_path / "scan"
    write_images(folder, 3)
    write, words = FOUND[case]
    write(folder)
    code, out, err = command("import", folder, tmp_path / "a.mcap")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words.format(folder) in err, err
