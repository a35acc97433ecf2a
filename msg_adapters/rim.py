"""The `rim` cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.geometry import Rim, Status
from occ_recon_ros.geometry.shape import Shape

from .cloud import column, columns, decode_cloud, encode_cloud, records
from .header import SECOND_NS, decode_stamp

LAYOUT = (
    *((name, "f4") for name in ("x", "y", "z", "normal_x", "normal_y", "normal_z")),
    ("curvature", "f4"),
    ("depth_sigma", "f4"),
    ("loop", "u2"),
    ("prev", "f4"),
    ("status", "u1"),
)
_PREV_STAMP = (("prev_sec", "u4"), ("prev_nanosec", "u4"))
"""Ours, after the fields of the contract and not demanded: the stamp of the frame that `prev`
counts rows of. It lets a mesher know when that rim was lost, or is still to come."""


SHAPE = tuple((name, "f4") for name in ("k_s", "theta", "gauss", "mean"))
"""Ours too, and last; there when asked for: the surface to second order."""


def encode_rim(rim: Rim, shape: Shape | None = None) -> PointCloud2:
    """A rim as a cloud, one row a contour sample, with its shape if that is given."""
    more = () if shape is None else SHAPE
    out = records((*LAYOUT, *_PREV_STAMP, *more), (1, len(rim)))
    for name, _ in more:
        out[name] = getattr(shape, name)
    for k, axis in enumerate("xyz"):
        out[axis] = rim.points[:, k]
        out[f"normal_{axis}"] = rim.normals[:, k]
    for name in ("curvature", "depth_sigma", "loop", "prev", "status"):
        out[name] = getattr(rim, name)
    out["prev_sec"], out["prev_nanosec"] = divmod(rim.prev_stamp_ns, SECOND_NS)
    return encode_cloud(out, rim.stamp_ns, rim.frame_id, bool(np.isfinite(rim.points).all()))


def decode_rim(msg: PointCloud2) -> Rim:
    """Rim of a cloud.

    Raises:
        ValueError: a field or size is wrong; an unknown status; a good point that is not
            finite or has no unit normal; a negative `prev`.
    """
    rows = decode_cloud(msg, LAYOUT, optional=_PREV_STAMP).ravel()
    points = columns(rows, ("x", "y", "z"))
    normals = columns(rows, ("normal_x", "normal_y", "normal_z"))
    status = rows["status"].astype(np.uint8)
    if (status > max(Status)).any():
        raise ValueError(f"status must be 0 to {int(max(Status))}, got {status.max()}")
    good = status == Status.GOOD
    if not np.isfinite(points[good]).all():
        raise ValueError("a point of status 0 must be finite")
    with np.errstate(invalid="ignore", over="ignore"):
        square = np.einsum("ij,ij->i", normals, normals)[good]
    if not (np.abs(np.sqrt(square) - 1) < 1e-3).all():
        raise ValueError("a point of status 0 must have a normal of length 1")
    prev = column(rows, "prev")
    if (prev < 0).any() or np.isinf(prev).any():
        raise ValueError("prev must be a row of the previous rim, or NaN")
    return Rim(
        stamp_ns=decode_stamp(msg.header.stamp),
        frame_id=msg.header.frame_id,
        points=points,
        normals=normals,
        curvature=column(rows, "curvature"),
        depth_sigma=column(rows, "depth_sigma"),
        loop=rows["loop"].astype(np.uint16),
        prev=prev,
        status=status,
        prev_stamp_ns=_prev_stamp(rows),
    )


def decode_shape(msg: PointCloud2) -> Shape | None:
    """Shape of a rim cloud, None where it has no such fields.

    Raises:
        ValueError: a field or size is wrong.
    """
    if not {name for name, _ in SHAPE} <= {field.name for field in msg.fields}:
        return None
    rows = decode_cloud(msg, (*LAYOUT, *SHAPE)).ravel()
    good = rows["status"] == Status.GOOD
    k_t = np.where(good, column(rows, "curvature"), np.nan)
    return Shape(k_t, *(column(rows, name) for name, _ in SHAPE))


def _prev_stamp(rows: NDArray) -> int:
    """The one stamp of all rows, 0 where a program without these fields sent the rim."""
    names = [name for name, _ in _PREV_STAMP]
    if not len(rows) or not set(names) <= set(rows.dtype.names or ()):
        return 0
    if any((rows[name] != rows[name][0]).any() for name in names):
        raise ValueError("prev_sec and prev_nanosec must be the same in all rows")
    return int(rows["prev_sec"][0]) * SECOND_NS + int(rows["prev_nanosec"][0])
