"""Settings of the contour tracker and the error that drops a frame."""

from dataclasses import dataclass, field
from typing import Any


def _setting(default: Any, doc: str, **limits: Any) -> Any:
    return field(default=default, metadata={"doc": doc, **limits})


@dataclass(frozen=True)
class ContourSettings:
    """How contours are found in an image; each field is a ROS parameter."""

    segmentation: str = _setting(
        "auto",
        "how the object is told from the background; auto takes the mask where one comes, "
        "the model of the empty rig where one is given, else decides on the first image; learnt: "
        "as auto, without the empty rig, until contour_tracker has learnt colours and body from "
        "the first turn of a scan, and by these from then on",
        choices=("auto", "threshold", "chroma", "background", "mask", "learnt"),
    )
    background_image: str = _setting(
        "", "image file of the empty rig, for segmentation: background", read_only=True
    )
    background_frames: int = _setting(
        0,
        "take the first frames as the empty rig (they give no contours), for segmentation: "
        "background",
        low=0,
        high=1000,
        read_only=True,
    )
    refine: str = _setting(
        "edge",
        "edge: sub-pixel on the image; none: keep the edge of the segmentation as it is",
        choices=("edge", "none"),
    )
    tracking: str = _setting(
        "none",
        "none: every image is segmented afresh; snake: the last contours relax onto the new image",
        choices=("none", "snake"),
    )
    spacing_px: float = _setting(
        1.0, "distance of the samples along a contour, px", low=0.25, high=20.0
    )
    smoothing_px: float = _setting(
        30.0,
        "shortest wave along a contour that smoothing leaves alone where the outline is "
        "gently curved, px; tight curves are smoothed less",
        low=4.0,
        high=400.0,
    )
    search_px: float = _setting(
        4.0, "half-width of the search for the edge across the contour, px", low=2.0, high=20.0
    )
    min_loop_px: float = _setting(
        40.0, "loops and holes shorter than this are rejected, px", low=8.0, high=1e5
    )
    border_px: float = _setting(
        3.0,
        "samples this close to the border of the image or of the ROI are cut, px",
        low=1.0,
        high=100.0,
    )
    roi_x: int = _setting(0, "left edge of the region of interest, px", low=0, high=100000)
    roi_y: int = _setting(0, "top edge of the region of interest, px", low=0, high=100000)
    roi_width: int = _setting(
        0, "width of the region of interest, px; 0: up to the right edge", low=0, high=100000
    )
    roi_height: int = _setting(
        0, "height of the region of interest, px; 0: up to the bottom edge", low=0, high=100000
    )
    volume_kind: str = _setting(
        "none",
        "the scan volume, outside of which nothing is the object, in the object frame: a box, a "
        "cylinder, or a plane with the object on the side of its axis, which bounds the masks of "
        "all views together but no single image",
        choices=("none", "box", "cylinder", "plane"),
    )
    volume_x: float = _setting(
        0.0, "middle of the volume or point of the plane, m", low=-1e3, high=1e3
    )
    volume_y: float = _setting(
        0.0, "middle of the volume or point of the plane, m", low=-1e3, high=1e3
    )
    volume_z: float = _setting(
        0.0, "middle of the volume or point of the plane, m", low=-1e3, high=1e3
    )
    volume_width: float = _setting(
        0.3, "edge of the box along x, diameter of the cylinder, m", low=1e-6, high=1e3
    )
    volume_depth: float = _setting(0.3, "edge of the box along y, m", low=1e-6, high=1e3)
    volume_height: float = _setting(
        0.3, "edge of the box along z, length of the cylinder, m", low=1e-6, high=1e3
    )
    volume_axis_x: float = _setting(
        0.0, "axis of the cylinder, normal of the plane", low=-1e3, high=1e3
    )
    volume_axis_y: float = _setting(
        0.0, "axis of the cylinder, normal of the plane", low=-1e3, high=1e3
    )
    volume_axis_z: float = _setting(
        1.0, "axis of the cylinder, normal of the plane", low=-1e3, high=1e3
    )


class ContourError(ValueError):
    """A frame that cannot give contours.

    Attributes:
        reason: short snake_case name under which the drop is counted.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason
