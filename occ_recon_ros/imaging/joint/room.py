"""Outlines that lie along an edge of the room: a horizon, the edge of a table, the foot of a wall.

A column before it, cut at one row of the image, agrees with itself in all views. But its room has
an edge there, which goes on beyond the mask on both sides; the sides of the column, and the rim of
a round plate, are as still and end with it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from .regions import Mask, grown, shrunk, square

Array = NDArray[np.floating]

SOME_ALONG_ROOM = 0.03  # share of an outline; right ones have next to none, a cut foot has 0.08

_NEARLY_ALL = 0.8  # of the views, that have an outline at one place
_NEAR = 3  # px, between outlines at one place; what is nearer to a mask may be of the object
_SMOOTH = 2.0  # px, of the masks, for their normals
_TURNS = np.deg2rad(np.arange(-8, 9, 2))  # off the tangent: normals are rough, and edges bend
_GOES_ON, _LEAST = 0.2, 12  # of the longer side of the mask, and px: so long is an edge beside it
_APART = 2  # px, from an edge to either side of it, and from an outline to the edge it lies along
_CLEARLY = 3.0  # standard deviations along an edge, by which its sides differ
_SHARPER = 2.0  # times what its sides change by themselves, so far from it again
_ROUNDING = 0.5  # grey levels, within which sides are alike whatever their noise
_FINE = 0.8  # px, blur of the room


class RoomEdges:
    """Outlines of a turn along edges of its room, where the camera and the room stand still."""

    def __init__(self) -> None:
        self._rims: list[NDArray[np.intp]] = []
        self._sum = np.zeros(0, np.float32)
        self._alike = True

    def add(self, image: NDArray[np.uint8], mask: Mask, picture: Mask) -> None:
        """Look at a view: (h, w, 3), its mask (h, w), and False on padding (h, w)."""
        rim = mask & ~shrunk(mask, square(3))
        self._rims.append(np.flatnonzero(rim))
        if not len(self._sum):
            self._sum = np.zeros(image.shape, np.float32)
            self._bare, self._inside, self._outlined = np.zeros((3, *mask.shape), np.float32)
        self._alike &= self._sum.shape == image.shape
        if self._alike:
            bare = picture & ~grown(mask, square(2 * _NEAR + 1))
            self._sum += image * bare[..., None]
            self._bare += bare
            self._inside += mask
            self._outlined += grown(rim, square(_NEAR))

    def shares(self) -> NDArray[np.float64]:
        """(n,) of each view's outline, that lies along such edges."""
        if not (len(self._sum) and self._alike):
            return np.zeros(len(self._rims))
        along = grown(self._along(), square(_NEAR)).ravel()
        return np.array([float(np.mean(along[rim])) if len(rim) else 0.0 for rim in self._rims])

    def _along(self) -> Mask:
        """(h, w) of the usual outline, where it is in nearly all views and an edge of the room goes
        on on both sides."""
        count = len(self._rims)
        usual = self._inside > 0.5 * count
        found = usual & ~shrunk(usual, square(3)) & (self._outlined >= _NEARLY_ALL * count)
        at = np.argwhere(found)[:, ::-1]
        soft = cv2.GaussianBlur(self._inside, (0, 0), _SMOOTH)
        normal = np.stack([cv2.Sobel(soft, cv2.CV_32F, *o)[found] for o in ((1, 0), (0, 1))], -1)
        normal /= np.linalg.norm(normal, axis=1)[:, None] + 1e-9
        tangent = normal[:, ::-1] * (1, -1)
        blurred = cv2.GaussianBlur(np.dstack([self._sum, self._bare]), (0, 0), _FINE)
        room = blurred[..., :3] / np.maximum(blurred[..., 3:], 1e-3)
        bare = self._bare > 0.5 * count
        longer = max(cv2.boundingRect(usual.astype(np.uint8))[2:])
        along = np.zeros(len(at), np.bool_)
        for turn in _TURNS:
            way = np.cos(turn) * tangent + np.sin(turn) * normal
            left = _step(room, bare, at, -way, -1, longer)
            some = left.any(axis=1) & ~along
            right = _step(room, bare, at[some], way[some], 1, longer)
            along[some] = (left[some] * right).sum(axis=1) > 0  # the same edge on both sides
        found[found] = along
        return found


def _step(
    room: Array, bare: Mask, at: NDArray[np.intp], way: Array, side: int, longer: int
) -> Array:
    """(m, 3) grey levels by which the room changes across a way, along all of it where it first is
    seen from a place; 0 where it has no edge there.

    Args:
        room: (h, w, 3) grey levels.
        bare: (h, w) where it is seen.
        at, way: (m, 2) px, and a direction of length one.
        side: 1 or -1, of the way.
        longer: px, longer side of what hides the room.
    """
    found = np.zeros((len(at), 3), np.float32)
    if not len(at):
        return found
    across = side * way[:, None, ::-1] * (-1, 1)

    def shown(values: Array, along: NDArray[np.intp], beside: int = 0) -> Array:
        places = at[:, None] + along[..., None] * way[:, None] + beside * across
        x, y = np.moveaxis(places.astype(np.float32), -1, 0)
        return np.asarray(cv2.remap(values, x, y, cv2.INTER_LINEAR))

    seen = bare.astype(np.float32)
    first = np.argmax(shown(seen, np.tile(np.arange(longer), (len(at), 1))) == 1, axis=1)
    stretch = first[:, None] + np.arange(max(_LEAST, round(_GOES_ON * longer)))
    whole = (shown(seen, stretch) == 1).all(axis=1)
    strips = {k: shown(room, stretch, k) for k in range(-4 * _APART, 4 * _APART + 1)}
    for k in range(-_APART, _APART + 1):
        over, beyond, before = (
            strips[k + j * _APART] - strips[k + i * _APART] for j, i in ((1, -1), (3, 1), (-1, -3))
        )
        step, *shades = (np.linalg.norm(d.mean(axis=1), axis=1) for d in (over, beyond, before))
        rough = _CLEARLY * (np.linalg.norm(over.std(axis=1), axis=1) + _ROUNDING)
        edge = whole & (step > np.maximum(rough, _SHARPER * sum(shades)))
        edge &= step > np.linalg.norm(found, axis=1)
        found[edge] = over.mean(axis=1)[edge]
    return found
