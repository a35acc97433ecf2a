"""The `rim` cloud."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.geometry import Rim, Status

from .cloud import columns, decode_cloud, encode_cloud, records
from .header import decode_stamp

LAYOUT = (
    *((name, "f4") for name in ("x", "y", "z", "normal_x", "normal_y", "normal_z")),
    ("curvature", "f4"),
    ("depth_sigma", "f4"),
    ("loop", "u2"),
    ("prev", "f4"),
    ("status", "u1"),
)


def encode_rim(rim: Rim) -> PointCloud2:
    """A rim as a cloud, one row a contour sample."""
    out = records(LAYOUT, (1, len(rim)))
    for k, axis in enumerate("xyz"):
        out[axis] = rim.points[:, k]
        out[f"normal_{axis}"] = rim.normals[:, k]
    for name in ("curvature", "depth_sigma", "loop", "prev", "status"):
        out[name] = getattr(rim, name)
    return encode_cloud(out, rim.stamp_ns, rim.frame_id, bool(np.isfinite(rim.points).all()))


def decode_rim(msg: PointCloud2) -> Rim:
    """Rim of a cloud.

    Raises:
        ValueError: a field or size is wrong; an unknown status; a good point that is not
            finite or has no unit normal; a negative `prev`.
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
        length = np.linalg.norm(normals[good], axis=1)
    if not (np.abs(length - 1) < 1e-3).all():
        raise ValueError("a point of status 0 must have a normal of length 1")
    prev = rows["prev"].astype(np.float64)
    if (prev < 0).any() or np.isinf(prev).any():
        raise ValueError("prev must be a row of the previous rim, or NaN")
    return Rim(
        stamp_ns=decode_stamp(msg.header.stamp),
        frame_id=msg.header.frame_id,
        points=points,
        normals=normals,
        curvature=rows["curvature"].astype(np.float64),
        depth_sigma=rows["depth_sigma"].astype(np.float64),
        loop=rows["loop"].astype(np.uint16),
        prev=prev,
        status=status,
    )
