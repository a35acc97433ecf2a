"""Settings of the contour tracker and the error that drops a frame."""

from dataclasses import dataclass
from typing import Any

from ..geometry.refusal import Refusal
from ..geometry.settings import setting


def _middle() -> Any:
    return setting(0.0, "middle of the volume or point of the plane, m", within=(-1e3, 1e3))


def _axis(default: float) -> Any:
    return setting(default, "axis of the cylinder, normal of the plane", within=(-1e3, 1e3))


@dataclass(frozen=True)
class ContourSettings:
    """How contours are found in an image; each field is a ROS parameter."""

    segmentation: str = setting(
        "auto",
        "how the object is told from the background; auto takes the mask where one comes, "
        "the model of the empty rig where one is given, else decides on the first image, and where "
        "single images contradict each other looks at all of them together at the end of the turn; "
        "learnt: as auto, without the empty rig, until contour_tracker has learnt colours and body "
        "from the first turn of a scan, and by these from then on",
        choices=("auto", "threshold", "chroma", "background", "mask", "learnt"),
    )
    background_image: str = setting(
        "", "image file of the empty rig, for segmentation: background", read_only=True
    )
    background_frames: int = setting(
        0,
        "take the first frames as the empty rig (they give no contours), for segmentation: "
        "background",
        within=(0, 1000),
        read_only=True,
    )
    refine: str = setting(
        "edge",
        "edge: sub-pixel on the image; none: keep the edge of the segmentation as it is",
        choices=("edge", "none"),
    )
    tracking: str = setting(
        "none",
        "none: every image is segmented afresh; snake: the last contours relax onto the new image",
        choices=("none", "snake"),
    )
    spacing_px: float = setting(
        1.0, "distance of the samples along a contour, px", within=(0.25, 20.0)
    )
    smoothing_px: float = setting(
        30.0,
        "shortest wave along a contour that smoothing leaves alone where the outline is "
        "gently curved, px; tight curves are smoothed less",
        within=(4.0, 400.0),
    )
    search_px: float = setting(
        4.0, "half-width of the search for the edge across the contour, px", within=(2.0, 20.0)
    )
    min_loop_px: float = setting(
        40.0, "loops and holes shorter than this are rejected, px", within=(8.0, 1e5)
    )
    border_px: float = setting(
        3.0,
        "samples this close to the border of the image or of the ROI are cut, px",
        within=(1.0, 100.0),
    )
    roi_x: int = setting(0, "left edge of the region of interest, px", within=(0, 100000))
    roi_y: int = setting(0, "top edge of the region of interest, px", within=(0, 100000))
    roi_width: int = setting(
        0, "width of the region of interest, px; 0: up to the right edge", within=(0, 100000)
    )
    roi_height: int = setting(
        0, "height of the region of interest, px; 0: up to the bottom edge", within=(0, 100000)
    )
    volume_kind: str = setting(
        "none",
        "the scan volume, outside of which nothing is the object, in the object frame: a box, a "
        "cylinder, or a plane with the object on the side of its axis, which bounds the masks of "
        "all views together but no single image",
        choices=("none", "box", "cylinder", "plane"),
    )
    volume_x: float = _middle()
    volume_y: float = _middle()
    volume_z: float = _middle()
    volume_width: float = setting(
        0.3, "edge of the box along x, diameter of the cylinder, m", within=(1e-6, 1e3)
    )
    volume_depth: float = setting(0.3, "edge of the box along y, m", within=(1e-6, 1e3))
    volume_height: float = setting(
        0.3, "edge of the box along z, length of the cylinder, m", within=(1e-6, 1e3)
    )
    volume_axis_x: float = _axis(0.0)
    volume_axis_y: float = _axis(0.0)
    volume_axis_z: float = _axis(1.0)


class ContourError(Refusal):
    """A frame that cannot give contours."""
