"""Images: raw and compressed messages to arrays and back."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image

from .cloud import to_byte_array
from .header import encode_header

Picture = NDArray[Any]
"""(h, w) or (h, w, 3) BGR pixels, uint8 or uint16, native byte order."""

# encoding: bytes a channel, channels, cv2 colour conversion to BGR (None: as it is).
# OpenCV names a Bayer pattern by the second row, from its second column.
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "8UC1": (1, 1, None),
    "mono16": (2, 1, None),
    "16UC1": (2, 1, None),
    "bgr8": (1, 3, None),
    "rgb8": (1, 3, cv2.COLOR_RGB2BGR),
    "bgra8": (1, 4, cv2.COLOR_BGRA2BGR),
    "rgba8": (1, 4, cv2.COLOR_RGBA2BGR),
    "yuv422": (1, 2, cv2.COLOR_YUV2BGR_UYVY),  # sensor_msgs' name of it
    "uyvy": (1, 2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (1, 2, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (1, 2, cv2.COLOR_YUV2BGR_YUYV),
    **{
        f"bayer_{pattern}{8 * size}": (size, 1, code)
        for pattern, code in (
            ("rggb", cv2.COLOR_BayerBG2BGR),
            ("bggr", cv2.COLOR_BayerRG2BGR),
            ("gbrg", cv2.COLOR_BayerGR2BGR),
            ("grbg", cv2.COLOR_BayerGB2BGR),
        )
        for size in (1, 2)
    },
}

_BRIGHTNESS_AT = {cv2.COLOR_YUV2BGR_YUYV: 0, cv2.COLOR_YUV2BGR_UYVY: 1}  # of two channels


def decode_image(msg: Image) -> Picture:
    """Pixels of an image.

    Returns:
        (height, width) or (height, width, 3) BGR, uint8 or uint16; colour mosaics are
        interpolated, YUV is taken as BT.601 of all 256 values, alpha is left out, everything
        else is passed on bit for bit.

    Raises:
        ValueError: an encoding that is not supported, no pixels, sizes that do not add up.
    """
    if msg.encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise ValueError(
            f"encoding '{msg.encoding}' is not supported: let the driver send bgr8, rgb8 or mono8, "
            f"or image_proc convert it; one of {known} is needed"
        )
    size, channels, code = _ENCODINGS[msg.encoding]
    height, width, step = int(msg.height), int(msg.width), int(msg.step)
    if not height * width:
        raise ValueError(f"the image is empty: {width}x{height}")
    if step < width * channels * size:
        raise ValueError(f"step {step} is less than a row of {width} {msg.encoding} pixels")
    if len(msg.data) != height * step:
        raise ValueError(f"data has {len(msg.data)} bytes, {height} rows need {height * step}")
    dtype = np.dtype(f"{'>' if msg.is_bigendian else '<'}u{size}")
    grey = channels == 1
    shape = (height, width) if grey else (height, width, channels)
    strides = (step, size) if grey else (step, channels * size, size)
    data = np.frombuffer(msg.data, np.uint8)
    pixels = np.ndarray(shape, dtype, buffer=data.data, strides=strides)
    pixels = np.ascontiguousarray(pixels, dtype.newbyteorder("="))
    return pixels if code is None else _convert(pixels, code)


def decode_mask(msg: Image | CompressedImage) -> NDArray[np.uint8]:
    """(height, width) uint8 of a mono8 or compressed mask, 0 = background.

    Raises:
        ValueError: another encoding, or as ``decode_image``.
    """
    if isinstance(msg, CompressedImage):
        pixels = decode_compressed(msg)
        if pixels.ndim != 2 or pixels.dtype != np.uint8:
            raise ValueError(f"a mask must be grey of 8 bits, got '{msg.format}' in colour")
        return np.asarray(pixels, np.uint8)
    if msg.encoding not in ("mono8", "8UC1"):
        raise ValueError(f"a mask must be mono8, got '{msg.encoding}'")
    return decode_image(msg)


def decode_compressed(msg: CompressedImage) -> Picture:
    """Pixels of a compressed image, as ``decode_image``.

    The orientation noted in a JPEG is passed over: calibration belongs to the sensor's rows.

    Raises:
        ValueError: not an image, or a depth map of compressed_depth_image_transport.
    """
    if "compressedDepth" in msg.format:
        raise ValueError(f"format '{msg.format}' is a depth map, not a picture")
    data = np.frombuffer(msg.data, np.uint8)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = cv2.imdecode(data, flags) if len(data) else None
    except cv2.error as error:
        raise ValueError(f"format '{msg.format}' cannot be read: {error.err}") from error
    if pixels is None:
        raise ValueError(f"{len(data)} bytes of format '{msg.format}' are not a readable image")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"pixels of type {pixels.dtype} are not supported")
    return pixels


def encode_image(
    pixels: Picture, stamp_ns: int, frame_id: str, encoding: str | None = None
) -> Image:
    """An image message from grey or BGR pixels.

    Args:
        pixels: (h, w) uint8 or uint16, or (h, w, 3) uint8.
        encoding: mono8, mono16, bgr8 (the default of each shape) or rgb8.

    Raises:
        ValueError: pixels of another shape or type.
    """
    kinds = {(2, "uint8"): "mono8", (2, "uint16"): "mono16", (3, "uint8"): "bgr8"}
    natural = kinds.get((pixels.ndim, pixels.dtype.name))
    if natural is None or (pixels.ndim == 3 and pixels.shape[2] != 3):
        raise ValueError(f"cannot send {pixels.dtype} pixels of shape {pixels.shape}")
    encoding = encoding or natural
    if encoding == "rgb8" and natural == "bgr8":
        pixels = pixels[:, :, ::-1]
    elif encoding != natural:
        raise ValueError(f"cannot send {natural} pixels as {encoding}")
    little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    return Image(
        header=encode_header(stamp_ns, frame_id),
        height=int(pixels.shape[0]),
        width=int(pixels.shape[1]),
        encoding=encoding,
        is_bigendian=0,
        step=int(little.strides[0]),
        data=to_byte_array(little),
    )


def encode_jpeg(
    pixels: NDArray[np.uint8], stamp_ns: int, frame_id: str, quality: int = 90
) -> CompressedImage:
    """A JPEG message from (h, w) grey or (h, w, 3) BGR uint8 pixels."""
    good, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    if not good:
        raise ValueError(f"cannot compress {pixels.dtype} pixels of shape {pixels.shape}")
    return CompressedImage(
        header=encode_header(stamp_ns, frame_id), format="jpeg", data=to_byte_array(data)
    )


def _convert(pixels: Picture, code: int) -> Picture:
    if code in _BRIGHTNESS_AT:
        return _from_yuv(pixels, _BRIGHTNESS_AT[code])
    try:
        return cv2.cvtColor(pixels, code)
    except cv2.error as error:  # a mosaic smaller than its filter
        raise ValueError(f"cannot convert a {pixels.shape} image: {error.err}") from error


def _from_yuv(pixels: Picture, at: int) -> Picture:
    """BGR (h, w, 3) of (h, w, 2), of which the one channel is brightness and the other in turn the
    two colour differences.

    OpenCV cuts off what is not within 16 and 235, and no message says whether a camera keeps to
    that: of a dark object before a dark backdrop whose camera does not, a body lost 5 % of its
    silhouettes by it. Taken for one that does not, one that does loses a seventh of its contrast,
    and 1.5 % of them.
    """
    width = pixels.shape[1]
    colour = pixels[:, : width - width % 2, 1 - at].reshape(len(pixels), -1, 2).repeat(2, axis=1)
    colour = np.pad(colour, ((0, 0), (0, width % 2), (0, 0)), mode="edge")
    return cv2.cvtColor(np.dstack([pixels[..., at], colour[..., ::-1]]), cv2.COLOR_YCrCb2BGR)
