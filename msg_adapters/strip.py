"""The `strip` and `mesh` clouds: triangles by their corners."""

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.surface import Strip

from .cloud import columns, decode_cloud, encode_cloud, records
from .header import decode_stamp

_POINT = tuple((n, "f4") for n in ("x", "y", "z", "normal_x", "normal_y", "normal_z"))
_RGB = (("rgb", "f4"),)
_SIGMA = (("depth_sigma", "f4"),)
LAYOUT = (*_POINT, *_SIGMA)
LAYOUT_RGB = (*_POINT, *_RGB, *_SIGMA)


def encode_strip(strip: Strip) -> PointCloud2:
    """Triangles as an organised cloud: a row a triangle, its three corners across."""
    coloured = strip.rgb is not None
    layout = LAYOUT_RGB if coloured else LAYOUT
    out = records(layout, (len(strip), 3))
    # All fields are float32, so that whole blocks can be filled at once.
    flat = out.view("<f4").reshape(len(strip), 3, len(layout))
    flat[..., :3] = strip.corners
    flat[..., 3:6] = strip.normals
    flat[..., -1] = strip.depth_sigma
    if strip.rgb is not None:
        flat[..., 6] = _pack(strip.rgb)
    return encode_cloud(out, strip.stamp_ns, strip.frame_id)


def decode_strip(msg: PointCloud2) -> Strip:
    """Triangles of a cloud.

    Raises:
        ValueError: a field or size is wrong, the width is not 3, a corner is not finite.
    """
    rows = decode_cloud(msg, LAYOUT, optional=_RGB)
    if rows.shape[1] != 3:
        raise ValueError(f"width must be 3, the corners of a triangle, got {rows.shape[1]}")
    corners = columns(rows, ("x", "y", "z"), np.float32).reshape(-1, 3, 3)
    if not np.isfinite(corners).all():
        raise ValueError("a corner is not finite")
    return Strip(
        stamp_ns=decode_stamp(msg.header.stamp),
        frame_id=msg.header.frame_id,
        corners=corners,
        normals=columns(rows, ("normal_x", "normal_y", "normal_z"), np.float32).reshape(-1, 3, 3),
        depth_sigma=rows["depth_sigma"].astype(np.float32),
        rgb=_unpack(rows["rgb"]) if "rgb" in (rows.dtype.names or ()) else None,
    )


def _pack(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(..., 3) uint8 to float32 whose bits are 0x00RRGGBB, as PCL does."""
    bits = rgb.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    return bits.astype(np.uint32).view(np.float32)


def _unpack(packed: NDArray[np.float32]) -> NDArray[np.uint8]:
    bits = np.ascontiguousarray(packed, "<f4").view("<u4")
    return (bits[..., None] >> np.array([16, 8, 0], np.uint32) & 0xFF).astype(np.uint8)
