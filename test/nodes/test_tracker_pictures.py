"""What a camera driver may send, as real messages to the real tracker."""

import cv2
import numpy as np
import pytest
from rig import SECOND, views
from sensor_msgs.msg import CompressedImage, Image

from msg_adapters import decode_contours, encode_camera_info, encode_header, encode_pose
from msg_adapters.cloud import to_byte_array

_MOSAICS = [f"bayer_{p}{n}" for p in ("rggb", "bggr", "gbrg", "grbg") for n in (8, 16)]
_ENCODINGS = ["mono8", "8UC1", "mono16", "16UC1", "bgr8", "rgb8", "bgra8", "rgba8", *_MOSAICS]


def written(grey, encoding, stamp):
    """A grey scene as an image message, put together byte by byte."""
    pixels = grey
    if encoding.endswith(("16", "16UC1")):
        pixels = (1000 + 3 * grey.astype("<u2")).astype("<u2")  # no two levels of its upper byte
    if encoding[:3] in ("bgr", "rgb"):
        pixels = np.repeat(grey[..., None], len(encoding) - 1, axis=2)
    return Image(
        header=encode_header(stamp, "camera"),
        height=grey.shape[0],
        width=grey.shape[1],
        encoding=encoding,
        step=pixels.strides[0],
        data=to_byte_array(pixels),
    )


def found_in(graph, image, info=None):
    """Contours that the node makes of an image message of the first view."""
    camera, _ = views()[0]
    stamp = image.header.stamp.sec * SECOND
    made, drops = len(graph.rig.got["contours"]), graph.tracker.drops.total()
    graph.rig.info.publish(info or encode_camera_info(camera, stamp, "camera"))
    graph.rig.pose.publish(encode_pose(camera, stamp, "turntable"))
    graph.rig.image.publish(image)
    graph.ros.spin_until(
        lambda: len(graph.rig.got["contours"]) > made or graph.tracker.drops.total() > drops
    )
    assert not graph.tracker.drops
    return decode_contours(graph.rig.got["contours"][-1])


def off_the_line(a, b):
    """How far the samples of an outline lie off another, px, in the mean."""
    moved = a.uv[:, None] - b.uv[None]
    nearest = np.linalg.norm(moved, axis=2).argmin(axis=1)
    along = b.uv[b.next_row] - b.uv[b.previous_row]
    out = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    off = (moved[np.arange(len(a)), nearest] * out[nearest]).sum(axis=1)
    return np.abs(off).mean()


def test_every_encoding_gives_the_same_contours(graph):
    _, grey = views()[0]
    plain = found_in(graph, written(grey, "mono8", SECOND))
    for k, encoding in enumerate(_ENCODINGS):
        got = found_in(graph, written(grey, encoding, (k + 2) * SECOND))
        # A mosaic is interpolated.
        assert off_the_line(got, plain) < (0.1 if encoding in _MOSAICS else 0.01), encoding


@pytest.mark.parametrize(
    ("model", "D"),
    [
        ("plumb_bob", (-0.2, 0.1, 0.001, -0.002, 0.03)),
        ("rational_polynomial", (-0.2, 0.1, 0.001, -0.002, 0.03, 0.1, -0.05, 0.01)),
        ("equidistant", (0.05, -0.01, 0.003, -0.001)),
    ],
)
def test_rays_are_those_of_opencv_for_each_distortion(graph, model, D):
    camera, grey = views()[0]
    info = encode_camera_info(camera, SECOND, "camera")
    info.distortion_model, info.d = model, list(D)
    got = found_in(graph, written(grey, "mono8", SECOND), info)
    rays = (got.T @ camera.R_camera_object.T)[:, None]  # as points, 1 m away
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    uv = project(rays, np.zeros(3), np.zeros(3), camera.K, np.array(D))[0]
    np.testing.assert_allclose(uv[:, 0], got.uv, atol=1e-3)
    assert np.abs(got.uv - camera.project(camera.centre + got.T)).max() > 0.02  # it matters


def test_a_binned_part_of_the_sensor_gives_the_same_rays(graph):
    camera, grey = views()[0]
    plain = found_in(graph, written(grey, "mono8", SECOND))
    info = encode_camera_info(camera, 2 * SECOND, "camera")
    # The 320 x 240 pixels are 2 x 2 binned from (100, 60) on; a pixel's centre is at its middle.
    K = np.diag([2.0, 2.0, 1.0]) @ camera.K
    K[:2, 2] += (100.5, 60.5)
    info.width, info.height, info.k = 900, 700, K.ravel()
    info.binning_x = info.binning_y = 2
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 100, 60, 640, 480
    got = found_in(graph, written(grey, "mono8", 2 * SECOND), info)
    np.testing.assert_array_equal(got.uv, plain.uv)
    np.testing.assert_allclose(got.T, plain.T, atol=1e-6)
    np.testing.assert_allclose(got.N, plain.N, atol=1e-6)


def test_sixteen_bits_in_a_compressed_image_are_all_used(graph):
    camera, grey = views()[0]
    plain = found_in(graph, written(grey, "mono8", SECOND))
    publisher = graph.rig.create_publisher(CompressedImage, "image/compressed", 5)
    graph.ros.spin_until(publisher.get_subscription_count)
    graph.tracker.carrier = None
    stamp = 2 * SECOND
    graph.rig.send((camera, grey), stamp, parts=("info", "pose"))
    data = to_byte_array(cv2.imencode(".png", (1000 + 3 * grey.astype(np.uint16)))[1])
    header = encode_header(stamp, "camera")
    publisher.publish(CompressedImage(header=header, format="16UC1; png", data=data))
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    got = decode_contours(graph.rig.got["contours"][-1])
    assert off_the_line(got, plain) < 0.01


def test_a_hot_pixel_does_not_hide_the_object(graph):
    _, grey = views()[0]
    plain = found_in(graph, written(grey, "mono8", SECOND))
    image = written(grey, "mono16", 2 * SECOND)
    pixels = np.frombuffer(image.data, "<u2").reshape(grey.shape).copy()
    pixels[5, 5], pixels[8, 8] = 65535, 0
    image.data = to_byte_array(pixels)
    got = found_in(graph, image)
    assert off_the_line(got, plain) < 0.01
