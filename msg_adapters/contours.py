"""The `contours` cloud."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.geometry import Camera, Contours

from .cloud import camera_centre, column, columns, decode_cloud, encode_cloud, records
from .header import decode_stamp
from .pose import NEARER

LAYOUT = (
    *((name, "f4") for name in ("x", "y", "z", "vp_x", "vp_y", "vp_z")),
    *((name, "f4") for name in ("normal_x", "normal_y", "normal_z", "u", "v")),
    ("loop", "u2"),
    ("sigma", "f4"),
)
_UNIT_TOLERANCE = 1e-3
_MOST_TOLERANCE = 0.25  # of rounding: clouds of cameras that are refused have more
_ROUNDING = 2.0**-24  # of a coordinate in float32
_MOST_ROUNDED_PX = 1.0  # at half of it a body has grown by some 1 %


def check_precision(camera: Camera) -> None:
    """Refuse a camera so far from the origin of the object frame that a cloud, which has float32
    points at distance 1 on the viewing rays, cannot tell a pixel from the next.

    Raises:
        ValueError: it is; says how far and what to do.
    """
    far = float(np.abs(camera.centre).max())
    rounded_px = float(max(camera.K[0, 0], camera.K[1, 1])) * far * _ROUNDING
    if not rounded_px <= _MOST_ROUNDED_PX:
        raise ValueError(
            f"the camera is {far:.3g} m from the origin of the object frame, where float32 moves "
            f"the outline by {rounded_px:.3g} pixels: {NEARER}"
        )


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
        ValueError: a field or size is wrong; rays or normals are not of unit length, as far as
            float32 tells; more than one camera centre; a loop that is not in one piece; a bad
            sigma.
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
    # Three coordinates of both ends are rounded.
    rounded = 4 * _ROUNDING * float(np.abs(centre).max())
    tolerance = min(max(_UNIT_TOLERANCE, rounded), _MOST_TOLERANCE)
    xyz = columns(rows, ("x", "y", "z"))
    T = _unit(xyz - centre, tolerance, "x y z must be at distance 1 from vp")
    normals = columns(rows, ("normal_x", "normal_y", "normal_z"))
    N = _unit(normals, _UNIT_TOLERANCE, "normals must have length 1")
    if (np.abs(np.einsum("ij,ij->i", T, N)) > max(10 * _UNIT_TOLERANCE, tolerance)).any():
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


def _unit(vectors: np.ndarray, tolerance: float, demand: str) -> np.ndarray:
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
        if not (np.abs(length - 1) < tolerance).all():
            raise ValueError(demand)
    return vectors / length[:, None]
