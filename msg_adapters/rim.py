"""The `rim` cloud."""

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.geometry import Rim, Status
from occ_recon_ros.geometry.shape import Shape

from .cloud import camera_centre, column, columns, decode_cloud, encode_cloud, records
from .header import SECOND_NS, decode_stamp

_PREV_STAMP = ("prev_sec", "prev_nanosec")
LAYOUT = (
    *((name, "f4") for name in ("x", "y", "z", "normal_x", "normal_y", "normal_z")),
    ("curvature", "f4"),
    ("depth_sigma", "f4"),
    ("loop", "u2"),
    ("prev", "f4"),
    *((name, "f4") for name in ("vp_x", "vp_y", "vp_z")),
    *((name, "u4") for name in _PREV_STAMP),
    ("status", "u1"),
)
SHAPE = tuple((name, "f4") for name in ("k_s", "theta", "gauss", "mean"))
"""Ours, after the fields of the contract; there when asked for: the surface to second order."""
_NONE = 0xFFFFFFFF  # both parts of the stamp of the previous frame: there is none


def encode_rim(rim: Rim, shape: Shape | None = None) -> PointCloud2:
    """A rim as a cloud, one row a contour sample, with its shape if that is given."""
    more = () if shape is None else SHAPE
    out = records((*LAYOUT, *more), (1, len(rim)))
    for name, _ in more:
        out[name] = getattr(shape, name)
    for k, axis in enumerate("xyz"):
        out[axis] = rim.points[:, k]
        out[f"normal_{axis}"] = rim.normals[:, k]
        out[f"vp_{axis}"] = rim.centre[k]
    for name in ("curvature", "depth_sigma", "loop", "prev", "status"):
        out[name] = getattr(rim, name)
    stamp = rim.prev_stamp_ns
    out["prev_sec"], out["prev_nanosec"] = (
        (_NONE, _NONE) if stamp is None else divmod(stamp, SECOND_NS)
    )
    return encode_cloud(out, rim.stamp_ns, rim.frame_id, bool(np.isfinite(rim.points).all()))


def decode_rim(msg: PointCloud2) -> Rim:
    """Rim of a cloud.

    Raises:
        ValueError: a field or size is wrong; an unknown status; a good point that is not
            finite or has no unit normal; more than one camera centre; a negative `prev`, or one
            in no frame.
    """
    rows = decode_cloud(msg, LAYOUT).ravel()
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
    prev_stamp_ns = _prev_stamp(rows)
    if prev_stamp_ns is None and np.isfinite(prev).any():
        raise ValueError("prev without prev_sec and prev_nanosec is a row of no rim")
    return Rim(
        stamp_ns=decode_stamp(msg.header.stamp),
        frame_id=msg.header.frame_id,
        centre=camera_centre(rows),
        points=points,
        normals=normals,
        curvature=column(rows, "curvature"),
        depth_sigma=column(rows, "depth_sigma"),
        loop=rows["loop"].astype(np.uint16),
        prev=prev,
        status=status,
        prev_stamp_ns=prev_stamp_ns,
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


def _prev_stamp(rows: NDArray) -> int | None:
    """The one stamp of all rows, nanoseconds; None where there is no frame before."""
    if any((rows[name] != rows[name][:1]).any() for name in _PREV_STAMP):
        raise ValueError("prev_sec and prev_nanosec must be the same in all rows")
    if not len(rows) or all(rows[name][0] == _NONE for name in _PREV_STAMP):
        return None
    return int(rows["prev_sec"][0]) * SECOND_NS + int(rows["prev_nanosec"][0])
