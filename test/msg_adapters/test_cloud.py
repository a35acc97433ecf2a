"""Clouds are read by what the message says, not by what we would have written."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.cloud import decode_cloud, encode_cloud, records, to_byte_array

LAYOUT = (("a", "f4"), ("b", "u2"), ("c", "u1"))


def foreign_cloud(values, order, offsets, point_step, row_padding, big):
    """The same values as another program might lay them out."""
    height, width = values.shape
    raw = np.full((height, width * point_step + row_padding), 0xAB, np.uint8)
    fields = []
    for name in order:
        dtype = values.dtype[name].newbyteorder(">" if big else "<")
        size = dtype.itemsize
        column = values[name].astype(dtype).tobytes()
        column = np.frombuffer(column, np.uint8).reshape(height, width, size)
        for w in range(width):
            start = w * point_step + offsets[name]
            raw[:, start : start + size] = column[:, w]
        datatype = {"a": PointField.FLOAT32, "b": PointField.UINT16, "c": PointField.UINT8}[name]
        fields.append(PointField(name=name, offset=offsets[name], datatype=datatype, count=1))
    return PointCloud2(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big,
        point_step=point_step,
        row_step=raw.shape[1],
        data=to_byte_array(raw),
    )


def sample(height=2, width=3):
    values = records(LAYOUT, (height, width))
    values["a"] = np.linspace(-1, 1e9, height * width).reshape(height, width)
    values["b"] = np.arange(height * width).reshape(height, width) * 300
    values["c"] = np.arange(height * width).reshape(height, width) + 200
    return values


@given(
    order=st.permutations("abc"),
    gaps=st.lists(st.integers(0, 5), min_size=4, max_size=4),
    padding=st.integers(0, 9),
    big=st.booleans(),
    shape=st.tuples(st.integers(0, 3), st.integers(0, 4)),
)
def test_any_layout_of_the_same_values_reads_the_same(order, gaps, padding, big, shape):
    values = sample(*shape)
    offsets, end = {}, 0
    for name, gap in zip(order, gaps, strict=False):
        offsets[name] = end + gap
        end = offsets[name] + values.dtype[name].itemsize
    msg = foreign_cloud(values, order, offsets, end + gaps[3], padding, big)
    read = decode_cloud(deserialize_message(serialize_message(msg), PointCloud2), LAYOUT)
    for name in "abc":
        np.testing.assert_array_equal(read[name], values[name])


def test_encode_writes_packed_little_endian_fields_in_order():
    msg = encode_cloud(sample(), 1_500_000_000, "turntable")
    assert [(f.name, f.offset, f.datatype, f.count) for f in msg.fields] == [
        ("a", 0, PointField.FLOAT32, 1),
        ("b", 4, PointField.UINT16, 1),
        ("c", 6, PointField.UINT8, 1),
    ]
    assert (msg.height, msg.width, msg.point_step, msg.row_step) == (2, 3, 7, 21)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (1, 500_000_000)
    assert not msg.is_bigendian
    assert len(msg.data) == 42


def _set(name, value):
    return lambda msg: setattr(msg, name, value)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda msg: msg.fields.pop(1), "field 'b' is missing"),
        (lambda msg: msg.fields.append(msg.fields[0]), "twice"),
        (lambda msg: setattr(msg.fields[0], "datatype", PointField.FLOAT64), "got 1 of f8"),
        (lambda msg: setattr(msg.fields[0], "datatype", 77), "datatype 77"),
        (lambda msg: setattr(msg.fields[0], "count", 3), "got 3 of f4"),
        (lambda msg: setattr(msg.fields[2], "offset", 7), "beyond point_step"),
        (lambda msg: setattr(msg.fields[2], "offset", 2**32 - 1), "beyond point_step"),
        (_set("row_step", 20), "row_step 20"),
        (_set("row_step", 22), "data has 42 bytes"),
        (_set("height", 3), "data has 42 bytes"),
        (_set("height", 2**32 - 1), "data has 42 bytes"),
        (_set("width", 2**32 - 1), "row_step 21"),
        (_set("point_step", 0), "beyond point_step"),
        (lambda msg: msg.data.pop(), "data has 41 bytes"),
    ],
)
def test_a_wrong_cloud_is_refused_with_the_reason(spoil, says):
    msg = encode_cloud(sample(), 0, "turntable")
    spoil(msg)
    with pytest.raises(ValueError, match=says):
        decode_cloud(msg, LAYOUT)


def test_fields_that_nobody_asked_for_are_passed_over():
    msg = encode_cloud(sample(), 0, "turntable")
    read = decode_cloud(msg, (("c", "u1"),))
    np.testing.assert_array_equal(read["c"], sample()["c"])
