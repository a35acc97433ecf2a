"""Pixels to contours: segment, refine to sub-pixel, smooth, track."""

from .background import check_background
from .draw import draw_contours
from .segmenter import mask_coverage
from .settings import ContourError, ContourSettings
from .tracker import ContourTracker

__all__ = [
    "ContourError",
    "ContourSettings",
    "ContourTracker",
    "check_background",
    "draw_contours",
    "mask_coverage",
]
