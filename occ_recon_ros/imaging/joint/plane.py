"""The plane that the object stands on: a table or a board, seen by all views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ...geometry.arrays import Array, evenly
from .each import each
from .scenes import Scene, typical
from .small_view import SmallView
from .space import fixation

_FAR = 1e4  # px, outside of every image
_UPRIGHT = 0.9  # cosine between an axis of the object frame and what is up in the usual image
_SAME = 0.99999  # cosine from which on two normals are one: a quarter of a degree


@dataclass(frozen=True)
class Plane:
    """A plane of the object frame with a square raster on it.

    Attributes:
        origin: (3,) float64, metres, the middle of the square.
        normal: (3,) float64, unit, towards the cameras.
        along: (2, 3) float64, unit, the axes of the raster.
        half: half the edge of the square, metres.
    """

    origin: Array
    normal: Array
    along: Array
    half: float

    def points(self, count: int) -> Array:
        """(count * count, 3) float64, metres: the raster."""
        at = np.linspace(-self.half, self.half, count)
        x, y = np.meshgrid(at, at)
        return self.origin + x.reshape(-1, 1) * self.along[0] + y.reshape(-1, 1) * self.along[1]

    def in_image(self, camera: Camera, count: int) -> tuple[Array, Array]:
        """u and v (count, count) float64 of the raster in a view, px, far outside where it lies
        behind the camera; by a homography, much faster, where the lens does not distort."""
        if len(camera.D):
            with np.errstate(invalid="ignore"):
                uv = np.nan_to_num(camera.project(self.points(count)), nan=-_FAR)
            return uv[:, 0].reshape(count, count), uv[:, 1].reshape(count, count)
        axes = camera.R_camera_object @ np.column_stack([*self.along, self.origin])
        axes[:, 2] += camera.t_camera_object
        at = np.linspace(-self.half, self.half, count)
        u, v, w = (a * at + (b * at[:, None] + c) for a, b, c in camera.K @ axes)
        before = w > 0
        w[~before] = 1.0
        return np.where(before, u / w, -_FAR), np.where(before, v / w, -_FAR)


def plane_at(origin: Array, normal: Array, half: float) -> Plane:
    """A plane through a point."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return Plane(origin, normal, np.stack([first, np.cross(normal, first)]), half)


def ring_normal(cameras: Sequence[Camera]) -> Array | None:
    """(3,) unit, the axis about which the cameras stand, from the middle to their side; None
    where they do not stand around anything."""
    centres = np.stack([c.centre for c in cameras])
    _, size, axes = np.linalg.svd(centres - centres.mean(axis=0))
    if size[1] < 0.3 * size[0] or size[2] > 0.5 * size[1]:
        return None
    normal = axes[2] * np.sign((centres.mean(axis=0) - fixation(cameras)) @ axes[2] or 1.0)
    return np.asarray(normal)


def normals(cameras: Sequence[Camera]) -> list[Array]:
    """Unit vectors (3,) to which the ground may be square, the likeliest first: the axis that the
    cameras stand around; and the axis of the object frame that points up in the images, for who
    measures from a board has it square to that, from wherever it was photographed."""
    about = ring_normal(cameras)
    away = np.stack([c.centre for c in cameras]) - fixation(cameras)
    away /= np.linalg.norm(away, axis=1)[:, None]
    # Seen from the side what is up is up in the image too, seen from above it is nearer.
    up = np.mean(away, axis=0) - np.mean([c.R_camera_object[1] for c in cameras], axis=0)
    axis = np.zeros(3)
    axis[np.argmax(np.abs(up))] = np.sign(up[np.argmax(np.abs(up))])
    found = [] if about is None else [about]
    if up @ axis > _UPRIGHT * np.linalg.norm(up) and not any(n @ axis > _SAME for n in found):
        found.append(axis)
    return found


def seen_on(
    plane: Plane, cameras: Sequence[Camera], images: Sequence[NDArray], count: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The raster as each view sees it.

    Returns:
        (n, count, count, 3) float32 colours and (n, count, count) bool, where it is seen.
    """
    colours = np.zeros((len(cameras), count, count, *images[0].shape[2:]), np.float32)
    seen = np.zeros((len(cameras), count, count), np.bool_)

    for k, (camera, image) in enumerate(zip(cameras, images, strict=True)):
        u, v = plane.in_image(camera, count)
        seen[k] = (u > 0) & (v > 0) & (u < camera.width - 1) & (v < camera.height - 1)
        at = np.clip((u, v), -_FAR, _FAR).astype(np.float32)
        colours[k] = cv2.remap(image, at[0], at[1], cv2.INTER_LINEAR)
    return colours, seen


_RASTER = 300
_UNEVEN = 0.006  # of half the raster's edge, height above the plane that is still the plane
_HEIGHTS, _SEARCH = 161, 0.6  # planes tried, up to this share of the space's half size
_FINEST = 5e-4  # of half the size, by which the plane that fits best is not known
_BETTER = 1.02  # times the share that fits, with less of which a plane is as good as another
_TEXTURE = 6.0  # grey levels a raster step, the least that tells one place from another
_LEAST_AREA, _STAND_OUT = 0.1, 5.0  # share that fits, and how much more than usual that is
_LEAST_LIKELY = 0.05  # the same where a plane is likely
_NEXT = 4  # of these planes on, what lies on a plane fits no more: 0.03 of half the size


@dataclass(frozen=True)
class Ground:
    """A plane that has been found, and where each view's pixels lie on its raster.

    Attributes:
        plane: the plane.
        places: of each view, (h, w) int32 flat place on the raster, -1 off it.
        uneven: height above the plane that is still the plane, metres.
    """

    plane: Plane
    places: list[NDArray[np.int32]]
    uneven: float

    def nearer(self, views: Sequence[SmallView], centre: Array, half: float) -> Ground:
        """The same plane as other views show it; ``centre``, ``half``: as of ``find_plane``."""
        ground = ground_at(views, self.plane.origin, self.plane.normal, centre, half)
        return replace(ground, uneven=_UNEVEN * ground.plane.half)

    def above(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether (n, 3) points lie above the plane, clear of its unevenness."""
        height = (points - self.plane.origin) @ self.plane.normal
        return np.asarray(height > self.uneven)

    def scenes(
        self, views: Sequence[SmallView], outside: Sequence[NDArray[np.bool_]]
    ) -> list[Scene]:
        """What the plane looks like from each view: as it is known to, or learnt where it is not
        hidden."""
        chosen = evenly(len(views), 32)
        some = [views[k] for k in chosen]
        shown, seen = seen_on(
            self.plane, [v.camera for v in some], [v.image for v in some], _RASTER
        )
        hidden = [(~outside[k]).astype(np.uint8) for k in chosen]
        covered, _ = seen_on(self.plane, [v.camera for v in some], hidden, _RASTER)
        median, spread = typical(shown, seen & (covered < 0.02))

        def looks(view: SmallView, places: NDArray[np.int32]) -> Scene:
            on = places >= 0
            picture = median.reshape(-1, 3)[np.maximum(places, 0)]
            doubt = np.where(on, spread.ravel()[places], np.float32(np.inf))
            if view.known is not None:
                sure = np.isfinite(view.known[1])
                picture = np.where(sure[..., None], view.known[0], picture)
                doubt = np.where(sure, view.known[1], doubt)
            return picture, doubt

        return each(looks, views, self.places)


Picture = tuple[NDArray[np.float32], NDArray[np.float32]]
"""What lies on a raster, (cells, 3) grey levels, and its spread (cells,), infinite: not known."""


def ground_picture(ground: Ground, scenes: Sequence[Scene]) -> Picture:
    """The ground as a raster, by what was known of it in each view (``Ground.scenes``)."""
    picture = np.zeros((_RASTER * _RASTER, 3), np.float32)
    spread = np.full(_RASTER * _RASTER, np.inf, np.float32)
    for places, (shows, doubt) in zip(ground.places, scenes, strict=True):
        on = places >= 0
        picture[places[on]], spread[places[on]] = shows[on], doubt[on]
    return picture, spread


def ground_scene(ground: Ground, picture: Picture, camera: Camera) -> Scene:
    """What the ground looks like from a further view."""
    places = _places(ground.plane, camera)
    doubt = np.where(places >= 0, picture[1][places], np.float32(np.inf))
    return picture[0][np.maximum(places, 0)], doubt


class Backdrop(Protocol):
    """A plane z = 0 of the object frame that is known beforehand, as a printed board.

    Attributes:
        size: width and height of its sheet, with the origin in the middle, metres.
    """

    size: tuple[float, float]

    def picture(
        self, image: NDArray, camera: Camera
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What an image shows where nothing hides the plane, (h, w, 3) BGR, and its spread (h, w),
        grey levels, infinite where that is not known."""


def known_ground(views: Sequence[SmallView], half: float) -> Ground:
    """The plane z = 0, on which views know what they show."""
    plane = plane_at(np.zeros(3), np.array([0.0, 0.0, 1.0]), half)
    return Ground(plane, _all_places(plane, views), 0.0)


def ground_at(
    views: Sequence[SmallView], point: Array, normal: Array, centre: Array, half: float
) -> Ground:
    """The plane through a point (3,), where it is said that the object stands on it.

    Args:
        views: n of them.
        point, normal: (3,) of the plane, metres, the normal towards the object.
        centre, half: as of ``find_plane``.
    """
    origin = centre - ((centre - point) @ normal) * normal
    plane = plane_at(origin, normal, 0.9 * half)
    return Ground(plane, _all_places(plane, views), 0.0)


def find_ground(views: Sequence[SmallView], centre: Array, half: float) -> Ground | None:
    """The ground on the plane of ``find_plane``, None where there is none."""
    plane = find_plane(views, centre, half)
    return None if plane is None else Ground(plane, _all_places(plane, views), _UNEVEN * plane.half)


def find_plane(views: Sequence[SmallView], centre: Array, half: float) -> Plane | None:
    """The plane across one of the ``normals`` whose pattern all views see at one place.

    Only a plane with a pattern on it can be found: a board, the grain of a table, a newspaper.

    Args:
        views: at least five.
        centre: (3,) where the views look, metres, object frame.
        half: half the size of the space that they share, metres.
    """
    chosen = [views[k] for k in evenly(len(views), 10)]
    if len(chosen) < 5:
        return None
    # Straightened, for many planes are drawn through the lens.
    cameras = [replace(view.camera, D=np.zeros(0), distortion="none") for view in chosen]
    grey = [
        cv2.undistort(cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY), view.camera.K, view.camera.D)
        for view in chosen
    ]

    def fits(plane: Plane) -> float:
        """Share of the middle of a plane on which all views see one pattern."""
        shown, seen = seen_on(plane_at(plane.origin, plane.normal, 0.4 * half), cameras, grey, 80)
        median = np.median(shown, axis=0)
        away = np.median(np.abs(shown - median), axis=0)
        slope = cv2.Sobel(median, cv2.CV_32F, 1, 0), cv2.Sobel(median, cv2.CV_32F, 0, 1)
        texture = (np.abs(slope[0]) + np.abs(slope[1])) / 8
        good = (seen.mean(axis=0) >= 0.6) & (texture > _TEXTURE) & (away < 0.5 * texture)
        return float(good.mean())

    found: list[tuple[float, Plane]] = []
    for normal in normals([view.camera for view in views]):
        heights = np.linspace(-_SEARCH, _SEARCH, _HEIGHTS) * half
        planes = [plane_at(centre + height * normal, normal, 0.9 * half) for height in heights]
        areas = np.array(each(fits, planes))
        # Who measures from a board has it at height 0: that another one fits there is chance.
        board = heights[1] - heights[0] > np.abs(heights + centre @ normal)
        if (best := standing_out(areas, board & (np.abs(normal).max() > _SAME))) is not None:
            found.append((areas[best], planes[best]))
    if not found:
        return None
    return _fitted(*max(found, key=lambda plane: plane[0]), fits, centre, half)


def _fitted(
    area: float, plane: Plane, fits: Callable[[Plane], float], centre: Array, half: float
) -> Plane:
    """The plane beside another one that fits best: higher or lower, or tilted, for a hand does not
    lead the camera around any axis."""
    step = 2 * _SEARCH / (_HEIGHTS - 1)  # of half the size; of tilts, radians
    while step > _FINEST:
        moves = []
        for up, tilt in ((1, (0, 0)), (0, (1, 0)), (0, (0, 1))):
            for by in (-step, step):
                normal = plane.normal + by / 0.4 * (np.array(tilt) @ plane.along)
                normal /= np.linalg.norm(normal)
                origin = plane.origin + (by * up * half) * normal
                origin = centre - ((centre - origin) @ normal) * normal
                moves.append(plane_at(origin, normal, plane.half))
        areas = each(fits, moves)
        if max(areas) > _BETTER * area:
            area, plane = max(areas), moves[int(np.argmax(areas))]
        else:
            step /= 2
    return plane


def standing_out(areas: Array, likely: NDArray[np.bool_] | None = None) -> int | None:
    """Which of planes at ``_HEIGHTS`` fits much better than most and than those a little higher and
    lower; None where none does. The back of an animal fits as well, but over many heights.

    Args:
        areas: (n,) share of each plane that fits.
        likely: (n,) where a plane need not fit so much better, if it fits best; None: nowhere.
    """
    beside = np.pad(areas, _NEXT)
    alone = areas - np.maximum(beside[: -2 * _NEXT], beside[2 * _NEXT :])
    best = int(np.argmax(alone))
    least = max(_LEAST_AREA, _STAND_OUT * float(np.median(areas)))
    if likely is not None and likely[best] and best == np.argmax(areas):
        least = _LEAST_LIKELY
    return best if alone[best] >= least else None


def _all_places(plane: Plane, views: Sequence[SmallView]) -> list[NDArray[np.int32]]:
    return each(lambda view: _places(plane, view.camera), views)


def _places(plane: Plane, camera: Camera) -> NDArray[np.int32]:
    """(h, w) int32, where the ray of each pixel meets the raster, -1 where it does not."""
    y, x = np.mgrid[: camera.height, : camera.width]
    rays = camera.viewing_directions(np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))
    down = rays @ plane.normal
    down = np.where(np.abs(down) > 1e-6, down, 1e-6)
    away = (plane.origin - camera.centre) @ plane.normal / down
    at = (camera.centre + away[:, None] * rays - plane.origin) @ plane.along.T
    cell = np.rint((at / plane.half + 1) * 0.5 * (_RASTER - 1))
    on = (away > 0) & (cell >= 0).all(axis=1) & (cell < _RASTER).all(axis=1)
    cell = np.where(on[:, None], cell, 0).astype(np.int32)
    return np.where(on, cell[:, 1] * _RASTER + cell[:, 0], -1).reshape(x.shape).astype(np.int32)
