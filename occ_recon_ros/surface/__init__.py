"""Rims to triangles to files."""

from .accumulate import Surface, SurfaceSettings
from .files import SUFFIXES, write_rims, write_surface
from .strip import Strip
from .zipping import zip_rims

__all__ = [
    "SUFFIXES",
    "Strip",
    "Surface",
    "SurfaceSettings",
    "write_rims",
    "write_surface",
    "zip_rims",
]
