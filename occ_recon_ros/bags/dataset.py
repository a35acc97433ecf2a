"""A folder of images with cameras.json, checked."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.coverage import (
    follow_each_other,
    order_of_neighbours,
    steps_between,
)
from occ_recon_ros.imaging.joint.space import usual_distance
from occ_recon_ros.poses.convention import other_convention

_FIRST_STAMP_NS = 1_000_000_000  # ROS takes time 0 for "not set"
_DEFAULT_STEP_NS = 100_000_000
_FEWEST = 3  # frames: one window
_NEAR_M, _FAR_M = 2e-3, 50.0  # between which cameras of turntables are, by far
_BEYOND_M = 1e15  # that no bag keeps, which is said of each frame
_SAME_POSE = 1e-6  # of the distance, or radians, by which the same poses differ
_PRINTED = 0.01
"""Largest entry of R R^T - I of a rotation that was written with two digits."""
_MODEL_BY_COEFFICIENTS = {
    4: "plumb_bob",
    5: "plumb_bob",
    8: "rational_polynomial",
    12: "rational_polynomial",
}


@dataclass(frozen=True)
class Frame:
    """One view of a data set: where its files are, when and from where it was taken."""

    image: Path
    mask: Path | None
    stamp_ns: int
    camera: Camera


def load_dataset(folder: Path, masks: bool = True) -> tuple[list[Frame], list[str], list[str]]:
    """The frames of FOLDER/cameras.json in order of time, and why others are left out.

    Where the file gives no stamps, they are in its order; where views that follow each other in
    that are hopelessly far apart, in the order of their places around the object.

    Args:
        folder: has cameras.json, and the files it names relative to itself.
        masks: leave the masks out if False.

    Returns:
        Frames, at least one; poses in metres; stamps evenly spaced where the file gives none. A
        sentence for each frame of which something is missing, misshapen or not finite, by its
        place in the file. And remarks on all of them. The images themselves are not opened.

    Raises:
        UserError: the file as a whole is wrong, or too many frames of it.
    """
    if not folder.is_dir():
        raise UserError(f"folder {folder} does not exist: give one that holds cameras.json")
    path = folder / "cameras.json"
    content = _load_json(path)
    entries = content.get("frames")
    if not isinstance(entries, list) or not entries:
        raise UserError(f"{path}: 'frames' must be a list with at least one frame")
    unit = _number(content, "unit_in_metres", str(path), default=1.0)
    if unit <= 0:
        raise UserError(f"{path}: unit_in_metres must be above 0, got {unit}")
    stamps = _stamps(entries, path)
    frames: list[Frame] = []
    left_out: list[str] = []
    for i, (entry, stamp) in enumerate(zip(entries, stamps, strict=True)):
        try:
            frames.append(_frame(folder, entry, stamp, unit, masks, f"{path}: frames[{i}]"))
        except UserError as error:
            left_out.append(str(error))
    refuse_too_few(len(frames), left_out)
    if (words := other_convention([frame.camera for frame in frames])) is not None:
        raise UserError(
            f"{path}: R and t must lead from object to camera, but these poses look past each "
            f"other; they seem to be {words}"
        )
    _refuse_one_pose(frames, path)
    remarks = _unit_doubt(frames)
    if any(entry.get("stamp") is not None for entry in entries):
        return sorted(frames, key=lambda frame: frame.stamp_ns), left_out, remarks
    frames, moved = _around_the_object(frames)
    return frames, left_out, remarks + moved


def _unit_doubt(frames: Sequence[Frame]) -> list[str]:
    """What is to be said of cameras that are out of all measure far from what they look at."""
    cameras = [frame.camera for frame in frames]
    if max(np.abs(camera.centre).max() for camera in cameras) > _BEYOND_M:
        return []
    away = usual_distance(cameras)
    if _NEAR_M < away < _FAR_M:
        return []
    return [
        f"the cameras are {away:.3g} m away from what they look at: the poses may be in another "
        "unit (unit_in_metres)"
    ]


def _around_the_object(frames: list[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames whose stamps were made up, in the order of their places around the object where they
    do not follow each other there as they are, and what is to be said of that."""
    centres = [frame.camera.centre for frame in frames]
    if follow_each_other(centres):
        return frames, []
    order = order_of_neighbours(centres)
    moved = [
        replace(frames[k], stamp_ns=frame.stamp_ns) for k, frame in zip(order, frames, strict=True)
    ]
    before, after = np.rad2deg(
        [steps_between(centres)[0], steps_between([centres[k] for k in order])[0]]
    )
    return moved, [
        "the frames are taken in the order of their places around the object: as listed, without "
        f"stamps, successive ones are {before:.0f} degrees apart, and so {after:.0f}"
    ]


def _refuse_one_pose(frames: Sequence[Frame], path: Path) -> None:
    """Keep out the pose of a camera that stands still beside a table that turns.

    Raises:
        UserError: all frames of a window or more have the same pose.
    """
    R = [frame.camera.R_camera_object for frame in frames]
    t = [frame.camera.t_camera_object for frame in frames]
    far = np.abs(t).max()
    same = np.ptp(R, axis=0).max() < _SAME_POSE and np.ptp(t, axis=0).max() <= _SAME_POSE * far
    if len(frames) >= _FEWEST and same:
        raise UserError(
            f"{path}: all {len(frames)} frames have the same pose; R and t lead from the frame "
            "that turns with the object to the camera: where that stands still and the table "
            "turns, they differ from frame to frame"
        )


def refuse_too_few(kept: int, left_out: Sequence[str]) -> None:
    """A picture that was lost ends no scan, a folder that is wrong throughout does.

    Args:
        kept: number of those that can be used.
        left_out: of each of the others, why.

    Raises:
        UserError: the first reason, where fewer than a window or than half are left.
    """
    if left_out and kept < max(_FEWEST, len(left_out)):
        raise UserError(left_out[0])


def _load_json(path: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))  # Windows begins with a BOM
    except FileNotFoundError:
        raise UserError(f"{path} does not exist: the folder needs one") from None
    except UnicodeDecodeError:
        raise UserError(f"{path} is not UTF-8: save it again as that") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error}") from None
    except json.JSONDecodeError as error:
        raise UserError(
            f"{path} is not JSON: {error.msg} at line {error.lineno} column {error.colno}"
        ) from None
    if not isinstance(content, dict):
        raise UserError(f"{path} must hold an object with 'frames', not {json.dumps(content):.40}")
    return content


def _stamps(entries: list[Any], path: Path) -> list[int]:
    """Stamps of the frames, nanoseconds: all given, or all made up."""
    for i, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise UserError(f"{path}: frames[{i}] must be an object, not {entry!r:.40}")
    given = [i for i, entry in enumerate(entries) if entry.get("stamp") is not None]
    if not given:
        return [_FIRST_STAMP_NS + i * _DEFAULT_STEP_NS for i in range(len(entries))]
    if len(given) < len(entries):
        without = next(i for i in range(len(entries)) if i not in set(given))
        raise UserError(f"{path}: frames[{without}] has no stamp: give all of them one, or none")
    stamps = [
        round(_number(entry, "stamp", f"{path}: frames[{i}]") * 1e9)
        for i, entry in enumerate(entries)
    ]
    for before, after in pairwise(np.argsort(stamps, kind="stable")):
        if stamps[after] == stamps[before]:
            raise UserError(f"{path}: frames[{after}].stamp is that of frames[{before}] as well")
    if min(stamps) < 0 or max(stamps) >= 2**31 * 10**9:
        raise UserError(f"{path}: stamps must be seconds from 0 to 2147483647")
    return stamps


def _frame(
    folder: Path, entry: Mapping[str, Any], stamp_ns: int, unit: float, masks: bool, where: str
) -> Frame:
    mask = _file(folder, entry, "mask", where) if masks and entry.get("mask") is not None else None
    image = _file(folder, entry, "file", where)
    if not image.is_file():
        what = "is a folder" if image.is_dir() else "does not exist"
        raise UserError(f"image {image} {what}: correct its name in cameras.json")
    D = _array(entry, "D", None, where) if entry.get("D") is not None else np.zeros(0)
    if len(D) and len(D) not in _MODEL_BY_COEFFICIENTS:
        raise UserError(
            f"{where}.D must have 4, 5, 8 or 12 numbers in OpenCV's order, not {len(D)}"
        )
    with wrong_in(where):
        camera = Camera(
            K=_homogeneous(_array(entry, "K", (3, 3), where)),
            width=_size(entry, "width", where),
            height=_size(entry, "height", where),
            R_camera_object=_rotation(_array(entry, "R", (3, 3), where)),
            t_camera_object=unit * _array(entry, "t", (3,), where),
            D=D,
            distortion=_MODEL_BY_COEFFICIENTS.get(len(D), "none"),
        )
    return Frame(image, mask, stamp_ns, camera)


def _rotation(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation next to a matrix that is one but for few printed digits; others as they are."""
    if np.abs(R @ R.T - np.eye(3)).max() > _PRINTED or np.linalg.det(R) < 0:
        return R
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)


def _homogeneous(K: NDArray[np.float64]) -> NDArray[np.float64]:
    """K so that its last number is 1, which decompositions leave at any scale."""
    return K / K[2, 2] if K[2, 2] != 0 and not K[2, :2].any() else K


def _value(entry: Mapping[str, Any], key: str, where: str) -> Any:
    if entry.get(key) is None:
        raise UserError(f"{where} has no '{key}'")
    return entry[key]


def _file(folder: Path, entry: Mapping[str, Any], key: str, where: str) -> Path:
    name = _value(entry, key, where)
    if not isinstance(name, str) or not name:
        raise UserError(f"{where}.{key} must be the name of a file, not {name!r:.40}")
    path = folder / name
    return path if path.exists() else folder / name.replace("\\", "/")


def _number(entry: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    value = entry.get(key, default)
    if value is None or isinstance(value, bool) or not isinstance(value, (int, float)):
        raise UserError(f"{where}: '{key}' must be a number, not {value!r:.40}")
    if not np.isfinite(value):
        raise UserError(f"{where}: '{key}' is not finite")
    return float(value)


def _size(entry: Mapping[str, Any], key: str, where: str) -> int:
    value = _value(entry, key, where)
    if isinstance(value, bool) or not isinstance(value, int) or value <= 0:
        raise UserError(f"{where}.{key} must be a whole number of pixels, not {value!r:.40}")
    return value


def _array(
    entry: Mapping[str, Any], key: str, shape: tuple[int, ...] | None, where: str
) -> NDArray[np.float64]:
    value = _value(entry, key, where)
    expected = "a list of numbers" if shape is None else "x".join(map(str, shape)) + " numbers"
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise ValueError("not numbers")
        array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise UserError(f"{where}.{key} must be {expected}") from None
    if (array.ndim != 1) if shape is None else (array.shape != shape):
        got = "x".join(map(str, array.shape)) or "one number"
        raise UserError(f"{where}.{key} must be {expected}, not {got}")
    if not np.isfinite(array).all():
        raise UserError(f"{where}.{key} is not finite (NaN or infinity)")
    return array
