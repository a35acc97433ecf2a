"""Rims whose surface is known: on a cylinder by hand, on a sphere by reconstruction."""

import sys
from functools import cache
from pathlib import Path

import numpy as np

from occ_recon_ros.geometry import Rim, RimReconstructor

sys.path.append(str(Path(__file__).parent.parent / "geometry"))

from spheres import Sphere, ring

SPHERE_RADIUS = 0.1


def cylinder_rim(angle, stamp, n=101, previous_n=None):
    """An upright line on the unit cylinder of height 1 at an angle, at full correspondence."""
    out = np.array([np.cos(angle), np.sin(angle), 0.0])
    height = np.linspace(0, 1, n)
    row = height * ((previous_n or n) - 1)
    return Rim(
        stamp_ns=stamp,
        frame_id="object",
        centre=5 * out,
        points=out + height[:, None] * [0, 0, 1.0],
        normals=np.tile(out, (n, 1)),
        curvature=np.ones(n),
        depth_sigma=np.full(n, 1e-4),
        loop=np.zeros(n, np.uint16),
        prev=row,
        status=np.zeros(n, np.uint8),
        prev_stamp_ns=stamp - 1,
    )


@cache
def _turn():
    sphere = Sphere(np.zeros(3), SPHERE_RADIUS)
    reconstructor = RimReconstructor()
    centres = ring(np.radians(10) * np.arange(36))
    contours = [sphere.contours(C, 500, stamp_ns=k + 1) for k, C in enumerate(centres)]
    rims = [rim for c in contours for rim in reconstructor.add(c)]
    rims += reconstructor.finish()
    return list({rim.stamp_ns: rim for rim in rims}.values())


def sphere_turn():
    """The 36 rims of a full turn, in the order they are published."""
    return list(_turn())
