"""Pixels to contours: segment, refine to sub-pixel, smooth, track."""

from .draw import draw_contours
from .settings import ContourError, ContourSettings
from .tracker import ContourTracker

__all__ = ["ContourError", "ContourSettings", "ContourTracker", "draw_contours"]
