"""Images of every encoding of the contract, as other programs may lay them out."""

import cv2
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CompressedImage, Image

from msg_adapters import decode_compressed, decode_image, decode_mask, encode_image, encode_jpeg
from msg_adapters.cloud import to_byte_array

RNG = np.random.default_rng(3)


def message(raw, encoding, big=False, padding=0):
    """raw: (h, w[, c]) array as it lies in memory."""
    h, w = raw.shape[:2]
    stored = raw.astype(raw.dtype.newbyteorder(">" if big else "<"))
    rows = np.frombuffer(stored.tobytes(), np.uint8).reshape(h, -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xEE)
    msg = Image(
        height=h,
        width=w,
        encoding=encoding,
        is_bigendian=int(big),
        step=rows.shape[1],
        data=to_byte_array(rows),
    )
    return deserialize_message(serialize_message(msg), Image)


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "mono16", "16UC1"])
def test_grey_is_passed_on_bit_for_bit(encoding, big, padding):
    dtype = np.uint16 if "16" in encoding else np.uint8
    raw = RNG.integers(0, np.iinfo(dtype).max, (5, 7), dtype, endpoint=True)
    got = decode_image(message(raw, encoding, big, padding))
    assert got.dtype == dtype
    np.testing.assert_array_equal(got, raw)


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "order"), [("bgr8", "012"), ("rgb8", "210"), ("bgra8", "012"), ("rgba8", "210")]
)
def test_colour_comes_out_as_bgr(encoding, order, padding):
    raw = RNG.integers(0, 256, (5, 7, len(encoding) - 1), np.uint8)
    got = decode_image(message(raw, encoding, padding=padding))
    np.testing.assert_array_equal(got, raw[:, :, [int(c) for c in order]])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_of_one_colour_becomes_that_colour(pattern, dtype):
    colour = {"b": 20, "g": 90, "r": 200}
    tile = np.array([colour[c] for c in pattern], dtype).reshape(2, 2)
    raw = np.tile(tile, (8, 9))
    got = decode_image(message(raw, f"bayer_{pattern}{8 * raw.itemsize}", padding=2))
    assert got.dtype == dtype
    np.testing.assert_array_equal(got[2:-2, 2:-2], np.broadcast_to([20, 90, 200], (12, 14, 3)))


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("yuyv", "yuyv"), ("yuv422_yuy2", "yuyv"), ("uyvy", "uyvy"), ("yuv422", "uyvy")],
)
@pytest.mark.parametrize("width", [8, 7])
def test_colour_of_half_the_columns(encoding, order, width):
    """As webcams send it: two grey values and one pair of colour differences a pair of pixels."""
    # BT.601 of (10, 20, 30) BGR, dark as no 16 to 235 is.
    values = {"y": 22, "u": 121, "v": 134}
    pair = [values[c] for c in order]
    raw = np.tile(np.array(pair, np.uint8).reshape(1, 2, 2), (6, 4, 1))[:, :width]
    got = decode_image(message(raw, encoding, padding=4))
    np.testing.assert_allclose(got, np.broadcast_to([10, 20, 30], (6, width, 3)), atol=2)


@pytest.mark.parametrize("y", [0, 3, 128, 252, 255])
def test_what_is_darkest_and_brightest_is_not_cut_off(y):
    raw = np.full((4, 6, 2), 128, np.uint8)
    raw[..., 0] = y
    assert (decode_image(message(raw, "yuyv")) == y).all()


def _spoil(**values):
    return lambda msg: [setattr(msg, k, v) for k, v in values.items()]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_spoil(encoding="nv21"), "not supported: let the driver send bgr8, rgb8 or mono8"),
        (_spoil(encoding=""), "is not supported"),
        (_spoil(encoding="bgr8"), "step 7 is less"),
        (_spoil(step=6), "step 6 is less"),
        (_spoil(step=8), "data has 35 bytes"),
        (_spoil(height=0), "empty"),
        (_spoil(width=0), "empty"),
        (_spoil(height=2**32 - 1), "data has 35 bytes"),
        (_spoil(width=2**32 - 1), "step 7 is less"),
        (lambda msg: msg.data.pop(), "data has 34 bytes"),
    ],
)
def test_a_wrong_image_is_refused_with_the_reason(spoil, says):
    msg = message(np.zeros((5, 7), np.uint8), "mono8")
    spoil(msg)
    with pytest.raises(ValueError, match=says):
        decode_image(msg)


def test_a_mosaic_too_small_to_interpolate_does_not_crash():
    try:
        got = decode_image(message(np.full((1, 1), 7, np.uint8), "bayer_rggb8"))
    except ValueError:
        return
    assert got.shape == (1, 1, 3)


def test_a_mask_is_mono8():
    raw = np.eye(4, dtype=np.uint8)
    np.testing.assert_array_equal(decode_mask(message(raw, "mono8")), raw)
    with pytest.raises(ValueError, match="must be mono8"):
        decode_mask(message(raw.astype(np.uint16), "mono16"))


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding"),
    [
        ((4, 6), np.uint8, None),
        ((4, 6), np.uint16, None),
        ((4, 6, 3), np.uint8, None),
        ((4, 6, 3), np.uint8, "rgb8"),
    ],
)
def test_encoded_images_come_back(shape, dtype, encoding):
    pixels = RNG.integers(0, np.iinfo(dtype).max, shape, dtype)
    msg = encode_image(pixels, 7, "camera", encoding)
    np.testing.assert_array_equal(
        decode_image(deserialize_message(serialize_message(msg), Image)), pixels
    )
    assert msg.header.frame_id == "camera"


def test_encode_refuses_what_it_cannot_send():
    with pytest.raises(ValueError, match="float64"):
        encode_image(np.zeros((3, 3)), 0, "camera")
    with pytest.raises(ValueError, match="as rgb8"):
        encode_image(np.zeros((3, 3), np.uint8), 0, "camera", "rgb8")


def compressed(pixels, suffix, options=()):
    data = cv2.imencode(suffix, pixels, list(options))[1]
    return CompressedImage(format=suffix[1:], data=to_byte_array(data))


@pytest.mark.parametrize(
    "shape_dtype", [((9, 8), np.uint8), ((9, 8), np.uint16), ((9, 8, 3), np.uint8)]
)
def test_png_is_read_without_loss(shape_dtype):
    shape, dtype = shape_dtype
    pixels = RNG.integers(0, np.iinfo(dtype).max, shape, dtype)
    got = decode_compressed(compressed(pixels, ".png"))
    assert got.dtype == dtype
    np.testing.assert_array_equal(got, pixels)


def test_jpeg_goes_there_and_back():
    pixels = np.full((16, 24, 3), (200, 30, 90), np.uint8)
    msg = encode_jpeg(pixels, 3, "camera", quality=95)
    assert msg.format == "jpeg"
    np.testing.assert_allclose(decode_compressed(msg).astype(int), pixels, atol=4)


def test_alpha_of_a_png_is_left_out():
    pixels = RNG.integers(0, 256, (5, 5, 4), np.uint8)
    np.testing.assert_array_equal(decode_compressed(compressed(pixels, ".png")), pixels[..., :3])


def test_the_orientation_note_of_a_jpeg_is_passed_over():
    pixels = np.zeros((16, 32), np.uint8)
    pixels[:8] = 255
    jpeg = cv2.imencode(".jpg", pixels)[1].tobytes()
    # An Exif segment that says "turn by 180 degrees" (orientation 3).
    tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0"
    exif = b"Exif\0\0" + tiff
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    data = np.frombuffer(jpeg[:2] + segment + jpeg[2:], np.uint8)
    turned = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert turned[0, 0, 0] < 50  # the note is a real one: OpenCV follows it by default
    got = decode_compressed(CompressedImage(format="jpeg", data=to_byte_array(data)))
    np.testing.assert_allclose(got.astype(int), pixels, atol=4)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"not an image at all"])
def test_what_is_no_image_is_refused(data):
    msg = CompressedImage(format="jpeg", data=to_byte_array(np.frombuffer(data, np.uint8)))
    with pytest.raises(ValueError, match="not a readable image"):
        decode_compressed(msg)


def test_compressed_depth_is_refused():
    with pytest.raises(ValueError, match="depth map"):
        decode_compressed(CompressedImage(format="16UC1; compressedDepth"))
