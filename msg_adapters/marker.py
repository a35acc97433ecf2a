"""The surface as an RViz marker."""

import numpy as np
from geometry_msgs.msg import Point, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from occ_recon_ros.surface import Strip

from .header import encode_header

_CLAY = (0.80, 0.62, 0.46, 1.0)


def encode_marker(surface: Strip, max_triangles: int) -> Marker:
    """A TRIANGLE_LIST of at most ``max_triangles`` triangles, evenly picked; DELETE of an
    empty surface, because RViz calls a list without triangles an error."""
    marker = Marker(
        header=encode_header(surface.stamp_ns, surface.frame_id),
        ns="mesh",
        id=0,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD if len(surface) else Marker.DELETE,
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=_colour(*_CLAY),
    )
    marker.pose.orientation = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    count = min(len(surface), int(max_triangles))
    rows = np.linspace(0, len(surface), count, endpoint=False).astype(np.intp)
    # Message points are objects: the one place where a loop over points cannot be helped.
    corners = surface.corners[rows].reshape(-1, 3).astype(np.float64).tolist()
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners]
    if surface.rgb is not None:
        colours = (surface.rgb[rows].reshape(-1, 3) / 255.0).tolist()
        marker.colors = [_colour(r, g, b, 1.0) for r, g, b in colours]
    return marker


def _colour(r: float, g: float, b: float, a: float) -> ColorRGBA:
    return ColorRGBA(r=float(r), g=float(g), b=float(b), a=float(a))
