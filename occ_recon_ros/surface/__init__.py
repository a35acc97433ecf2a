"""Rims to triangles to files.

The closed surface (``closing``) is not named here: it needs scikit-image, the nodes do not.
"""

from .accumulate import Surface, SurfaceSettings
from .colour import ViewColours, reduced_camera
from .files import SUFFIXES, exported, write_rims, write_surface, write_whole
from .strip import Strip
from .zipping import zip_rims

__all__ = [
    "SUFFIXES",
    "Strip",
    "Surface",
    "SurfaceSettings",
    "ViewColours",
    "exported",
    "reduced_camera",
    "write_rims",
    "write_surface",
    "write_whole",
    "zip_rims",
]
