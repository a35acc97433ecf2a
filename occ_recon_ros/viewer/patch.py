"""A piece of surface as a page draws it: shared vertices, and their colours."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..surface import Strip

SHADINGS = ("plain", "colour", "normals", "depth sigma")
"""What the colours of a surface can tell."""

_PLAIN = np.array([160, 190, 214], np.uint8)
_UNKNOWN = np.array([150, 150, 150], np.uint8)
_VIRIDIS = np.array(  # at 0, 1/4, 1/2, 3/4, 1
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], np.float64
)
# Odd multipliers with well mixed bits (of splitmix64): equal corners have equal keys, and
# two of a million others share one once in a million surfaces.
_MIX = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], np.uint64)


@dataclass(frozen=True)
class Patch:
    """Triangles with shared vertices.

    Attributes:
        stamp_ns: of the newest rim in it, nanoseconds.
        vertices: (v, 3) float32, metres, object frame.
        normals: (v, 3) float32, outward unit normals.
        sigma: (v,) float32, 1 sigma of the depth, metres; NaN where unknown.
        rgb: (v, 3) uint8, or None without colour.
        faces: (m, 3) uint32, outward by the right-hand rule.
    """

    stamp_ns: int
    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    sigma: NDArray[np.float32]
    rgb: NDArray[np.uint8] | None
    faces: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.faces)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        arrays = (self.vertices, self.normals, self.sigma, self.rgb, self.faces)
        return sum(array.nbytes for array in arrays if array is not None)


def merged(strip: Strip) -> Patch:
    """The patch of triangles given by their corners: equal corners become one vertex."""
    xyz = np.ascontiguousarray(strip.corners, np.float32).reshape(-1, 3)
    with np.errstate(over="ignore"):
        bits = (xyz + np.float32(0)).view(np.uint32).astype(np.uint64)  # -0 is 0
        keys = bits * _MIX
        keys ^= keys >> np.uint64(29)
        keys = keys[:, 0] + keys[:, 1] * _MIX[1] + keys[:, 2] * _MIX[2]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return Patch(
        strip.stamp_ns,
        xyz[first],
        np.asarray(strip.normals, np.float32).reshape(-1, 3)[first],
        np.asarray(strip.depth_sigma, np.float32).ravel()[first],
        None if strip.rgb is None else strip.rgb.reshape(-1, 3)[first],
        inverse.reshape(-1, 3).astype(np.uint32),
    )


def joined(patches: Sequence[Patch]) -> Patch:
    """Several patches as one; without colour unless all have it."""
    counts = [len(patch.vertices) for patch in patches]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.uint32)
    none = np.zeros((0, 3), np.float32)
    rgb = [patch.rgb for patch in patches if patch.rgb is not None]
    faces = [patch.faces + start for patch, start in zip(patches, starts, strict=False)]
    return Patch(
        max((patch.stamp_ns for patch in patches), default=0),
        np.concatenate([none, *(patch.vertices for patch in patches)]),
        np.concatenate([none, *(patch.normals for patch in patches)]),
        np.concatenate([none[:, 0], *(patch.sigma for patch in patches)]),
        np.concatenate(rgb) if rgb and len(rgb) == len(patches) else None,
        np.concatenate([none.astype(np.uint32), *faces]),
    )


def sigma_range(patch: Patch) -> tuple[float, float]:
    """5th and 95th percentile of the known sigmas, metres; (0, 0) if there are none."""
    known = patch.sigma[np.isfinite(patch.sigma) & (patch.sigma > 0)]
    if not len(known):
        return 0.0, 0.0
    low, high = np.percentile(known, [5, 95])
    return float(low), float(high)


def patch_colours(
    patch: Patch, shading: str, sigmas: tuple[float, float] = (0.0, 0.0)
) -> NDArray[np.uint8]:
    """Colours of the vertices.

    Args:
        patch: the surface.
        shading: one of SHADINGS; "colour" is "plain" where there is none.
        sigmas: the depth sigmas, metres, at the two ends of the colour map (viridis), which
            is even in their logarithm.

    Returns:
        (v, 3) uint8, red green blue.
    """
    if shading == "normals":
        return ((np.nan_to_num(patch.normals) * 0.5 + 0.5) * 255).round().clip(0, 255).astype("u1")
    if shading == "colour" and patch.rgb is not None:
        return patch.rgb
    if shading != "depth sigma" or not 0 < sigmas[0] < sigmas[1]:
        return np.broadcast_to(_PLAIN, patch.vertices.shape)
    known = np.isfinite(patch.sigma) & (patch.sigma > 0)
    low, high = np.log(sigmas)
    place = (np.log(np.where(known, patch.sigma, sigmas[0])) - low) / (high - low)
    colours = np.column_stack([np.interp(4 * place, np.arange(5), part) for part in _VIRIDIS.T])
    colours[~known] = _UNKNOWN
    return colours.round().astype(np.uint8)
