"""What of a solid's rims bounds its silhouette, sampled evenly in the image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array, repeated

from .arrangement import Arc, outline
from .part import Part
from .primitives import RimCurve

_SIDE_PX = 0.5
_REFINEMENTS = 6
_MOST_NODES = 200_000
_CORNER_SAMPLES = 1.5


@dataclass(frozen=True)
class Silhouette:
    """The visible occluding contour and the rim that it is the image of.

    Loops are stored one after the other, the outer ones first, each group by falling
    size; walking one has the object on the left as displayed.

    Attributes:
        uv: (n, 2) float64, pixels, not limited to the image.
        points: (n, 3) float64, rim points, metres.
        normals: (n, 3) float64, outward unit normals.
        k_t: (n,) float64, normal curvature along the ray, 1/m, positive where convex.
        loop: (n,) uint16, number of the loop.
        corner: (n,) bool, beside a corner of the outline, where two rims cross.
        part: (n,) intp, number of the part that the point is on.
    """

    uv: Array
    points: Array
    normals: Array
    k_t: Array
    loop: NDArray[np.uint16]
    corner: NDArray[np.bool_]
    part: NDArray[np.intp]


@dataclass(frozen=True)
class _Curve:
    """A rim with its image as a fine polygon, walked with the object on the left."""

    part: int
    rim: RimCurve
    theta: Array
    uv: Array


def silhouette(parts: tuple[Part, ...], camera: Camera, spacing_px: float) -> Silhouette:
    """The silhouette of the union of some parts.

    Args:
        parts: closed surfaces.
        camera: the view, with all parts in front of it.
        spacing_px: distance of samples along the contour; each loop takes the nearest
            value that divides it evenly.

    Raises:
        ValueError: the camera is inside the object or has it not wholly in front.
    """
    curves = [
        _traced(number, rim, camera)
        for number, part in enumerate(parts)
        for rim in part.rims(camera.centre)
    ]
    loops = [_Sampled(curves, arcs, spacing_px) for arcs in outline([c.uv for c in curves])]
    loops = [loop for loop in loops if len(loop.theta) >= 3]
    # Outer loops, which have negative areas with v down, then holes; the largest first.
    loops.sort(key=lambda loop: (loop.area > 0, -abs(loop.area)))
    return _evaluated(parts, curves, loops, camera)


def _traced(number: int, rim: RimCurve, camera: Camera) -> _Curve:
    """Refine the image of a rim until no side is longer than _SIDE_PX."""
    theta = np.linspace(0, 2 * np.pi, rim.nodes + 1)
    uv = camera.project(rim.at(theta))
    for _ in range(_REFINEMENTS):
        if not np.isfinite(uv).all():
            raise ValueError("the object is not wholly in front of the camera")
        side = np.linalg.norm(np.diff(uv, axis=0), axis=1)
        extra = np.minimum(np.ceil(side / _SIDE_PX).astype(np.intp), 64) - 1
        if extra.max() <= 0 or len(theta) + extra.sum() > _MOST_NODES:
            break
        new = _between(theta, extra)
        order = np.argsort(np.concatenate([theta, new]), kind="stable")
        theta = np.concatenate([theta, new])[order]
        uv = np.concatenate([uv, camera.project(rim.at(new))])[order]
    return _Curve(number, rim, theta, uv[:-1])


def _between(theta: Array, extra: NDArray[np.intp]) -> Array:
    """Split the steps of theta evenly by extra[i] new values in the i-th."""
    step, rank = repeated(extra)
    share = (rank + 1) / (extra[step] + 1)
    return theta[step] + share * (theta[step + 1] - theta[step])


class _Sampled:
    """One loop of the outline, sampled evenly."""

    def __init__(self, curves: list[_Curve], arcs: list[Arc], spacing_px: float) -> None:
        pieces = [self._nodes(curves[arc.curve], arc) for arc in arcs]
        lengths = [np.linalg.norm(np.diff(uv, axis=0), axis=1) for _, uv in pieces]
        ends = np.cumsum([0.0] + [length.sum() for length in lengths])
        n = round(ends[-1] / spacing_px)
        corners = len(arcs) > 1 or not float(arcs[0].start).is_integer()
        # Half a step from the first corner, so that no sample sits on it.
        at = (np.arange(n) + 0.5 * corners) * (ends[-1] / max(n, 1))
        which = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(arcs) - 1)
        self.curve = np.array([arc.curve for arc in arcs], np.intp)[which]
        self.theta = np.zeros(n)
        for k, (theta, _) in enumerate(pieces):
            mine = which == k
            along = np.concatenate([[0.0], np.cumsum(lengths[k])])
            self.theta[mine] = np.interp(at[mine] - ends[k], along, theta)
        self.corner = np.zeros(n, bool)
        if corners:
            from_corner = np.minimum(at - ends[which], ends[which + 1] - at)
            self.corner = from_corner < _CORNER_SAMPLES * spacing_px
        x, y = np.concatenate([uv[:-1] for _, uv in pieces]).T
        self.area = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())

    @staticmethod
    def _nodes(curve: _Curve, arc: Arc) -> tuple[Array, Array]:
        """theta (m,) and uv (m, 2) along an arc, both ends included."""
        n = len(curve.uv)
        inner = np.arange(np.floor(arc.start) + 1, np.ceil(arc.stop))
        at = np.concatenate([[arc.start], inner, [arc.stop]])
        turn = curve.theta[-1] - curve.theta[0]
        nodes = np.arange(2 * n + 1)
        theta = np.concatenate([curve.theta[:-1], curve.theta + turn])
        uv = np.concatenate([curve.uv, curve.uv, curve.uv[:1]])
        theta, u, v = (np.interp(at, nodes, values) for values in (theta, *uv.T))
        return theta, np.column_stack([u, v])


def _evaluated(
    parts: tuple[Part, ...], curves: list[_Curve], loops: list[_Sampled], camera: Camera
) -> Silhouette:
    """The exact rim at the sampled parameters."""
    counts = [len(loop.theta) for loop in loops]
    n = sum(counts)
    theta = np.concatenate([np.zeros(0), *(loop.theta for loop in loops)])
    curve = np.concatenate([np.zeros(0, np.intp), *(loop.curve for loop in loops)])
    points, normals, k_t = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
    part = np.zeros(n, np.intp)
    for number in np.unique(curve):
        mine = curve == number
        part[mine] = curves[number].part
        points[mine] = curves[number].rim.at(theta[mine])
    T = points - camera.centre
    T /= np.linalg.norm(T, axis=1, keepdims=True)
    for number in np.unique(part):
        mine = part == number
        normals[mine], k_t[mine] = parts[number].at_rim(points[mine], T[mine])
    return Silhouette(
        uv=camera.project(points),
        points=points,
        normals=normals,
        k_t=k_t,
        loop=np.repeat(np.arange(len(loops)), counts).astype(np.uint16),
        corner=np.concatenate([np.zeros(0, bool), *(loop.corner for loop in loops)]),
        part=part,
    )
