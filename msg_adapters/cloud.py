"""PointCloud2 as NumPy records: one layout table, both directions."""

import array
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import DTypeLike, NDArray
from sensor_msgs.msg import PointCloud2, PointField

from .header import encode_header

Layout = Sequence[tuple[str, str]]
"""(field name, NumPy type code) in order, packed without gaps."""

_DATATYPES = {
    "i1": PointField.INT8,
    "u1": PointField.UINT8,
    "i2": PointField.INT16,
    "u2": PointField.UINT16,
    "i4": PointField.INT32,
    "u4": PointField.UINT32,
    "f4": PointField.FLOAT32,
    "f8": PointField.FLOAT64,
}
_CODES = {datatype: code for code, datatype in _DATATYPES.items()}


def to_byte_array(values: NDArray) -> array.array:
    """The bytes of an array as message setters take them without a loop."""
    buffer = array.array("B")
    if values.size:
        buffer.frombytes(np.ascontiguousarray(values).data.cast("B"))
    return buffer


def records(layout: Layout, shape: tuple[int, int]) -> NDArray:
    """Empty little-endian records to fill and hand to ``encode_cloud``."""
    return np.zeros(shape, np.dtype([(name, f"<{code}") for name, code in layout]))


def encode_cloud(
    values: NDArray, stamp_ns: int, frame_id: str, is_dense: bool = True
) -> PointCloud2:
    """A cloud from (height, width) records of ``records``."""
    fields, offset = [], 0
    for name in values.dtype.names or ():
        code = values.dtype[name].str[1:]
        fields.append(PointField(name=name, offset=offset, datatype=_DATATYPES[code], count=1))
        offset += values.dtype[name].itemsize
    height, width = values.shape
    step = int(values.dtype.itemsize)
    return PointCloud2(
        header=encode_header(stamp_ns, frame_id),
        height=int(height),
        width=int(width),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * int(width),
        data=to_byte_array(values),
        is_dense=bool(is_dense),
    )


def decode_cloud(msg: PointCloud2, layout: Layout, optional: Layout = ()) -> NDArray:
    """The named fields of a cloud as (height, width) records, without a copy.

    Offsets, order, padding and byte order are the message's own; fields that are not
    asked for are passed over.

    Raises:
        ValueError: a field missing, twice there, or of another type; a size that does
            not add up.
    """
    fields = tuple((f.name, f.offset, f.datatype, f.count) for f in msg.fields)
    step = int(msg.point_step)
    dtype = _record_type(fields, step, bool(msg.is_bigendian), tuple(layout), tuple(optional))
    height, width, row_step = int(msg.height), int(msg.width), int(msg.row_step)
    if row_step < width * step:
        raise ValueError(f"row_step {row_step} is less than {width} points of {step} bytes")
    if len(msg.data) != row_step * height:
        raise ValueError(f"data has {len(msg.data)} bytes, {height} rows need {row_step * height}")
    if not height * width:
        return np.zeros((height, width), dtype)
    data = np.frombuffer(msg.data, np.uint8)
    return np.ndarray((height, width), dtype, buffer=data.data, strides=(row_step, step))


@lru_cache(maxsize=16)
def _record_type(
    fields: tuple[tuple[str, int, int, int], ...],
    step: int,
    bigendian: bool,
    layout: Layout,
    optional: Layout,
) -> np.dtype:
    """Records of the wanted among some fields (name, offset, datatype, count)."""
    there = {name: (offset, datatype, count) for name, offset, datatype, count in fields}
    if len(there) != len(fields):
        raise ValueError("a field name appears twice")
    wanted = [*layout, *((name, code) for name, code in optional if name in there)]
    for name, code in wanted:
        if name not in there:
            raise ValueError(f"field '{name}' is missing")
        offset, datatype, count = there[name]
        if datatype != _DATATYPES[code] or count != 1:
            got = _CODES.get(datatype, f"datatype {datatype}")
            raise ValueError(f"field '{name}' must be one {code}, got {count} of {got}")
        if offset + np.dtype(code).itemsize > step:
            raise ValueError(f"field '{name}' reaches beyond point_step {step}")
    order = ">" if bigendian else "<"
    return np.dtype(
        {
            "names": [name for name, _ in wanted],
            "formats": [order + code for _, code in wanted],
            "offsets": [there[name][0] for name, _ in wanted],
            "itemsize": step,
        }
    )


def columns(values: NDArray, names: Sequence[str], dtype: DTypeLike = np.float64) -> NDArray:
    """(n, k) array of k fields of records of any shape with n elements."""
    out: NDArray = np.empty((values.size, len(names)), dtype)
    with np.errstate(invalid="ignore"):  # signalling NaNs are NaNs
        for k, name in enumerate(names):
            out[:, k] = values[name].ravel()
    return out


def column(values: NDArray, name: str) -> NDArray[np.float64]:
    """(n,) float64 of one field of records of any shape with n elements."""
    return columns(values, (name,))[:, 0]


def camera_centre(values: NDArray) -> NDArray[np.float64]:
    """(3,) float64 the camera centre that records have in common; zeros if there are none.

    Raises:
        ValueError: there is more than one, or it is not finite.
    """
    vp = columns(values, ("vp_x", "vp_y", "vp_z"))
    if not len(vp):
        return np.zeros(3)
    if not (np.isfinite(vp[0]).all() and (vp == vp[0]).all()):
        raise ValueError("vp_x vp_y vp_z must be one finite camera centre for all rows")
    return vp[0].copy()
