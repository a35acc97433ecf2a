"""cameras.json, our own description of a folder of images."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.convention import OTHER_CONVENTIONS, nearest_rotation

from .foreign_files import find_masks_beside
from .frames import MODEL_BY_COEFFICIENTS, Frame, Listing, even_stamp
from .image_sizes import as_shown, in_their_sizes
from .json_fields import array, file_name, load_json, number, pixels, value
from .photographs import image_size

_THIN_PRISM, _TILTED = 12, 14  # coefficients of the largest model, and with those of a tilt
_OF_ALL = ("K", "D", "width", "height")  # frames, where they are beside the list of these
_ALSO = {"file": "file_path", "R": "rvec", "t": "tvec"}  # names that others give them
_WHOLE = ("transform", "extrinsic", "Rt")  # names of R and t in one matrix, 3x4 or 4x4
_UNLIKE = 2.0  # times fy, that fx is not: then four numbers are in another order
_MOST_TURNED = np.pi + 1e-3  # radians, of a vector of rotation
_LEAST_PX = 10.0  # of a focal length; those in shares of the image are 1 or 2


def read_cameras_json(path: Path, masks: bool) -> Listing:
    """The frames of a cameras.json, poses in metres.

    Args:
        path: of the file; the files it names are relative to its folder.
        masks: leave the masks out if False.

    Raises:
        UserError: the file as a whole is wrong.
    """
    content = load_json(path)
    common = {key: content[key] for key in _OF_ALL if key in content}
    entries = [
        common | {key: entry.get(other) for key, other in _ALSO.items()} | _taken_apart(entry)
        for entry in content["frames"]
    ]
    unit = number(content, "unit_in_metres", str(path), default=1.0)
    if unit <= 0:
        raise UserError(f"{path}: unit_in_metres must be above 0, got {unit}")
    stamps = _stamps(entries, path)
    frames: list[Frame] = []
    left_out: list[str] = []
    unsized: set[Path] = set()
    taken: dict[int, int] = {}  # the frame of a stamp
    for i, (entry, stamp) in enumerate(zip(entries, stamps, strict=True)):
        where = f"{path}: frames[{i}]"
        if stamp in taken:
            left_out.append(f"{where}.stamp is that of frames[{taken[stamp]}] as well")
            continue
        try:
            frames.append(_frame(path.parent, entry, stamp, unit, masks, where))
            taken[stamp] = i
            if entry.get("width") is None or entry.get("height") is None:
                unsized.add(frames[-1].image)
        except UserError as error:
            left_out.append(str(error))
    frames = [as_shown(frame) if frame.image in unsized else frame for frame in frames]
    frames, bent, scaled = in_their_sizes(frames, unsized)
    left_out += bent
    stamped = any(entry.get("stamp") is not None for entry in entries)
    way = "R and t must lead from object to camera"
    remarks = scaled + (_masks_unnamed(path, frames) if masks else [])
    ways = OTHER_CONVENTIONS
    return Listing(path, way, frames, left_out, remarks, stamped, metric=True, ways=ways)


def _masks_unnamed(path: Path, frames: Sequence[Frame]) -> list[str]:
    """What is to be said of masks that lie beside the images, where no frame names one."""
    if any(frame.mask is not None for frame in frames):
        return []
    try:
        there = find_masks_beside([frame.image for frame in frames], path.parent)
    except UserError:
        return []
    if not there:
        return []
    folder = next(iter(there.values())).parent
    return [
        f"{folder} holds masks of {len(there)} images; they are not used, for no frame of {path} "
        'names one ("mask")'
    ]


def _stamps(entries: list[Any], path: Path) -> list[int]:
    """Stamps of the frames, nanoseconds: all given, or all made up."""
    given = [i for i, entry in enumerate(entries) if entry.get("stamp") is not None]
    if not given:
        return [even_stamp(i) for i in range(len(entries))]
    if len(given) < len(entries):
        without = next(i for i in range(len(entries)) if i not in set(given))
        raise UserError(f"{path}: frames[{without}] has no stamp: give all of them one, or none")
    stamps = [
        round(number(entry, "stamp", f"{path}: frames[{i}]") * 1e9)
        for i, entry in enumerate(entries)
    ]
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
    D = array(entry, "D", None, where) if entry.get("D") is not None else np.zeros(0)
    if len(D) == _TILTED and not D[_THIN_PRISM:].any():
        D = D[:_THIN_PRISM]
    if len(D) and len(D) not in MODEL_BY_COEFFICIENTS:
        raise UserError(
            f"{where}.D must have 4, 5, 8 or 12 numbers in OpenCV's order, not {len(D)}"
            + (": a sensor that is tilted behind its lens" if len(D) == _TILTED else "")
        )
    width, height = image_size(image) or (None, None)
    sized = {"width": width, "height": height, **entry}
    with wrong_in(where):
        camera = Camera(
            K=_in_pixels(_of_four(entry, where)),
            width=pixels(sized, "width", where),
            height=pixels(sized, "height", where),
            R_camera_object=_rotation(entry, where),
            t_camera_object=unit * array(entry, "t", (3,), where),
            D=D,
            distortion=MODEL_BY_COEFFICIENTS.get(len(D), "none"),
        )
    return Frame(image, mask, stamp_ns, camera)


def _taken_apart(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry with R and t of its own, where it has them in one matrix [R t] alone."""
    name = next((name for name in _WHOLE if entry.get(name) is not None), None)
    if name is None or entry.get("R") is not None:
        return entry
    rows = entry[name]
    try:
        numbers = np.asarray(rows, np.float64).reshape(-1, 4)[:3]
    except (TypeError, ValueError):
        return entry
    return {**entry, "R": numbers[:, :3].tolist(), "t": numbers[:, 3].tolist()}


def _of_four(entry: Mapping[str, Any], where: str) -> NDArray[np.float64]:
    """K (3, 3), which may be four numbers, fx, fy, cx and cy.

    Raises:
        UserError, ValueError: it is neither.
    """
    given = value(entry, "K", where)
    if not isinstance(given, list) or len(given) != 4:
        return array(entry, "K", (3, 3), where)
    fx, fy, cx, cy = array(entry, "K", (4,), where)
    if not fy < _UNLIKE * fx < _UNLIKE**2 * fy:
        raise ValueError("K of four numbers must be fx, fy, cx, cy")
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _rotation(entry: Mapping[str, Any], where: str) -> NDArray[np.float64]:
    """R (3, 3), or what a vector of three numbers means: cv2.Rodrigues and solvePnP give such.

    Raises:
        ValueError: it is none.
    """
    if np.size(value(entry, "R", where)) != 3:
        R = nearest_rotation(array(entry, "R", (3, 3), where))
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4):
            raise ValueError("R is not a rotation matrix")
        return R
    turn = array(entry, "R", (3,), where)
    if np.linalg.norm(turn) > _MOST_TURNED:
        raise ValueError("R of three numbers must be a rotation vector (cv2.Rodrigues), radians")
    return Rotation.from_rotvec(turn).as_matrix()


def _in_pixels(K: NDArray[np.float64]) -> NDArray[np.float64]:
    """K so that its last number is 1, which decompositions leave at any scale.

    Raises:
        ValueError: its numbers are no pixels.
    """
    if K[2, 2] != 0 and not K[2, :2].any():
        K = K / K[2, 2]
    if 0 < K[0, 0] < _LEAST_PX:
        raise ValueError(
            f"K must be in pixels: its focal length is {K[0, 0]:.3g}; if it is in shares of the "
            "image, multiply its first row by the width and its second by the height"
        )
    if K[0, 0] > 0 and not (K[:2, 2].any() or K[2, :2].any()):
        raise ValueError(
            "K has its principal point at 0, 0, a corner of the image: give cx and cy, which are "
            "near its middle"
        )
    return K


def _file(folder: Path, entry: Mapping[str, Any], key: str, where: str) -> Path:
    name = file_name(entry, key, where)
    if (folder / name).exists():
        return folder / name
    path = folder / name.replace("\\", "/")
    if path.exists():
        return path
    # The one file of that name but for capitals, or with a suffix; or those are in "images".
    for place in (path.parent, folder / "images" / Path(name.replace("\\", "/")).parent):
        wanted = path.name.lower()
        there = [f for f in place.iterdir() if f.is_file()] if place.is_dir() else []
        like = [f for f in there if wanted in (f.name.lower(), f.stem.lower())]
        if len(like) == 1:
            return like[0]
    return path
