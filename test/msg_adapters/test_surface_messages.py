"""contours, rim, strip and the marker: the fields of the contract, there and back."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker

from msg_adapters import (
    decode_contours,
    decode_rim,
    decode_shape,
    decode_strip,
    encode_contours,
    encode_marker,
    encode_rim,
    encode_strip,
)
from occ_recon_ros.geometry import Camera, Rim, contours_from_loops
from occ_recon_ros.geometry.shape import Shape
from occ_recon_ros.surface import Strip

XYZ = ["x", "y", "z"]
NORMAL = ["normal_x", "normal_y", "normal_z"]
F, U2, U1 = PointField.FLOAT32, PointField.UINT16, PointField.UINT8
U4 = PointField.UINT32


def wire(msg):
    """Through the serialised form, as a peer would get it."""
    return deserialize_message(serialize_message(msg), type(msg))


def two_loops():
    camera = Camera(
        K=[[800, 0, 320], [0, 810, 240], [0, 0, 1]],
        width=640,
        height=480,
        R_camera_object=[[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
        t_camera_object=[0.1, 0.05, 1.5],
    )
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.column_stack([np.cos(angle), -np.sin(angle)])
    loops = [320 + 100 * circle, 320 + 20 * circle[::-4]]
    sigma = [np.full(200, 0.2), np.r_[np.inf, np.full(49, 0.3)]]
    return contours_from_loops(camera, loops, [7, 65535], sigma, 123_456_789_012, "turntable")


def some_rim(n=50):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(n, 3))
    status = (np.arange(n) % 6).astype(np.uint8)
    points = rng.normal(size=(n, 3))
    points[status == 3] = np.nan
    return Rim(
        stamp_ns=5,
        frame_id="turntable",
        centre=np.array([0.5, -1.25, 2.0]),
        points=points,
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        curvature=rng.normal(size=n),
        depth_sigma=rng.random(n),
        loop=np.full(n, 3, np.uint16),
        prev=np.where(status == 1, np.nan, rng.random(n) * 40),
        status=status,
        prev_stamp_ns=1_700_000_000_123_456_789,
    )


def some_strip(n=10, colour=False):
    rng = np.random.default_rng(1)
    return Strip(
        stamp_ns=9,
        frame_id="turntable",
        corners=rng.normal(size=(n, 3, 3)).astype(np.float32),
        normals=rng.normal(size=(n, 3, 3)).astype(np.float32),
        depth_sigma=rng.random((n, 3)).astype(np.float32),
        rgb=rng.integers(0, 256, (n, 3, 3)).astype(np.uint8) if colour else None,
    )


def test_contours_have_the_fields_of_the_contract():
    msg = encode_contours(two_loops())
    names = [*XYZ, "vp_x", "vp_y", "vp_z", *NORMAL, "u", "v", "loop", "sigma"]
    types = [F] * 11 + [U2, F]
    assert [(f.name, f.datatype) for f in msg.fields] == list(zip(names, types, strict=True))
    assert (msg.height, msg.width) == (1, 250)
    assert msg.header.frame_id == "turntable"
    assert msg.is_dense


def test_contours_come_back_to_float32_precision():
    sent = two_loops()
    got = decode_contours(wire(encode_contours(sent)))
    assert (got.stamp_ns, got.frame_id) == (sent.stamp_ns, sent.frame_id)
    for name, tolerance in (("centre", 1e-6), ("T", 3e-7), ("N", 3e-7), ("uv", 3e-5)):
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), atol=tolerance)
    np.testing.assert_array_equal(got.loop, sent.loop)
    np.testing.assert_allclose(got.sigma, sent.sigma, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(got.T, axis=1), 1, atol=1e-15)


@pytest.mark.parametrize("far_m", [1e3, 3e4, 1e6])
def test_contours_far_from_the_origin_come_back_as_far_as_float32_tells(far_m):
    sent = replace(two_loops(), centre=np.array([0.6, -0.8, 0.1]) * far_m)
    got = decode_contours(wire(encode_contours(sent)))
    np.testing.assert_allclose(got.T, sent.T, atol=4 * 2.0**-24 * far_m)
    np.testing.assert_allclose(np.linalg.norm(got.T, axis=1), 1, atol=1e-15)


def _put(name, row, value):
    def spoil(msg):
        at = {f.name: f.offset for f in msg.fields}[name] + row * msg.point_step
        code = {F: "<f4", U2: "<u2", U1: "u1", U4: "<u4"}[
            next(f.datatype for f in msg.fields if f.name == name)
        ]
        raw = np.array(value, code).tobytes()
        for k, byte in enumerate(raw):
            msg.data[at + k] = byte

    return spoil


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_put("x", 3, np.nan), "distance 1"),
        (_put("x", 3, 1e30), "distance 1"),
        (lambda msg: [_put("vp_y", k, 3e38)(msg) for k in range(250)], "distance 1"),
        (_put("vp_y", 3, 9.0), "one finite camera centre"),
        (_put("vp_y", 0, np.inf), "one finite camera centre"),
        (_put("normal_z", 0, np.nan), "length 1"),
        (_put("normal_z", 0, 5), "length 1"),
        (_put("u", 0, np.inf), "u v must be finite"),
        (_put("loop", 100, 65535), "one piece"),
        (_put("sigma", 9, -1), "sigma"),
        (_put("sigma", 9, np.nan), "sigma"),
        (lambda msg: setattr(msg.header.stamp, "nanosec", 2**32 - 1), "not a time"),
        (lambda msg: setattr(msg.header.stamp, "sec", -1), "not a time"),
    ],
)
def test_spoiled_contours_are_refused_with_the_reason(spoil, says):
    msg = wire(encode_contours(two_loops()))
    spoil(msg)
    with pytest.raises(ValueError, match=says):
        decode_contours(msg)


def test_normals_along_the_ray_are_refused():
    contours = two_loops()
    with pytest.raises(ValueError, match="perpendicular"):
        decode_contours(encode_contours(replace(contours, N=contours.T)))


def test_empty_contours_are_contours():
    sent = two_loops()
    none = {k: getattr(sent, k)[:0] for k in ("T", "N", "uv", "loop", "sigma")}
    got = decode_contours(wire(encode_contours(replace(sent, **none))))
    assert len(got) == 0
    assert got.stamp_ns == sent.stamp_ns


def test_rim_has_the_fields_of_the_contract_and_comes_back():
    sent = some_rim()
    msg = wire(encode_rim(sent))
    names = [*XYZ, *NORMAL, "curvature", "depth_sigma", "loop", "prev"]
    names += ["vp_x", "vp_y", "vp_z", "prev_sec", "prev_nanosec", "status"]
    types = [F] * 8 + [U2] + [F] * 4 + [U4, U4, U1]
    assert [(f.name, f.datatype) for f in msg.fields] == list(zip(names, types, strict=True))
    assert not msg.is_dense  # some points are NaN
    got = decode_rim(msg)
    for name in ("centre", "points", "normals", "curvature", "depth_sigma", "prev"):
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), rtol=1e-6)
    assert (got.stamp_ns, got.prev_stamp_ns) == (5, 1_700_000_000_123_456_789)
    np.testing.assert_array_equal(got.status, sent.status)
    np.testing.assert_array_equal(got.loop, sent.loop)


def test_a_rim_may_bring_its_shape():
    rim = some_rim()
    shape = Shape(rim.curvature, *np.arange(4.0 * len(rim)).reshape(4, -1))
    msg = wire(encode_rim(rim, shape))
    assert [f.name for f in msg.fields][16:] == ["k_s", "theta", "gauss", "mean"]
    np.testing.assert_array_equal(decode_rim(msg).status, rim.status)
    got = decode_shape(msg)
    for name in ("k_s", "theta", "gauss", "mean"):
        np.testing.assert_allclose(getattr(got, name), getattr(shape, name), rtol=1e-6)
    assert decode_shape(wire(encode_rim(rim))) is None


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_put("status", 3, 6), "status must be 0 to 5"),
        (_put("x", 6, np.nan), "must be finite"),
        (_put("normal_x", 6, 3), "normal of length 1"),
        (_put("prev", 2, -1), "prev"),
        (_put("prev", 2, np.inf), "prev"),
        (_put("prev_sec", 2, 4), "same in all rows"),
        (_put("vp_y", 2, 4), "one finite camera centre"),
    ],
)
def test_spoiled_rims_are_refused_with_the_reason(spoil, says):
    msg = wire(encode_rim(some_rim()))
    spoil(msg)
    with pytest.raises(ValueError, match=says):
        decode_rim(msg)


@pytest.mark.parametrize("colour", [False, True])
def test_strip_is_organised_by_triangles_and_comes_back(colour):
    sent = some_strip(colour=colour)
    msg = wire(encode_strip(sent))
    names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"] + ["rgb"] * colour + ["depth_sigma"]
    assert [(f.name, f.datatype) for f in msg.fields] == [(n, F) for n in names]
    assert (msg.height, msg.width) == (10, 3)
    got = decode_strip(msg)
    for name in ("corners", "normals", "depth_sigma"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
    if colour:
        np.testing.assert_array_equal(got.rgb, sent.rgb)
    else:
        assert got.rgb is None


def test_rgb_is_packed_as_pcl_does():
    strip = replace(some_strip(1), rgb=np.full((1, 3, 3), (1, 2, 3), np.uint8))
    msg = encode_strip(strip)
    at = {f.name: f.offset for f in msg.fields}["rgb"]
    assert bytes(msg.data[at : at + 4]) == bytes([3, 2, 1, 0])


def test_empty_strip_is_height_zero():
    msg = wire(encode_strip(some_strip(0)))
    assert (msg.height, msg.width) == (0, 3)
    assert len(decode_strip(msg)) == 0


def test_a_cloud_of_other_width_is_no_strip():
    msg = encode_strip(some_strip(4))
    msg.height, msg.width, msg.row_step = 6, 2, 2 * msg.point_step
    with pytest.raises(ValueError, match="width must be 3"):
        decode_strip(msg)


def test_marker_lists_whole_triangles_and_is_thinned():
    strip = some_strip(1000)
    whole = wire(encode_marker(strip, 2000))
    assert (whole.type, whole.action) == (Marker.TRIANGLE_LIST, Marker.ADD)
    assert whole.pose.orientation.w == 1.0
    assert (whole.scale.x, whole.scale.y, whole.scale.z) == (1.0, 1.0, 1.0)
    got = np.array([(p.x, p.y, p.z) for p in whole.points])
    np.testing.assert_allclose(got, strip.corners.reshape(-1, 3))
    thin = encode_marker(strip, 30)
    corners = np.array([(p.x, p.y, p.z) for p in thin.points]).reshape(-1, 3, 3)
    assert len(corners) == 30
    assert all((strip.corners == triangle).all(axis=(1, 2)).any() for triangle in corners)


def test_marker_of_nothing_deletes():
    marker = encode_marker(some_strip(0), 10)
    assert marker.action == Marker.DELETE
    assert not marker.points


def test_marker_carries_colours():
    strip = some_strip(2, colour=True)
    colours = np.array([(c.r, c.g, c.b, c.a) for c in encode_marker(strip, 2).colors])
    np.testing.assert_allclose(colours[:, :3], strip.rgb.reshape(-1, 3) / 255, atol=1e-7)
    assert (colours[:, 3] == 1).all()


def test_contours_are_not_a_rim():
    with pytest.raises(ValueError, match="field 'curvature' is missing"):
        decode_rim(encode_contours(two_loops()))
    with pytest.raises(ValueError, match="is missing"):
        decode_contours(PointCloud2())


def test_no_previous_frame_and_one_at_time_zero_are_two_things():
    first = replace(some_rim(), prev=np.full(50, np.nan), prev_stamp_ns=None)
    msg = wire(encode_rim(first))
    at = {f.name: f.offset for f in msg.fields}
    for name in ("prev_sec", "prev_nanosec"):
        assert bytes(msg.data[at[name] : at[name] + 4]) == b"\xff" * 4
    assert decode_rim(msg).prev_stamp_ns is None
    assert decode_rim(wire(encode_rim(replace(some_rim(), prev_stamp_ns=0)))).prev_stamp_ns == 0
    with pytest.raises(ValueError, match="row of no rim"):
        decode_rim(wire(encode_rim(replace(some_rim(), prev_stamp_ns=None))))
