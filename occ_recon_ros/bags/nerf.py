"""transforms.json of instant-ngp, nerfstudio, and the scenes of NeRF made with Blender.

https://docs.nerf.studio/quickstart/data_conventions.html. What they say of the box around the
object (aabb_scale, scale, offset) and of how the world was moved (applied_transform,
applied_scale) is of no matter here: the world is theirs, and its unit arbitrary. A matrix of
intrinsics, as others write, is taken to have the first pixel where cx and cy have it.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.poses.convention import OF_TRANSFORMS, from_opengl

from .foreign import COEFFICIENTS, UNDISTORT, Lens, View, listed
from .foreign_files import find_images, image_folders
from .frames import Listing
from .json_fields import NO_FRAMES, array, file_name, load_json, number, value
from .photographs import image_size

_SPLITS = ("train", "val", "test")
_FISHEYE = "OPENCV_FISHEYE"
_MODELS = (
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "PERSPECTIVE",
    _FISHEYE,
)
_COEFFICIENTS = COEFFICIENTS[:6]  # those that they know
_BEYOND = COEFFICIENTS[6:]
_MATRICES = ("K", "intrinsics", "camera_matrix")
_IN_MATRIX = {"fl_x": (0, 0), "fl_y": (1, 1), "cx": (0, 2), "cy": (1, 2)}
_FOCAL, _ANGLES = ("fl_x", "fl_y"), ("camera_angle_x", "camera_angle_y")
_LEAST_PX = 10.0  # of a focal length; those of matrices in shares of the image are 1 or 2
_ROUNDED = 1e-6
_SKEW_PX = 0.1  # by which rows may be aslant that are taken to be straight


def find_transforms(folder: Path) -> list[Path]:
    """transforms.json of a folder, or where it has none its parts transforms_train.json, ..."""
    whole = folder / "transforms.json"
    parts = [folder / f"transforms_{split}.json" for split in _SPLITS]
    return [whole] if whole.is_file() else [part for part in parts if part.is_file()]


def read_transforms(folder: Path, paths: Sequence[Path], masks: bool) -> Listing:
    """The frames of such files.

    Args:
        folder: that they, and the images, are in.
        paths: one or more.
        masks: leave them out if False.

    Raises:
        UserError: a file as a whole is wrong, or none has frames.
    """
    entries: list[tuple[str, Mapping[str, Any], Mapping[str, Any]]] = []
    contents = {path: load_json(path, may_be_empty=True) for path in paths}
    empty = [path for path in paths if not contents[path]["frames"]]
    paths = [path for path in paths if path not in empty]
    if not paths:
        raise UserError(f"{empty[0]}: {NO_FRAMES}")
    for path in paths:
        for i, entry in enumerate(contents[path]["frames"]):
            entries.append((f"{path}: frames[{i}]", contents[path], entry))
    names = [str(entry.get("file_path") or "") for _, _, entry in entries]
    files = find_images([folder], [str(entry.get("mask_path")) for _, _, entry in entries])
    files |= find_images([folder, *image_folders(folder)], names)
    views = [
        (name, partial(_view, folder, files, *said))
        for name, said in zip(names, entries, strict=True)
    ]
    listing = listed(
        paths[0] if len(paths) == 1 else folder / "transforms_*.json",
        "transform_matrix must lead to the world from a camera that looks along -z (OpenGL)",
        views,
        folder if masks else None,
        files,
        OF_TRANSFORMS,
    )
    listing.remarks.extend(f"{path} lists no frames" for path in empty)
    return listing


def _view(
    folder: Path,
    files: Mapping[str, Path],
    where: str,
    content: Mapping[str, Any],
    frame: Mapping[str, Any],
) -> View:
    """One frame, with what the file says of all of them, and the files by the names it gives."""
    entry = {**content, **frame}
    fisheye = entry.get("camera_model") == _FISHEYE or bool(entry.get("is_fisheye"))
    # What a matrix is of where numbers tell the lens, nobody knows: a pose, or another size.
    if all(entry.get(key) is None for key in (_FOCAL if fisheye else _FOCAL + _ANGLES)):
        entry = _with_numbers(content, where) | _with_numbers(frame, where)
    name = file_name(entry, "file_path", where)
    image = files.get(name)
    if image is None:
        raise UserError(f"{where}: its image {name} is not in {folder}")
    size = _size(entry, image, where)
    matrix = value(entry, "transform_matrix", where)
    rows = 3 if isinstance(matrix, list) and len(matrix) == 3 else 4
    with wrong_in(f"{where}.transform_matrix"):
        pose = from_opengl(array(entry, "transform_matrix", (rows, 4), where))
    mask = None
    if entry.get("mask_path") is not None:
        name = file_name(entry, "mask_path", where)
        mask = files.get(name, folder / name)
    lens = Lens(size, _parameters(entry, size, fisheye, where), fisheye)
    return View(image, lens, pose, where, mask)


def _size(entry: Mapping[str, Any], image: Path, where: str) -> tuple[int, int]:
    """Width and height that the calibration is of, px: those of the image where it does not say."""
    there = image_size(image)
    if there is None and (entry.get("w") is None or entry.get("h") is None):
        raise UserError(f"{where}: its image {image} cannot be read")
    width, height = there or (None, None)
    size = round(number(entry, "w", where, width)), round(number(entry, "h", where, height))
    if min(size) < 1:
        raise UserError(f"{where}: 'w' and 'h' must be above 0")
    return size


def _parameters(
    entry: Mapping[str, Any], size: tuple[int, int], fisheye: bool, where: str
) -> dict[str, float]:
    """fx, fy, cx, cy and the distortion; in the middle of the image where it does not say."""
    model = entry.get("camera_model") or "OPENCV"
    if model not in _MODELS:
        raise UserError(
            f"{where} is of the camera_model {model!r:.40}, which cannot be used: {UNDISTORT}"
        )
    # Of others k4 is for nerfstudio the coefficient of r^8, for OpenCV one of a divisor.
    for key in (*_BEYOND, *(("p1", "p2") if fisheye else ("k4",))):
        if number(entry, key, where, 0.0) != 0.0:
            has = f"'{key}' and {'a' if fisheye else 'no'} fisheye"
            has = f"the coefficient '{key}'" if key in _BEYOND else has
            raise UserError(f"{where} has {has}, which cannot be used: {UNDISTORT}")
    if fisheye:  # of which angles tell another focal length, if they tell one
        entry = {**entry, "camera_angle_x": None, "camera_angle_y": None}
    focal = [  # one alone is that of square pixels
        _focal(entry, axis, side, where)
        for axis, side in zip("xy", size, strict=True)
        if any(entry.get(f"{key}_{axis}") is not None for key in ("fl", "camera_angle"))
    ]
    if not focal:
        lacks = "no 'fl_x'" if fisheye else "neither 'fl_x' nor 'camera_angle_x'"
        there = [key for key in _MATRICES if entry.get(key) is not None]
        but = f"its '{there[0]}' must be 3x3 numbers" if there else "no matrix 'K'"
        raise UserError(f"{where} has {lacks}, and {but}")
    found = {
        "fx": focal[0],
        "fy": focal[-1],
        "cx": number(entry, "cx", where, 0.5 * size[0]),
        "cy": number(entry, "cy", where, 0.5 * size[1]),
    }
    return found | {key: number(entry, key, where, 0.0) for key in _COEFFICIENTS}


def _with_numbers(entry: Mapping[str, Any], where: str) -> dict[str, Any]:
    """An entry and, where it has them in a matrix alone, its fl_x, fl_y, cx and cy."""
    lacking = [name for name in _IN_MATRIX if entry.get(name) is None]
    written = [key for key in _MATRICES if _is_matrix(entry.get(key))]
    if not (lacking and written):
        return {**entry}
    key = written[0]
    flat = not isinstance(entry[key][0], list)  # row by row
    n = 4 if len(entry[key]) in (4, 16) else 3
    K = array(entry, key, (n * n,) if flat else (n, n), where).reshape(n, n)
    rest = K - np.eye(n)
    for place in _IN_MATRIX.values():
        rest[place] = 0
    if abs(rest[0, 1]) > _SKEW_PX or np.abs(np.delete(rest, 1)).max() > _ROUNDED:
        raise UserError(f"{where}.{key} must be [[fl_x, 0, cx], [0, fl_y, cy], [0, 0, 1]]")
    if min(K[0, 0], K[1, 1]) < _LEAST_PX:
        raise UserError(f"{where}.{key} must be in pixels: its focal length is {K[0, 0]:.3g}")
    return {**entry, **{name: K[_IN_MATRIX[name]] for name in lacking}}


def _is_matrix(found: Any) -> bool:
    """Or means to be one; lists of other lengths are of another maker."""
    if not isinstance(found, list) or not found:
        return False
    return isinstance(found[0], list) or len(found) in (9, 16)


def _focal(entry: Mapping[str, Any], axis: str, side: int, where: str) -> float:
    """Focal length as it is, or of the angle from edge to edge of a side; pixels."""
    if entry.get(f"fl_{axis}") is not None:
        return number(entry, f"fl_{axis}", where)
    angle = number(entry, f"camera_angle_{axis}", where)
    if not 0 < angle < np.pi:
        raise UserError(f"{where}: 'camera_angle_{axis}' must be between 0 and pi, radians")
    return 0.5 * side / float(np.tan(0.5 * angle))
