"""Image files, read whole or not at all."""

import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_JPEG_SCAN_END = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")


def read_image(path: Path) -> NDArray[Any]:
    """An image as the file is: grey of 8 or 16 bits, or 8-bit colour.

    The pixels stay in the order of the file (an EXIF rotation is not applied: calibrations
    are made on the sensor's rows and columns). An alpha channel is left out. Colour of 16
    bits becomes 8 bits, the deepest that a ROS colour encoding of ours holds.

    Returns:
        (h, w) uint8 or uint16, or (h, w, 3) uint8 in the order blue, green, red.

    Raises:
        UserError: not there, not readable, truncated, or of another pixel type.
    """
    image = _decode(path, cv2.IMREAD_UNCHANGED)
    if image.ndim == 3 and image.shape[2] == 4:
        image = image[:, :, :3]
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim == 3 and image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    if image.dtype not in (np.uint8, np.uint16):
        raise UserError(f"{path} has {image.dtype} pixels: convert it to 8 or 16 bits")
    return np.ascontiguousarray(image)


def read_mask(path: Path) -> NDArray[np.uint8]:
    """A mask image as (h, w) uint8, 255 on the object, 0 elsewhere, between them coverage.

    Of an image with transparency that is the mask, of others the grey levels in relation to
    the brightest, so that masks of 0 and 1 come out right. Levels of a JPEG are ripples.

    Raises:
        UserError: not there, not readable, or truncated.
    """
    pixels = _decode(path, cv2.IMREAD_UNCHANGED)
    if pixels.ndim == 3 and pixels.shape[2] == 4 and np.ptp(pixels[:, :, 3]) > 0:
        grey = pixels[:, :, 3]
    else:
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
        grey = _decode(path, flags)
    levels = np.rint(grey * (255.0 / max(1, int(grey.max())))).astype(np.uint8)
    if path.suffix.lower() in (".jpg", ".jpeg"):
        return np.where(levels > 127, np.uint8(255), np.uint8(0))
    return levels


def read_cut_out(path: Path) -> NDArray[np.uint8] | None:
    """The mask that an image holds in itself, for its object was cut out: (h, w) uint8, its
    alpha channel; None where it has none or one that says the same everywhere.

    Raises:
        UserError: not there, not readable, or truncated.
    """
    pixels = _decode(path, cv2.IMREAD_UNCHANGED)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or not np.ptp(pixels[:, :, 3]):
        return None
    return read_mask(path)


def _decode(path: Path, flags: int) -> NDArray[Any]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"image {path} does not exist: correct its name in cameras.json") from None
    except OSError as error:
        raise UserError(f"image {path} cannot be read: {error.strerror}") from None
    # Some versions of OpenCV fill the missing part of a truncated PNG or JPEG with grey.
    if not data or (data.startswith(_PNG) and not _png_is_whole(data)):
        raise UserError(f"image {path} is truncated or damaged: copy it again")
    if data.startswith(_JPEG) and not _jpeg_is_whole(data):
        raise UserError(f"image {path} is truncated or damaged: copy it again")
    with _quiet_opencv():
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:
            image = None
    if image is None:
        raise UserError(f"image {path} is truncated or of a kind that OpenCV cannot read")
    return image


def _png_is_whole(data: bytes) -> bool:
    """True when every chunk up to IEND is there and has its checksum."""
    at = len(_PNG)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        kind = data[at + 4 : at + 8]
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return False
        if kind == b"IEND":
            return True
        at = end + 4
    return False


def _jpeg_is_whole(data: bytes) -> bool:
    """True when the segments lead to an end-of-image marker (and not a thumbnail's)."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xD9:
            return True
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == 0xDA:  # entropy-coded data follow, up to the next marker
            end = _JPEG_SCAN_END.search(data, at)
            if end is None:
                return False
            at = end.start()
    return data[at : at + 2] == b"\xff\xd9"


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
