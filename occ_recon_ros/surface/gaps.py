"""Where an outline has gaps, and what therefore nobody knows.

The border of the camera's image cuts an outline along columns and rows of pixels; a gap
whose two ends lie on the utmost columns and rows of the outline was made by it. The object
goes on beyond, and as the object is on the left of an outline as it is walked, the border
between the two ends, walked the same way, is inside of the silhouette.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours
from ..geometry.arrays import Array

Mask = NDArray[np.bool_]

_AT_BORDER = 3.0  # steps of the outline: an end so near to its utmost column or row is cut there
_ALONG = 50.0  # px between the two points that a border's line is laid through
# The borders in the order in which an object on the left hand is walked about (as the image
# is displayed): axis of the pixel, and sign of the way out.
_SIDES = ((0, -1.0), (1, 1.0), (0, 1.0), (1, -1.0))


class Gaps:
    """The gaps of an outline, on a plane across the view.

    Args:
        xy: (n, 2) the outline on the plane, in pixels of an image there.
        contours: the outline.

    Attributes:
        borders: (k, 3) lines of the image's border that cut the outline: a x + b y + c is
            how far beyond a point lies.
    """

    def __init__(self, xy: Array, contours: Contours) -> None:
        self._xy, self._starts = xy, contours.loop_starts
        self._rows = np.flatnonzero(~contours.linked)
        self._next = contours.next_row
        self._sides = self._sides_of(contours) if len(self._rows) else []
        used = sorted({side for sides in self._sides for side in sides})
        self._lines = self._lines_of(contours, used) if used else {}
        self.borders = np.array([*self._lines.values()]).reshape(-1, 3)

    def closed_loops(self) -> list[Array]:
        """The loops (m, 2), closed along the border where it cuts them."""
        corners = {
            int(row): self._corners(sides)
            for row, sides in zip(self._rows, self._sides, strict=True)
            if len(sides) > 1
        }
        loops = []
        for first, end in pairwise(self._starts):
            parts, at = [], first
            for row in sorted(row for row in corners if first <= row < end):
                parts += [self._xy[at : row + 1], corners[row]]
                at = row + 1
            loops.append(np.concatenate([*parts, self._xy[at:end]]))
        return loops

    def unknown(self, filled: NDArray[np.uint8]) -> Mask:
        """The pixels of which nothing is known: beyond borders, and those to which the chord
        over a gap within the image is nearer than the outline.

        Args:
            filled: (h, w) 1 inside of the closed loops.
        """
        unknown = np.zeros(filled.shape, bool)
        y, x = np.ogrid[: filled.shape[0], : filled.shape[1]]
        for a, b, c in self.borders:
            unknown |= a * x + b * y + c > 0
        chord = np.zeros_like(filled)
        for row, sides in zip(self._rows, self._sides, strict=True):
            if not sides:
                a, b = self._xy[row], self._xy[self._next[row]]
                # Without its ends, which the outline has as well.
                short = (b - a) / max(float(np.linalg.norm(b - a)) / 2, 2.0)
                a, b = np.round([a + short, b - short]).astype(int).tolist()
                cv2.line(chord, a, b, 1, thickness=3)
        if chord.any():
            label = cv2.distanceTransformWithLabels(
                1 - (filled | chord), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
            )[1]
            of_chord = np.zeros(int(label.max()) + 1, bool)
            of_chord[label[chord > 0]] = True
            unknown |= of_chord[label] & (filled == 0)
        return unknown

    def _sides_of(self, contours: Contours) -> list[list[int]]:
        """For each gap the borders that run between its ends, in order; none for a gap within
        the image."""
        uv = contours.uv
        step = uv[self._next] - uv
        near = _AT_BORDER * float(np.median(np.hypot(*step.T)))
        utmost = np.array([(sign * uv[:, axis]).max() for axis, sign in _SIDES])
        axes, signs = np.array([a for a, _ in _SIDES]), np.array([s for _, s in _SIDES])
        from_start = utmost - signs * uv[self._rows][:, axes]
        from_end = utmost - signs * uv[self._next[self._rows]][:, axes]
        found: list[list[int]] = []
        for a, b in zip(from_start, from_end, strict=True):
            if np.minimum(a.min(), b.min()) > near or max(a.min(), b.min()) > near:
                found.append([])
            elif np.maximum(a, b).min() <= near:
                found.append([int(np.maximum(a, b).argmin())])
            else:
                first, last = int(a.argmin()), int(b.argmin())
                found.append([(first + k) % 4 for k in range((last - first) % 4 + 1)])
        return found

    def _lines_of(self, contours: Contours, used: list[int]) -> dict[int, Array]:
        """The lines of borders. From the camera's image to the plane leads a homography, but
        for the distortion of the lens: the lines are laid through the ends of the gaps."""
        uv, xy = contours.uv, self._xy
        H = cv2.findHomography(uv, xy)[0]
        if H is None:  # all samples on one line
            self._sides = [[] for _ in self._sides]
            return {}
        lines = {}
        for side in used:
            axis, sign = _SIDES[side]
            starts = [k for k, sides in enumerate(self._sides) if sides[:1] == [side]]
            stops = [k for k, sides in enumerate(self._sides) if sides[-1:] == [side]]
            ends = np.concatenate([self._rows[starts], self._next[self._rows[stops]]])
            # Between two others no end need lie on it.
            ends = ends if len(ends) else np.array([(sign * uv[:, axis]).argmax()])
            points = np.tile(uv[ends].mean(axis=0), (3, 1))
            points[:2, 1 - axis] += [-_ALONG, _ALONG]
            points[2, axis] += sign * _ALONG
            a, b, beyond = cv2.perspectiveTransform(points[None], H)[0]
            across = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
            across *= np.sign(across @ (beyond - a))
            lines[side] = np.array([*across, -float((xy[ends] @ across).min())])
        return lines

    def _corners(self, sides: list[int]) -> Array:
        """(m, 2) where borders meet."""
        lines = [self._lines[side] for side in sides]
        meet = [np.cross(one, other) for one, other in pairwise(lines)]
        return np.array([m[:2] / m[2] for m in meet])
