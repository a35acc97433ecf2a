"""What went into the nodes in a run and what came out, as results are made of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import decode_picture, frame_camera
from occ_recon_ros.geometry import Camera, Contours, Rim
from occ_recon_ros.streams.pairing import Frame


@dataclass
class Sent:
    """What was fed in.

    Attributes:
        images: number of images.
        unanswered: stamps of images of which nothing came within the time allowed.
    """

    images: int = 0
    unanswered: list[int] = field(default_factory=list)


@dataclass
class KeptView:
    """One image that is kept to be shown.

    Attributes:
        image: Image or CompressedImage.
        frame: the whole frame, None as long as its camera_info or pose has not come.
    """

    image: Any
    frame: Frame | None = None

    def pixels(self) -> NDArray[Any]:
        """(h, w) or (h, w, 3) BGR."""
        return decode_picture(self.image)

    def camera(self) -> Camera | None:
        """The calibrated view; None where there is no whole frame."""
        return frame_camera(self.frame) if self.frame is not None else None


@dataclass
class Heard:
    """All rims, a summary of all contours, and a few whole frames for pictures.

    Attributes:
        samples: number of contour samples by stamp (ns).
        loops: number of loops by stamp.
        centres: (3,) camera centre by stamp, metres, object frame.
        contours: by stamp, as far as they are kept.
        sizes: (width, height) of the image by stamp, px.
        rims: by stamp; a later one of the same stamp replaces the earlier.
        views: kept frames by stamp.
        images: images heard.
        strips: strip messages heard.
        triangles: triangles in them.
    """

    samples: dict[int, int] = field(default_factory=dict)
    loops: dict[int, int] = field(default_factory=dict)
    centres: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    contours: dict[int, Contours] = field(default_factory=dict)
    sizes: dict[int, tuple[int, int]] = field(default_factory=dict)
    rims: dict[int, Rim] = field(default_factory=dict)
    views: dict[int, KeptView] = field(default_factory=dict)
    images: int = 0
    strips: int = 0
    triangles: int = 0
