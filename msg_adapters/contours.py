"""The `contours` cloud."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.geometry import Contours

from .cloud import camera_centre, column, columns, decode_cloud, encode_cloud, records
from .header import decode_stamp

LAYOUT = (
    *((name, "f4") for name in ("x", "y", "z", "vp_x", "vp_y", "vp_z")),
    *((name, "f4") for name in ("normal_x", "normal_y", "normal_z", "u", "v")),
    ("loop", "u2"),
    ("sigma", "f4"),
)
_UNIT_TOLERANCE = 1e-3
"""float32 points lose this much of a unit vector only 10 km away from the origin."""


def encode_contours(contours: Contours) -> PointCloud2:
    """Contours as a cloud: points at distance 1 on the viewing rays."""
    out = records(LAYOUT, (1, len(contours)))
    xyz = contours.centre + contours.T
    for k, axis in enumerate("xyz"):
        out[axis] = xyz[:, k]
        out[f"vp_{axis}"] = contours.centre[k]
        out[f"normal_{axis}"] = contours.N[:, k]
    out["u"], out["v"] = contours.uv.T
    out["loop"] = contours.loop
    out["sigma"] = contours.sigma
    return encode_cloud(out, contours.stamp_ns, contours.frame_id, bool(np.isfinite(xyz).all()))


def is_contours(msg: PointCloud2) -> bool:
    """Whether a cloud is of contours: those alone have pixels."""
    return any(field.name == "u" for field in msg.fields)


def decode_contours(msg: PointCloud2) -> Contours:
    """Contours of a cloud.

    Raises:
        ValueError: a field or size is wrong; rays or normals are not of unit length; more
            than one camera centre; a loop that is not in one piece; a bad sigma.
    """
    rows = decode_cloud(msg, LAYOUT).ravel()
    centre = camera_centre(rows)
    loop = rows["loop"].astype(np.uint16)
    starts = np.flatnonzero(np.diff(loop, prepend=loop[:1] + 1))
    if len(np.unique(loop[starts])) != len(starts):
        raise ValueError("the rows of a loop must be in one piece")
    sigma = column(rows, "sigma")
    if not (sigma >= 0).all():
        raise ValueError("sigma must not be negative or NaN")
    uv = columns(rows, ("u", "v"))
    if not np.isfinite(uv).all():
        raise ValueError("u v must be finite")
    T = _unit(columns(rows, ("x", "y", "z")) - centre, "x y z must be at distance 1 from vp")
    N = _unit(columns(rows, ("normal_x", "normal_y", "normal_z")), "normals must have length 1")
    if (np.abs(np.einsum("ij,ij->i", T, N)) > 10 * _UNIT_TOLERANCE).any():
        raise ValueError("normals must be perpendicular to the viewing rays")
    return Contours(
        stamp_ns=decode_stamp(msg.header.stamp),
        frame_id=msg.header.frame_id,
        centre=centre,
        T=T,
        N=N,
        uv=uv,
        loop=loop,
        sigma=sigma,
    )


def _unit(vectors: np.ndarray, demand: str) -> np.ndarray:
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
        if not (np.abs(length - 1) < _UNIT_TOLERANCE).all():
            raise ValueError(demand)
    return vectors / length[:, None]
