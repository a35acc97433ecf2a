"""Whether the object stands on something flat that turns with it: a plate, a board, a book.

No colour need tell it from the object, and all views agree about it. What gives it away is its
shape: the edge of a flat thing is a plane curve across the axis of the turn that every view sees
whole, on the near side and, beside what stands on it, on the far side too. The foot of an
object hides its own far side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array, axes_along, thinned
from occ_recon_ros.surface.cone import Cone, middle_of

_MOST_CONES, _FEWEST = 16, 5
_HEIGHTS, _ACROSS = 56, 64  # planes that are tried, and points along each side of their rasters
_REACH, _SIDE = 1.3, 1.5  # radii of the silhouettes, to which they are tried, up and across
_WRONG = 0.05  # of the views may contradict that something is there
_BESIDE = 0.06  # of the radius of an edge, how far beside it a view must see the backdrop
_CLOSE_BESIDE, _CLOSE_SIDE = 0.03, 1.25  # the same, and radii across, where its height is found
_BESIDE_CELLS = 1.5  # and cells of the raster, at the least
_FACING = 0.3  # cosine from which on a place of the edge is near or far, and not aside
_NEAR = 0.8  # share of the near edge on the outlines, for anything that ends flat below
_LIKE = 0.98  # of the best share, from which on edges are as well seen
_SEEN = 0.5  # share of the edge, near by far: feet and pedestals of figures stay below 0.46
_THICK = 0.45  # of its radius, most that a base may be high; a pedestal is higher
_ALIKE = 1.33  # ratio of the areas of its lower and upper edge
_WIDE = 0.5  # of the largest section, area of the base at the least
_STANDS_OUT = 1.1  # times the height that a bare disc of its size seems to have
_UPRIGHT = 0.9998  # cosine with an axis of the frame: a degree
_NEAR_AXIS = 0.95  # the same, within which that is likelier than where a hand held the camera


@dataclass(frozen=True)
class Base:
    """Something flat under the object.

    Attributes:
        top: (3,) float64, metres, object frame: the middle of its upper side.
        axis: (3,) float64, unit, across it, towards the object.
        width: metres, of a disc of its area.
        share: 0 to 1, of its edge that the views see.
        bare: whether no more is seen of what may stand on it than of the disc alone.
        edge: (k, 3) float64, metres, around its upper side.
    """

    top: Array
    axis: Array
    width: float
    share: float
    bare: bool
    edge: Array

    def said(self) -> str:
        """What outlines show, in words."""
        size = f"about {1e3 * self.width:.0f} mm wide"
        if self.bare:
            return (
                f"every outline is that of a flat thing, {size}: what lies on it, or is hollow in "
                "it, outlines hardly show"
            )
        return (
            f"the object stands on something flat, {size}, that turns with it (a plate, a board, "
            "its own foot?) and was taken for a part of it"
        )

    def options(self) -> str:
        """The parameters that leave it out."""
        values: dict[str, float] = {}
        names, along = "xyz", int(np.argmax(np.abs(self.axis)))
        direction = self.axis
        if abs(self.axis[along]) > _UPRIGHT:
            values[f"volume_{names[along]}"] = float(self.top[along])
            direction = np.sign(self.axis[along]) * np.eye(3)[along]
        else:
            point = (self.axis @ self.top) * self.axis
            values |= {f"volume_{n}": float(v) for n, v in zip(names, point, strict=True)}
        if not np.array_equal(direction, [0, 0, 1]):
            values |= {f"volume_axis_{n}": float(v) for n, v in zip(names, direction, strict=True)}
        given = ["volume_kind=plane", *(f"{name}={value:.4g}" for name, value in values.items())]
        return " ".join(f"--set contour_tracker.{item}" for item in given)


@dataclass(frozen=True)
class _Sections:
    """Sections of what all views see, across the axis, and how much of their edges views see.

    Attributes:
        height: (m,) metres along the axis from the middle.
        area: (m,) m^2.
        near, far: (m,) share of the near and of the far edge beside which views see backdrop.
        edge: of each, (k, 3) metres.
    """

    height: Array
    area: Array
    near: Array
    far: Array
    edge: list[Array]


def base_under(contours: Sequence[Contours]) -> Base | None:
    """The flat thing on which the object stands, as far as outlines show one.

    Args:
        contours: of the views of a turn, of which some, spread evenly, are looked at.

    Returns:
        None where there is none, or where the cameras stand around nothing.
    """
    seen = [c for c in contours if len(c) > 2]
    whole = [c for c in seen if c.linked.all()]  # the border of the image cuts no edge of these
    cones = [Cone(c) for c in thinned(whole if 2 * len(whole) >= len(seen) else seen, _MOST_CONES)]
    if len(cones) < _FEWEST:
        return None
    centres = np.array([cone.centre for cone in cones])
    middle, radius = middle_of(cones)
    if not np.isfinite(radius):
        return None
    ways = [_across(cones, middle, radius, *way) for way in _upwards(centres, middle)]
    found = [base for base in ways if base is not None]
    best = max((base.share for base in found), default=0.0)
    return next((base for base in found if base.share >= _LIKE * best), None)


def _across(
    cones: Sequence[Cone], middle: Array, radius: float, axis: Array, rise: float
) -> Base | None:
    """The flat thing across an axis (3,); middle and radius: of the silhouettes, metres;
    ``rise``: tangent of the elevation of the cameras."""
    heights = np.linspace(-_REACH, _REACH, _HEIGHTS) * radius
    sections = _sections(cones, middle, axis, heights, _SIDE * radius, _BESIDE)
    pair = _best_pair(sections)
    if pair is None:
        return None
    low, high = pair
    share = float(sections.near[low] * sections.far[high])
    size = float(np.sqrt(sections.area[high] / np.pi))
    there = sections.height[sections.area > 0]
    bare = float(there[-1] - sections.height[high]) < _STANDS_OUT * size * rise
    step = float(sections.height[1] - sections.height[0])
    heights = sections.height[high] + np.linspace(-2, 2, 17) * step
    aside = sections.edge[high].mean(axis=0) - middle
    aside -= (aside @ axis) * axis
    half = _CLOSE_SIDE * float(
        np.linalg.norm(sections.edge[high] - sections.edge[high].mean(0), axis=1).max()
    )
    fine = _sections(cones, middle + aside, axis, heights, half, _CLOSE_BESIDE)
    # Planes a little above and below its upper edge see it almost as whole.
    whole = np.flatnonzero(fine.far >= 0.98 * fine.far.max())
    at = int(np.rint(whole.mean()))
    edge = fine.edge[at]
    width = 2 * float(np.sqrt(fine.area[at] / np.pi))
    return Base(edge.mean(axis=0), axis, width, share, bare, edge)


def _upwards(centres: Array, middle: Array) -> list[tuple[Array, float]]:
    """(3,) unit, the axis of the frame nearest to that about which the cameras stand, for a hand
    goes around none and boards are across one, towards their side, and the tangent of their
    elevation above the middle; then the axis itself. Nothing where they stand around nothing."""
    away = centres - middle
    _, size, axes = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)
    if size[1] < 0.3 * size[0] or size[2] > 0.5 * size[1]:
        return []
    about = axes[2] * (1.0 if away.mean(axis=0) @ axes[2] >= 0 else -1.0)
    of_frame = np.zeros(3)
    along = int(np.argmax(np.abs(about)))
    of_frame[along] = np.sign(about[along])
    ways = [of_frame, about] if _NEAR_AXIS < about @ of_frame < _UPRIGHT else [about]
    found = []
    for axis in ways:
        height = away @ axis
        aside = np.linalg.norm(away - height[:, None] * axis, axis=1)
        found.append((axis, abs(float(height.mean())) / max(float(np.median(aside)), 1e-12)))
    return found


def _sections(
    cones: Sequence[Cone],
    middle: Array,
    axis: Array,
    heights: Array,
    half: float,
    beside: float,
) -> _Sections:
    """Sections at heights along the axis above a middle, in squares of so half a side, metres."""
    along = axes_along(axis)[:2]
    side = np.linspace(-half, half, _ACROSS)
    x, y = np.meshgrid(side, side)
    raster = x.reshape(-1, 1) * along[0] + y.reshape(-1, 1) * along[1]
    rows = [
        _section(cones, middle + height * axis, raster, along, side, beside) for height in heights
    ]
    area, near, far, edge = zip(*rows, strict=True)
    return _Sections(heights, np.array(area), np.array(near), np.array(far), list(edge))


def _section(
    cones: Sequence[Cone],
    origin: Array,
    raster: Array,
    along: Array,
    side: Array,
    beside: float,
) -> tuple[float, float, float, Array]:
    """Area, share of the near and of the far edge that is seen, and edge of one section."""
    cell = float(side[1] - side[0])
    views = _outside(cones, origin + raster)
    most = len(cones) - 1 - int(np.ceil(_WRONG * len(cones)))
    field = np.partition(views, most, axis=0)[most].reshape(len(side), len(side))
    double = np.asarray(cv2.resize(field, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR))
    filled = (double < 0).astype(np.uint8)
    loops = cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    loop = max(loops, key=len)[:, 0] if loops else np.zeros((0, 2), np.intp)
    area = 0.25 * cell**2 * float(np.count_nonzero(filled))
    if len(loop) < 12:
        return 0.0, 0.0, 0.0, np.zeros((0, 3))
    soft = cv2.GaussianBlur(double, (0, 0), 1.5)
    slope = [cv2.Sobel(soft, cv2.CV_32F, *d)[loop[:, 1], loop[:, 0]] for d in ((1, 0), (0, 1))]
    outwards = np.stack(slope, axis=1).astype(np.float64)
    outwards /= np.linalg.norm(outwards, axis=1)[:, None] + 1e-12
    at = side[0] + ((loop + 0.5) / 2 - 0.5) * cell
    away = max(beside * np.sqrt(area / np.pi), _BESIDE_CELLS * cell)
    points = origin + (at + away * outwards) @ along
    free = _outside(cones, points) > 0
    towards = np.array([(cone.centre - points) @ along.T for cone in cones])
    towards /= np.linalg.norm(towards, axis=2)[..., None]
    facing = (towards * outwards).sum(axis=2)
    near, far = facing > _FACING, facing < -_FACING
    shares = [float(free[side].mean()) if side.any() else 0.0 for side in (near, far)]
    return area, shares[0], shares[1], origin + at @ along


def _outside(cones: Sequence[Cone], points: Array) -> NDArray[np.float32]:
    """(cones, n) metres by which points (n, 3) are outside of each cone."""
    return np.stack([cone.outside(points) for cone in cones]).astype(np.float32)


def _best_pair(sections: _Sections) -> tuple[int, int] | None:
    """The lower and the upper edge of what most looks like a base; of like ones the thinnest."""
    wide = sections.area >= _WIDE * sections.area.max()
    pairs: list[tuple[float, float, int, int]] = []
    for low in np.flatnonzero(wide & (sections.near >= _NEAR)):
        area = sections.area[low]
        high = np.arange(low, len(sections.height))
        thick = sections.height[high] - sections.height[low]
        ratio = sections.area[high] / area
        fits = (thick <= _THICK * np.sqrt(area / np.pi)) & (ratio < _ALIKE) & (ratio > 1 / _ALIKE)
        share = np.where(fits, sections.near[low] * sections.far[high], 0.0)
        most = int(np.argmax(share))
        pairs.append((float(share[most]), float(thick[most]), int(low), int(high[most])))
    best = max((pair[0] for pair in pairs), default=0.0)
    if best <= _SEEN:
        return None
    return min((pair for pair in pairs if pair[0] >= _LIKE * best), key=lambda pair: pair[1])[2:]
