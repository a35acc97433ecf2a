"""Sparse models of COLMAP, as text or binary (https://colmap.github.io/format.html)."""

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.poses.convention import OTHER_CONVENTIONS, from_colmap, made_unit

from .foreign import UNDISTORT, Lens, View, listed
from .foreign_files import find_images, image_folders, other_folders
from .frames import Listing

_MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
}
"""Models that can be used, and their parameters in order (src/colmap/sensor/models.h)."""
_NUMBERED = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"),
    *("FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"),
    *("RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE"),
    *("EUCM", "EQUIRECTANGULAR"),
)
"""Names of the models by their numbers in binary files."""
_PLACES = (
    *("", "sparse", "sparse/*", "colmap*", "colmap*/*", "colmap*/*/*"),
    *("dense/sparse", "dense/*/sparse"),
)
_HALVES = (("cameras", "images", "poses"), ("images", "cameras", "lenses"))
_POINT = struct.calcsize("<2dq")  # of an image: x, y and the number of the point in space


class _Image(NamedTuple):
    name: str
    camera: int
    quaternion: Array
    t: Array


def find_model(folder: Path) -> Path | None:
    """The folder of the sparse model in or below a folder; of several, the largest, for COLMAP
    writes one for each part of the images that it cannot join."""
    for place in _PLACES:
        found = {
            path.parent: path.stat().st_size
            for suffix in ("txt", "bin")
            for path in sorted(folder.glob(f"{place}/images.{suffix}".lstrip("/")))
            if path.is_file() and path.with_stem("cameras").is_file()
        }
        if found:
            return max(found, key=lambda model: found[model])
    return None


def refuse_half(folder: Path, below: bool) -> None:
    """Say which part of a model is missing.

    Args:
        folder: where ``find_model`` finds none.
        below: look in the folders where a model may be, else in this one alone, where files of
            such names may be of others.

    Raises:
        UserError: there are cameras or images of one, without the other file of the same kind.
    """
    for place in _PLACES[1:] if below else _PLACES[:1]:
        for suffix in ("bin", "txt"):
            for part, other, holds in _HALVES:
                for half in sorted(folder.glob(f"{place}/{part}.{suffix}".lstrip("/"))):
                    if half.is_file():
                        raise UserError(
                            f"{half} has no {other}.{suffix} beside it, where a model of COLMAP "
                            f"has its {holds}: copy or export all of it"
                        )


def read_colmap(folder: Path, model: Path, masks: bool) -> Listing:
    """The frames of a sparse model, those of its images that are there.

    Args:
        folder: holds the images, or a folder in it does, first of all images, input or images_N,
            where no folder images beside the model does; only where it is that of the model, and
            has none of them, they may be above it.
        model: folder with cameras and images, .bin (which COLMAP prefers too) or .txt.
        masks: leave them out if False.

    Raises:
        UserError: a file that cannot be read, a camera model that bends too much for ours, or none
            of the images is there.
    """
    suffix = "bin" if (model / "images.bin").is_file() else "txt"
    lenses = _read(model / f"cameras.{suffix}", _cameras_bin, _cameras_txt)
    images = _read(model / f"images.{suffix}", _images_bin, _images_txt)
    if not images:
        raise UserError(f"{model}/images.{suffix} lists no images")
    names = [image.name for image in images]
    above = [up / "images" for up in (model.parent, model.parent.parent)]  # as those undistorted
    beside = [place for place in above if place.is_relative_to(folder)]
    paths = find_images([*beside, *image_folders(folder)], names)
    paths = paths or find_images(other_folders(folder), names)
    if not paths and model == folder:
        paths = find_images([up / "images" for up in folder.resolve().parents[:2]], names)

    def view(image: _Image) -> View:
        where = f"{model}: {image.name}"
        path = paths.get(image.name)
        if path is None:
            raise UserError(f"{where} is not in {folder} or in a folder there")
        if image.camera not in lenses:
            raise UserError(f"{where} has camera {image.camera}, which is not in cameras.{suffix}")
        with wrong_in(where):
            pose = from_colmap(image.quaternion, image.t)
        return View(path, lenses[image.camera], pose, where)

    listing = listed(
        model,
        "its poses must lead from world to camera",
        [(image.name, partial(view, image)) for image in images],
        folder if masks else None,
        paths,
        OTHER_CONVENTIONS,
    )
    taken = {frame.image for frame in listing.frames}
    used = [image.quaternion for image in images if paths.get(image.name) in taken]
    if said := made_unit(np.reshape(used, (-1, 4))):
        listing.remarks.append(f"{model}: {said}")
    return listing


def _read(path: Path, binary: Any, text: Any) -> Any:
    try:
        data = path.read_bytes()
        with wrong_in(path):
            if path.suffix == ".bin":
                return binary(_Bytes(data))
            return text(_decoded(data.removeprefix(b"\xef\xbb\xbf")))
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from None


def _decoded(text: bytes) -> str:
    """UTF-8, or what COLMAP before its version 4 wrote on Windows in western Europe."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("cp1252", "replace")


class _Bytes:
    """Little-endian values one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, kinds: str) -> tuple[Any, ...]:
        """Values of these kinds, as ``struct`` names them."""
        try:
            values = struct.unpack_from(f"<{kinds}", self._data, self._at)
        except struct.error:
            raise ValueError("it is truncated or not of COLMAP: export the model again") from None
        self.skip(struct.calcsize(f"<{kinds}"))
        return values

    def text(self) -> str:
        """What ends with a zero."""
        end = self._data.find(b"\0", self._at)
        text = self._data[self._at : end]
        self.skip((end if end >= 0 else len(self._data) + 1) + 1 - self._at)
        return _decoded(text)

    def skip(self, count: int) -> None:
        """Pass over some bytes."""
        self._at += count
        if self._at > len(self._data):
            raise ValueError("it is truncated or not of COLMAP: export the model again")


def _cameras_bin(data: _Bytes) -> dict[int, Lens]:
    found = {}
    for _ in range(data.take("Q")[0]):
        number, model, width, height = data.take("IiQQ")
        name = _NUMBERED[model] if 0 <= model < len(_NUMBERED) else f"number {model}"
        count = len(_parameters(name))
        found[number] = _lens(name, width, height, data.take(f"{count}d"))
    return found


def _images_bin(data: _Bytes) -> list[_Image]:
    found = []
    for _ in range(data.take("Q")[0]):
        _, *pose, camera = data.take("I7dI")
        found.append(_Image(data.text(), camera, np.array(pose[:4]), np.array(pose[4:])))
        data.skip(data.take("Q")[0] * _POINT)
    return found


def _cameras_txt(text: str) -> dict[int, Lens]:
    found = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            with _in_line(number):
                values = [float(word) for word in words[4:]]
                found[int(words[0])] = _lens(words[1], int(words[2]), int(words[3]), values)
    return found


def _images_txt(text: str) -> list[_Image]:
    """Each image has a line, and one with its points behind it, which may be empty, or lost by an
    editor: a line of points ends with a number, that of an image with a name."""
    found: list[_Image] = []
    points = False
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split(maxsplit=9)
        if points and (not words or not line.rsplit(maxsplit=1)[-1].strip("-.0123456789")):
            points = False
        elif words and not words[0].startswith("#"):
            with _in_line(number):
                pose = np.array([float(word) for word in words[1:8]])
                found.append(_Image(words[9].strip(), int(words[8]), pose[:4], pose[4:]))
            points = True
    return found


@contextmanager
def _in_line(number: int) -> Iterator[None]:
    try:
        yield
    except IndexError:
        raise ValueError(f"line {number} is too short: export the model again") from None
    except ValueError as error:
        raise ValueError(f"line {number}: {error}") from None


def _lens(model: str, width: int, height: int, values: Sequence[float]) -> Lens:
    names = _parameters(model)
    if len(values) != len(names) or not np.isfinite(values).all() or min(width, height) < 1:
        raise ValueError(
            f"a camera {model} has {len(names)} finite parameters and a size, not "
            f"{width}x{height} and {len(values)} parameters"
        )
    found = dict(zip(names, values, strict=True))
    if "f" in found:
        found["fx"] = found["fy"] = found.pop("f")
    return Lens((width, height), found, "FISHEYE" in model)


def _parameters(model: str) -> list[str]:
    """Names of the parameters of a model.

    Raises:
        ValueError: not one of ours.
    """
    if model not in _MODELS:
        raise ValueError(
            f"a camera of the model {model} cannot be used, only {', '.join(_MODELS)}: {UNDISTORT}"
        )
    return _MODELS[model].split()
