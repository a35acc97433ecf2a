"""Photographs of a folder, frames of a video or of a camera, in order, twice if asked."""

import math
import re
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from copy import copy
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.arrays import evenly

from .frames import FIRST_STAMP_NS, STEP_NS
from .images import bits_used, read_image
from .mask_files import is_cut_out, misdrawn, read_mask, refuse_misdrawn

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
_MASK_ENDING = re.compile(r"[._ -]mask$", re.IGNORECASE)
_IMAGE_ENDING = re.compile(rf"({'|'.join(map(re.escape, SUFFIXES))})$", re.IGNORECASE)
_CAMERA_PERIOD_S = 0.1  # least time between two frames of a camera
_MOST_FRAMES = 600  # of a video that are looked at
_LOOKED_AT = 9  # masks of a folder, whether they tell an object
_FULL_FRAME_DIAGONAL_MM = math.hypot(36, 24)

Picture = tuple[str, int, NDArray[Any]]
"""name, stamp in nanoseconds, (h, w) or (h, w, 3) BGR uint8, (0, 0) where the file is damaged"""


class Pictures(Protocol):
    """Where images come from. May be iterated again; the second time only some are asked for.

    Attributes:
        name: of the source.
        size: width and height of most of them, px; (0, 0): that of the first counts.
    """

    name: str
    size: tuple[int, int] = (0, 0)

    def __len__(self) -> int:
        """How many there are, 0 if nobody knows."""

    def __iter__(self) -> Iterator[Picture]:
        """All of them in order."""

    def focal_px(self) -> float | None:
        """Focal length that the images tell of, pixels."""
        return None

    def file(self, name: str) -> Path | None:
        """That of a photograph; None of a frame of a video."""
        return None


class FolderPictures(Pictures):
    """The photographs of a folder, by name, numbers in them by value.

    Raises:
        UserError: there are none, or none that can be read.
    """

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        self.files = sorted(images_in(folder), key=lambda file: by_number(file.name))
        if not self.files:
            raise UserError(f"{folder} holds no photographs ({', '.join(SUFFIXES)})")
        sizes = Counter(size for file in self.files if (size := image_size(file)) is not None)
        if not sizes:
            raise UserError(f"{folder} holds no photograph that can be read")
        self.size = sizes.most_common(1)[0][0]
        self._bits = bits_used(self.files)
        self._places = {file.name: file for file in self.files}

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[Picture]:
        for k, file in enumerate(self.files):
            try:
                image = read_image(file, self._bits)
            except UserError:
                image = np.zeros((0, 0), np.uint8)
            if image.dtype == np.uint16:
                image = (image // 257).astype(np.uint8)
            yield file.name, FIRST_STAMP_NS + k * STEP_NS, image

    def file(self, name: str) -> Path | None:
        """That of a photograph."""
        return self._places[name]

    def ordered(self, names: Sequence[str]) -> "FolderPictures":
        """The same, those of these names first, in their order."""
        found = copy(self)
        first = [self._places[name] for name in names]
        found.files = [*first, *(file for file in self.files if file not in first)]
        return found

    def focal_px(self) -> float | None:
        """From the EXIF data of the first photograph: whole millimetres by the diagonal, good to
        some per cent."""
        try:
            with Image.open(self.files[0]) as image:
                tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
                focal_mm = int(tags.get(ExifTags.Base.FocalLengthIn35mmFilm, 0))
                return math.hypot(*image.size) * focal_mm / _FULL_FRAME_DIAGONAL_MM or None
        except Exception:  # of many kinds: whatever the parser stumbles over
            return None


class VideoPictures(Pictures):
    """The frames of a video file; of a long one only some."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._path = path
        video = self._open()
        frames = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = float(video.get(cv2.CAP_PROP_FPS))
        video.release()
        self._period_ns = int(1e9 / rate) if 1 <= rate <= 1000 else STEP_NS
        self._stride = max(1, frames // _MOST_FRAMES)
        self._count = max(frames, 0) // self._stride

    def _open(self) -> cv2.VideoCapture:
        video = cv2.VideoCapture(str(self._path))
        if not video.isOpened():
            raise UserError(f"{self._path} is not a video that OpenCV can read")
        # As the calibration: the sensor's rows and columns, whatever way up the phone was.
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return video

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Picture]:
        video = self._open()
        try:
            number = 0
            while video.grab():
                if number % self._stride == 0:
                    there, image = video.retrieve()
                    if there and image is not None:
                        stamp = FIRST_STAMP_NS + number * self._period_ns
                        yield f"frame {number}", stamp, np.asarray(image, np.uint8)
                number += 1
            if not number:
                raise UserError(f"{self._path} holds no frame that OpenCV can read")
        finally:
            video.release()


class CameraPictures(Pictures):
    """A camera of this computer, until Ctrl-C or ``stop``; the frames are kept for later.

    Args:
        index: OpenCV's number of the camera.
    """

    def __init__(self, index: int) -> None:
        self.name = f"camera {index}"
        self._index = index
        self._kept: tempfile.TemporaryDirectory[str] | None = None
        self._stamps: list[int] = []
        self.stop = False

    def __len__(self) -> int:
        return len(self._stamps)

    def __iter__(self) -> Iterator[Picture]:
        if self._kept is not None:
            yield from self._again(Path(self._kept.name))
            return
        video = cv2.VideoCapture(self._index)
        if not video.isOpened():
            raise UserError(f"camera {self._index} cannot be opened: is it there, and free?")
        self._kept = tempfile.TemporaryDirectory(prefix="occ_recon_scan_")
        begun = due = time.monotonic()
        try:
            while not self.stop and video.grab():
                now = time.monotonic()
                if now < due:
                    continue
                due = now + _CAMERA_PERIOD_S
                there, image = video.retrieve()
                if not there or image is None:
                    continue
                stamp = FIRST_STAMP_NS + int((now - begun) * 1e9)
                cv2.imwrite(f"{self._kept.name}/{len(self._stamps)}.png", image)
                self._stamps.append(stamp)
                yield f"frame {len(self._stamps) - 1}", stamp, np.asarray(image, np.uint8)
        except KeyboardInterrupt:
            pass  # that is how one says that the turn is over
        finally:
            video.release()

    def _again(self, folder: Path) -> Iterator[Picture]:
        for k, stamp in enumerate(self._stamps):
            yield f"frame {k}", stamp, read_image(folder / f"{k}.png")


def open_pictures(source: str) -> FolderPictures | VideoPictures:
    """The photographs of a folder, or the frames of a video.

    Raises:
        UserError: neither.
    """
    path = Path(source)
    if path.is_dir():
        inner = path / "images"
        if not images_in(path) and inner.is_dir():
            path = inner
        return FolderPictures(path)
    if not path.exists():
        raise UserError(f"{path} does not exist: give a folder of photographs or a video file")
    return VideoPictures(path)


def images_in(folder: Path) -> list[Path]:
    """Files with the name of an image. Hidden ones are notes that file managers leave."""
    files = (p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
    return [file for file in files if not file.name.startswith(".")]


def is_mask_name(name: str) -> bool:
    """Whether a file is called the mask of another (IMG_5_mask.png)."""
    return _MASK_ENDING.search(Path(name).stem) is not None


def find_masks(folder: Path, names: list[str], option: str = "--masks ") -> dict[str, Path]:
    """The mask of each photograph: the file of the same name but for its suffix.

    Where there is none, the one file that is called as the photograph with its own suffix
    (IMG_5.jpg.png), or has "mask" behind the name (IMG_5_mask.png, IMG_5.mask.png). Where no file
    is called so, those that have the same words before and behind all names (sil-5.png,
    IMG_5-removebg-preview.png).
    ``option`` is how errors begin: what the user said before the folder.

    Raises:
        UserError: no such folder, not one mask in it, or masks of what is around the object.
    """
    if not folder.is_dir():
        raise UserError(f"{option}{folder}: there is no such folder")
    there = sorted(images_in(folder), key=lambda file: by_number(file.name))
    files = {p.stem: p for p in there}
    longer: dict[str, set[Path]] = {}
    for path in there:
        base = _MASK_ENDING.sub("", path.stem)
        for stem in {base, _IMAGE_ENDING.sub("", base)} - {path.stem}:
            longer.setdefault(stem, set()).add(path)
    found: dict[str, Path] = {}
    for name in names:
        stem = Path(name).stem
        others = longer.get(stem, set())
        if stem in files:
            found[name] = files[stem]
        elif name in files:
            found[name] = files[name]
        elif len(others) == 1:
            (found[name],) = others
    if not found and (words := _words_about(names, files)) is not None:
        named = {name: files.get(words[0] + Path(name).stem + words[1]) for name in names}
        found = {name: file for name, file in named.items() if file is not None}
    if not found:
        holds = f"it holds {there[0].name}" if there else "it holds no images"
        wanted = f", wanted is {Path(names[0]).stem}.png" if names else ""
        raise UserError(
            f"{option}{folder}: no file there has the name of one of the photographs: "
            f"{holds}{wanted}"
        )
    looked_at = [
        mask
        for k in evenly(len(found), _LOOKED_AT)
        if (mask := _readable([*found.values()][k])) is not None
    ]
    refuse_misdrawn([*map(misdrawn, looked_at)], f"{option}{folder}")
    return found


def _words_about(names: Sequence[str], files: Collection[str]) -> tuple[str, str] | None:
    """What stands before and behind the names of most photographs in those of the files; None where
    nothing does. No figure: 1 is in 11, and 5 in 5_2."""
    asked = names[:_LOOKED_AT]
    parts = [file.partition(Path(name).stem) for name in asked for file in files]
    words = Counter(
        (before, behind)
        for before, stem, behind in parts
        if stem and not any(map(str.isdigit, before + behind))
    )
    most = max(words, key=words.__getitem__, default=None)
    return most if most is not None and 2 * words[most] > len(asked) else None


def cut_outs(pictures: FolderPictures) -> dict[str, Path]:
    """Those photographs, by name, that an object was cut out of: each is its own mask."""
    return {file.name: file for file in pictures.files if is_cut_out(file)}


def _readable(path: Path) -> NDArray[np.uint8] | None:
    try:
        return read_mask(path)
    except UserError:
        return None


def image_size(path: Path) -> tuple[int, int] | None:
    """Width and height of the pixels as they are stored, by the head of a file, px; None where it
    has none that Pillow knows."""
    try:
        with Image.open(path) as image:
            if image.format == "TIFF":  # whose size Pillow turns
                tags = image.tag_v2  # type: ignore[attr-defined]
                return tags[ExifTags.Base.ImageWidth], tags[ExifTags.Base.ImageLength]
            return image.size
    except Exception:  # of many kinds: whatever the parser stumbles over
        return None


def by_number(name: str) -> list[tuple[int, str]]:
    """Sorts img2 before img10."""
    return [
        (int(word), "") if word.isdecimal() else (-1, word)
        for word in re.split(r"(\d+)", name)
        if word
    ]
