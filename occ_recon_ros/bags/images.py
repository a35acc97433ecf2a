"""Image files, read whole or not at all."""

import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from occ_recon_ros.errors import UserError

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}  # and the order of its bytes
_ORIENTATION, _UPRIGHT = 274, 1  # tag and value
_FLIPPED = (5, 7)  # orientations that exchange rows and columns first
_QUARTERS = {6: -1, 7: 2, 8: 1}  # turns to the left, then
TURNED_BACK = {5: 5, 6: 8, 7: 7, 8: 6}
"""Of each orientation that turns by a right angle the one that undoes it."""
_REDUCED = {8: cv2.IMREAD_REDUCED_COLOR_8, 4: cv2.IMREAD_REDUCED_COLOR_4}
_REDUCED |= {2: cv2.IMREAD_REDUCED_COLOR_2, 1: cv2.IMREAD_COLOR}
Image.MAX_IMAGE_PIXELS = None  # whoever names a file wants it read


def read_image(path: Path, bits: int = 16) -> NDArray[Any]:
    """An image as the file is: grey of 8 or 16 bits, or 8-bit colour.

    The pixels stay in the order of the file (an EXIF rotation is not applied: calibrations
    are made on the sensor's rows and columns). An alpha channel is left out. Colour of 16 bits
    becomes 8 bits, the deepest that a ROS colour encoding of ours holds.

    Args:
        path: of the file.
        bits: how many of 16 are used, as ``bits_used`` has it: they are moved up.

    Returns:
        (h, w) uint8 or uint16, or (h, w, 3) uint8 in the order blue, green, red.

    Raises:
        UserError: not there, not readable, truncated, or of another pixel type.
    """
    image = decode(path, cv2.IMREAD_UNCHANGED)
    if image.ndim == 3 and image.shape[2] == 4:
        image = image[:, :, :3]
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.dtype == np.uint16:
        image = image << (16 - bits)
    if image.ndim == 3 and image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    if image.dtype not in (np.uint8, np.uint16):
        raise UserError(f"{path} has {image.dtype} pixels: convert it to 8 or 16 bits")
    return np.ascontiguousarray(image)


def bits_used(paths: Iterable[Path]) -> int:
    """How many of 16 bits the images of a folder use, of what cameras have: 10, 12, 14 or 16. All
    of them are asked, for one may be dark; those of 8 bits use all, and end the search."""
    most = 0
    for path in paths:
        try:
            image = decode(path, cv2.IMREAD_UNCHANGED)
        except UserError:
            continue
        if image.dtype != np.uint16:
            return 16
        most = max(most, int(image.max(initial=0)))
    return next(bits for bits in (10, 12, 14, 16) if most < 1 << bits)


def read_reduced(path: Path, size: tuple[int, int], least: int) -> NDArray[np.uint8]:
    """An image (h, w, 3) as it is stored, BGR, decoded a half, quarter or eighth as large where
    nothing more is needed, which takes less time.

    Args:
        path: of the file.
        size: its width and height, px.
        least: px, of the longer side.

    Raises:
        UserError: not there, not readable, or truncated.
    """
    smaller = max(size) // least
    flags = next(flag for by, flag in _REDUCED.items() if smaller >= by or by == 1)
    return decode(path, flags | cv2.IMREAD_IGNORE_ORIENTATION)


def orientation(path: Path) -> int:
    """How the EXIF data of a photograph say to turn it, 1 to 8; 1, not at all, where they say
    nothing."""
    try:
        with Image.open(path) as image:
            return int(image.getexif().get(_ORIENTATION, _UPRIGHT))
    except Exception:  # of many kinds: whatever the parser stumbles over
        return _UPRIGHT


def turned(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Pixels (h, w) or (h, w, 3) as EXIF data say that a photograph is to be shown, where they turn
    it by a right angle; else as they are."""
    if orientation in _FLIPPED:
        pixels = np.swapaxes(pixels, 0, 1)
    return np.ascontiguousarray(np.rot90(pixels, _QUARTERS.get(orientation, 0)))


def decode(path: Path, flags: int) -> NDArray[Any]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"image {path} does not exist: correct its name") from None
    except OSError as error:
        raise UserError(f"image {path} cannot be read: {error.strerror}") from None
    if not data or (data.startswith((_PNG, _JPEG)) and not _is_whole(data)):
        raise UserError(f"image {path} is truncated or damaged: copy it again")
    with _quiet_opencv():
        try:
            image = cv2.imdecode(np.frombuffer(_as_stored(data), np.uint8), flags)
        except cv2.error:
            image = None
    if image is None:
        raise UserError(f"image {path} is truncated or of a kind that OpenCV cannot read")
    return image


def _as_stored(data: bytes) -> bytes:
    """A TIFF without its orientation, by which OpenCV turns these whatever it is told; others as
    they are."""
    order = _TIFF.get(data[:4])
    if order is None:
        return data
    try:
        (at,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, at)
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            if struct.unpack_from(f"{order}H", data, entry) == (_ORIENTATION,):
                upright = struct.pack(f"{order}HH", _UPRIGHT, 0)
                return data[: entry + 8] + upright + data[entry + 12 :]
    except struct.error:
        pass  # it is damaged, which the decoder says
    return data


def _is_whole(data: bytes) -> bool:
    """Whether nothing is missing of a PNG or JPEG: some versions of OpenCV fill that with grey."""
    try:
        with Image.open(BytesIO(data)) as image:
            if image.format == "PNG":
                image.verify()  # by the checksums of its chunks
            else:
                image.draft(None, (1, 1))  # an eighth of its size, which takes a third of the time
                image.load()
    except Exception:  # of many kinds: whatever the parser stumbles over
        return False
    return True


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Our error line says it; OpenCV's own would be a second and third."""
    log = getattr(cv2.utils, "logging", cv2)  # OpenCV 4.6, that of Ubuntu 24.04, has it in cv2
    level = log.getLogLevel()
    log.setLogLevel(0)  # silent
    try:
        yield
    finally:
        log.setLogLevel(level)
