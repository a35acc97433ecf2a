"""What to do with files of cameras that are known but not read, or are looked for elsewhere."""

import json
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from occ_recon_ros.errors import UserError

from .colmap import find_model
from .llff import POSES
from .nerf import find_transforms
from .projections import MATRICES, find_projections, npz_names
from .splatting import splats_of

_PLACES = ("", "*/", "*/*/", "*/*/*/")  # MeshroomCache/StructureFromMotion/<number>
_LOOKED_AT = 30  # files of one kind of name in one place
_NAMED = 4  # folders of those that can be imported
_HEAD = 2**16  # bytes of a file that are looked at
_BESIDE = "and put the images beside it"
_OPENMVG = "of openMVG: make a model of COLMAP of it (openMVG_main_openMVG2Colmap)"
_TO_COLMAP = f"{{}}, or a transforms.json, {_BESIDE}"
_NUMBER = rb"[-+.\deE]+"
_KINDS = (
    ("sfm_data.json", b"", _TO_COLMAP.format(_OPENMVG)),
    ("sfm_data.bin", b"", _TO_COLMAP.format(_OPENMVG)),
    (
        "cameras.sfm",
        b"",
        _TO_COLMAP.format("of Meshroom: make a model of COLMAP of it (aliceVision_exportColmap)"),
    ),
    (
        "*.xml",
        rb"<document\b[^>]*>\s*<chunk",
        "of Metashape: export the cameras for COLMAP instead, or make a transforms.json of it "
        "(ns-process-data metashape --data IMAGES --xml FILE --output-dir OUT)",
    ),
    (
        "*.xml",
        rb">\s*(?:" + _NUMBER + rb"\s+){11}" + _NUMBER + rb"\s*<",
        "a 3x4 matrix of a camera: take it apart (cv2.decomposeProjectionMatrix) and give K, R "
        "and t of each in a cameras.json",
    ),
    (
        "*.out",
        rb"\A# Bundle file",
        "of Bundler: give its f, R and t in a cameras.json, the signs of the second and third row "
        f"of R and t changed, {_BESIDE}",
    ),
    (
        "*.nvm",
        rb"\ANVM_V",
        "of VisualSFM: give f, R by the quaternion and t = -R C of each camera in a cameras.json, "
        f"{_BESIDE}",
    ),
    (
        "*_cam.txt",
        rb"\A\s*extrinsic\b",
        "of MVSNet: give K (intrinsic), R and t (extrinsic) of each in a cameras.json as they are",
    ),
    (
        "*.json",
        rb'"transform_matrix"',
        "a transforms.json by another name: rename it to that, and import its folder",
    ),
)
"""Names, what such a file has at its head, and what it is and what to do instead."""


def refuse_unread(folder: Path) -> None:
    """Say what to make of what is there in place of cameras that are read.

    Raises:
        UserError: there is something.
    """
    if below := [str(there) for there in islice(_described(folder), _NAMED)]:
        raise UserError(
            f"{folder} does not say where its cameras were; import instead: {' or '.join(below)}"
        )
    for place in _PLACES:
        for name, mark, what in _KINDS:
            for there in islice(sorted(folder.glob(place + name)), _LOOKED_AT):
                if there.is_file() and (not mark or re.search(mark, _head(there))):
                    raise UserError(f"{there} is {what}")
        for there in islice(sorted(folder.glob(place + MATRICES)), _LOOKED_AT):
            names = ", ".join(sorted(npz_names(there))[:3])
            raise UserError(
                f"{there} holds {names or 'nothing that can be read'}, but no world_mat_0 as IDR "
                "and NeuS have it: give K, R and t of each image in a cameras.json"
            )


def _described(folder: Path) -> Iterator[Path]:
    """Folders below that can be imported."""
    for place in _PLACES[1:3]:
        for below in sorted(folder.glob(place)):
            if below.is_dir() and (
                _is_cameras_json(below / "cameras.json")
                or splats_of(below / "cameras.json")
                or (below / POSES).exists()
                or find_transforms(below)
                or find_model(below)
                or find_projections(below)
            ):
                yield below


def _is_cameras_json(path: Path) -> bool:
    try:
        return isinstance(json.loads(path.read_bytes()), dict)
    except (OSError, ValueError, RecursionError):
        return False


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError:
        return b""
