"""One silhouette as a cone in space, with what its image cannot show left open."""

from collections.abc import Sequence
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours
from ..geometry.arrays import Array, Index, axes_along, nearest_to_rays
from ..geometry.compiled import compiled
from .gaps import Gaps

Mask = NDArray[np.bool_]

_BAND_PX = 2.5  # to either side of the outline, where the distance is exact
_MARGIN_PX = 4
_MOST_PIXELS = 1500  # on a side of a silhouette's image
_STRIDE = 5

Item = TypeVar("Item")


class Cone:
    """One silhouette as an image of signed distances to its outline.

    The image lies on the plane at distance 1 across the middle viewing direction, its
    pixels as large as those of the camera. Holes of the silhouette count as outside. Where
    the outline has a gap nothing is known of what lies beyond: it counts as inside. A gap
    whose ends lie on the border of the camera's image (where the outline has its utmost
    columns and rows) leaves all beyond that border open.

    Args:
        contours: closed loops of together at least 3 samples.
        room: about the silhouette in the image, of its size.

    Attributes:
        centre: (3,) float64, camera centre, metres.
        axes: (3, 3) float64, rows: across, across, and the middle viewing direction.
        pixel: of the image, at distance 1.
        low: (2,) float64, the middle of its first pixel.
        radius: of the silhouette, at distance 1.
        image: (h, w) float32, pixels outside of the outline, inside negative.
        unknown: (h, w) bool, beyond a gap of the outline.
    """

    def __init__(self, contours: Contours, room: float = 0.0) -> None:
        self.centre = contours.centre
        middle = contours.T.mean(axis=0)
        self.axes = axes_along(middle / np.linalg.norm(middle))
        local = contours.T @ self.axes.T
        plane = local[:, :2] / local[:, 2:]
        low, high = plane.min(axis=0), plane.max(axis=0)
        size = float((high - low).max())
        self.pixel = max(contours.radians_per_pixel, size / _MOST_PIXELS)
        margin = _MARGIN_PX + int(np.ceil(room * size / self.pixel))
        self.low = low - margin * self.pixel
        self.radius = 0.5 * float(np.linalg.norm(high - low))
        shape = np.ceil((high - self.low) / self.pixel).astype(int)[::-1] + margin + 1
        to_pixels = np.diag([1 / self.pixel, 1 / self.pixel, 1.0])
        to_pixels[:2, 2] = -self.low / self.pixel
        P = to_pixels @ self.axes
        self._P = np.column_stack([P, -P @ self.centre])
        xy = (plane - self.low) / self.pixel
        gaps = Gaps(xy, contours)
        self._borders = gaps.borders
        self.image, self.unknown = _distances(xy, contours, tuple(shape), gaps)

    @property
    def cut(self) -> bool:
        """Whether the border of the camera's image cuts the outline."""
        return len(self._borders) > 0

    def rays(self, rows: Index, columns: Index) -> Array:
        """(n, 3) viewing directions through pixels of the image, of depth 1."""
        plane = np.stack([columns, rows], axis=1) * self.pixel + self.low
        T: Array = np.column_stack([plane, np.ones(len(plane))]) @ self.axes
        return T

    def pixels_of(self, points: Array) -> Array:
        """(n, 2) where points (n, 3) before the camera lie in the image: column, row."""
        local = (points - self.centre) @ self.axes.T
        at: Array = (local[:, :2] / local[:, 2:] - self.low) / self.pixel
        return at

    def leave_open(self, region: Mask) -> None:
        """Know nothing of a region (h, w) of the image from now on."""
        out = cv2.distanceTransform((~region).astype(np.uint8), cv2.DIST_L2, 5)
        into = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 5)
        self.image = np.minimum(self.image, np.where(region, 0.5 - into, out - 0.5))
        self.unknown |= region & (self.image < 0)

    def beyond(self, points: Array) -> Array:
        """How far points (n, 3) are beyond the borders that cut the outline: (n,) float64,
        metres, within negative; -infinity where none does, and behind the camera."""
        local = (points - self.centre) @ self.axes.T
        depth = np.where(local[:, 2] > 0, local[:, 2], np.nan)
        at = (local[:, :2] / depth[:, None] - self.low) / self.pixel
        out = np.full(len(points), -np.inf)
        for line in self._borders:
            out = np.fmax(out, (at @ line[:2] + line[2]) * self.pixel * depth)
        return out

    def outside(self, points: Array) -> Array:
        """How far points (n, 3) are outside the cone: (n,) float64, metres, inside
        negative. Behind the camera nothing is known: -infinity."""
        worst = np.full(len(points), -np.inf)
        self.raise_to(points, worst)
        return worst

    def raise_to(self, points: Array, worst: Array, most: float = np.inf) -> None:
        """Raise ``worst`` (n,) to how far points (n, 3) are outside, where that is more and it
        is not above ``most`` already."""
        compiled("surface.kernels").raise_to_cone(
            np.ascontiguousarray(points), self._P, self.image, self.pixel, float(most), worst
        )


def cones_of(contours: Sequence[Contours]) -> dict[int, Cone]:
    """By the numbers of the views: of those with an outline."""
    return {i: Cone(c) for i, c in enumerate(contours) if len(c) > 2}


def far_apart(views: Sequence[Item]) -> list[Item]:
    """Views far from each other first: most points outside are found out by a few."""
    return [view for first in range(_STRIDE) for view in views[first::_STRIDE]]


def inside(points: Array, cones: Sequence[Cone], slack: float = 0.0) -> Mask:
    """(n, d) which of points (n, d, 3) no cone shows to be outside by more than slack, metres."""
    worst = np.full(points.shape[:2], -np.inf)
    for cone in far_apart(cones):
        cone.raise_to(points.reshape(-1, 3), worst.ravel(), slack)
    return np.asarray(worst <= slack)


def middle_of(cones: Sequence[Cone]) -> tuple[Array, float]:
    """The point (3,) nearest to all middle viewing rays, and the object's radius, metres."""
    centres = np.array([cone.centre for cone in cones])
    middle = nearest_to_rays(centres, np.array([cone.axes[2] for cone in cones]))
    away = np.linalg.norm(centres - middle, axis=1)
    return middle, float(np.median([c.radius * d for c, d in zip(cones, away, strict=True)]))


def _distances(
    xy: Array, contours: Contours, shape: tuple[int, ...], gaps: Gaps
) -> tuple[NDArray[np.float32], Mask]:
    """Image of signed distances to closed loops with corners xy (n, 2), in its pixels, and
    where it says nothing.

    Exact to either side of the outline, and within a few hundredths of a pixel beyond.
    """
    shift = 8
    loops = [np.round(loop * 2**shift).astype(np.int32) for loop in gaps.closed_loops()]
    filled = np.zeros(shape, np.uint8)
    cv2.fillPoly(filled, loops, 1, shift=shift)
    unknown = gaps.unknown(filled)
    filled[unknown] = 1
    into = cv2.distanceTransform(filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    out = cv2.distanceTransform(1 - filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    image = np.where(filled > 0, 0.5 - into, out - 0.5).astype(np.float32)
    v, u = np.nonzero(np.abs(image) < _BAND_PX)
    outline = xy, contours.next_row, contours.previous_row, contours.linked
    nearest, exact = np.full(shape, -1, np.int32), np.empty(len(u))
    compiled("surface.kernels").to_outline(u, v, *outline, _BAND_PX + 1, nearest, exact)
    if unknown.any():
        # What ends here may be what is known, instead of the silhouette.
        ends = (np.abs(exact) > _BAND_PX + 1) | unknown[v, u]
        exact = np.where(ends, image[v, u], exact)
        for line in gaps.borders:
            exact = np.minimum(exact, -(u * line[0] + v * line[1] + line[2]))
    image[v, u] = exact
    return image, unknown
