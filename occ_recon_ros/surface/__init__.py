"""Rims to triangles to files."""

from .accumulate import Surface, SurfaceSettings
from .closing import ClosingSettings, close_surface
from .files import SUFFIXES, write_rims, write_surface, write_whole
from .hull import Hull
from .strip import Strip
from .zipping import zip_rims

__all__ = [
    "SUFFIXES",
    "ClosingSettings",
    "Hull",
    "Strip",
    "Surface",
    "SurfaceSettings",
    "close_surface",
    "write_rims",
    "write_surface",
    "write_whole",
    "zip_rims",
]
