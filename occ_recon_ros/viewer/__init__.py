"""What the page of a running scan shows, and of which messages. No ROS."""

from .live_surface import LiveSurface
from .patch import SHADINGS, Patch, merged, patch_colours
from .scan_view import Frame, ScanState, ScanView

__all__ = [
    "SHADINGS",
    "Frame",
    "LiveSurface",
    "Patch",
    "ScanState",
    "ScanView",
    "merged",
    "patch_colours",
]
