"""What single images of a turn, or the masks that came with them, say one by one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera, Contours
from ..imaging import ContourError, ContourSettings, ContourTracker
from ..imaging.joint.edges import (
    MANY_STEPS,
    SOME_WITHOUT_EDGE,
    StepsBeside,
    faint,
    in_small,
    small_contrast,
)
from ..imaging.joint.room import SOME_ALONG_ROOM, RoomEdges
from ..scene import coverage

Mask = NDArray[np.uint8]

ROUGH = ContourSettings(refine="none", spacing_px=2.0)
DOUBT = 0.01  # share of a silhouette that others contradict; poses off by a pixel do less
MISPLACED = 0.1  # share of a silhouette; what poses are off by less, a refinement can mend
MANY = 0.1  # of the views, that contradict each other: poses do so in many
MOST_DOUBTFUL = 0.4  # of the views: with more, none is taken for right


class Outlines:
    """The outlines of those views that have one.

    Args:
        settings: by which each view is segmented.

    Attributes:
        contours, cameras: a row a view with an outline.
        masks: (h, w) uint8 coverage of each by its stamp, 255 = object.
    """

    def __init__(self, settings: ContourSettings = ROUGH) -> None:
        self._tracker = ContourTracker(settings)
        self._contrasts: list[NDArray[np.float32]] = []
        self._steps = StepsBeside()
        self._room = RoomEdges()
        self.contours: list[Contours] = []
        self.cameras: list[Camera] = []
        self.masks: dict[int, Mask] = {}

    def __len__(self) -> int:
        return len(self.contours)

    def add(self, image: NDArray, camera: Camera, stamp_ns: int, mask: Mask | None = None) -> bool:
        """Look at an image, or at the mask that came with it; whether it has an outline."""
        try:
            found = self._tracker.process(image, camera, stamp_ns, "object", mask)
        except ContourError:
            return False
        by_image = mask is None
        if mask is None:
            mask = filled(found.by_loop(found.uv), image.shape)
        self.take(found, camera, mask, image if by_image else None)
        return True

    def take(
        self, found: Contours, camera: Camera, mask: Mask, image: NDArray | None = None
    ) -> None:
        """Take an outline as it was found, and its mask; the image is asked too, where one is
        given."""
        if image is not None:
            small, inside, picture = in_small(image, mask)
            self._contrasts.append(small_contrast(small, inside, picture))
            self._steps.add(small, inside, picture)
            self._room.add(small, inside, picture)
        self.contours.append(found)
        self.cameras.append(camera)
        self.masks[found.stamp_ns] = mask

    def doubt(self) -> str:
        """What speaks against outlines of images by their images alone, "" where nothing does."""
        if not self._contrasts:
            return ""
        if np.median(self._steps.shares()) > MANY_STEPS:
            return "images show edges beside the outlines that their backdrops show nowhere else"
        share = float(np.median(self._room.shares()))
        if share > SOME_ALONG_ROOM:
            return f"{share:.0%} of the outlines lie along an edge of the room that goes on beyond"
        share = float(np.median(faint(self._contrasts)))
        if share <= SOME_WITHOUT_EDGE:
            return ""
        return f"{share:.0%} of the outlines lie where images show no edge, as along shadows"


def filled(loops: Sequence[NDArray[np.float64]], shape: tuple[int, ...]) -> Mask:
    """(h, w) uint8, the share of each pixel that lies inside of loops, 255: all of it."""
    return np.rint(255 * coverage(loops, shape[1], shape[0])).astype(np.uint8)
