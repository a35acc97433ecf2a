"""The focal length that a phone or camera writes into its photographs."""

import struct
from math import hypot

_FULL_FRAME_DIAGONAL_MM = hypot(36, 24)
_EXIF_POINTER, _FOCAL_35MM = 0x8769, 0xA405
_SHORT, _LONG = 3, 4


def exif_focal_px(data: bytes, width: int, height: int) -> float | None:
    """Focal length in pixels, from FocalLengthIn35mmFilm of a JPEG file.

    It is given in whole millimetres, by the diagonal: good to some per cent.

    Args:
        data: the file, or its first 64 kB.
        width, height: of the image as it is now, pixels.

    Returns:
        None where the file does not say.
    """
    try:
        tags = _exif(data)
    except (struct.error, IndexError, ValueError):
        return None
    value = tags.get(_FOCAL_35MM)
    return hypot(width, height) * value / _FULL_FRAME_DIAGONAL_MM if value else None


def _exif(data: bytes) -> dict[int, int]:
    """Whole numbers of the EXIF block, by tag."""
    at = 2
    if data[:2] != b"\xff\xd8":
        return {}
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        size = struct.unpack_from(">H", data, at + 2)[0]
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            block = data[at + 10 : at + 2 + size]
            order = {b"II": "<", b"MM": ">"}[block[:2]] if block[:2] in (b"II", b"MM") else ""
            if not order:
                return {}
            tags = _directory(block, struct.unpack_from(f"{order}I", block, 4)[0], order)
            if _EXIF_POINTER in tags:
                tags |= _directory(block, tags[_EXIF_POINTER], order)
            return tags
        at += 2 + size
    return {}


def _directory(block: bytes, at: int, order: str) -> dict[int, int]:
    tags = {}
    for k in range(struct.unpack_from(f"{order}H", block, at)[0]):
        tag, kind = struct.unpack_from(f"{order}HH", block, at + 2 + 12 * k)
        if kind in (_SHORT, _LONG):
            form = "H" if kind == _SHORT else "I"
            tags[tag] = struct.unpack_from(f"{order}{form}", block, at + 10 + 12 * k)[0]
    return tags
