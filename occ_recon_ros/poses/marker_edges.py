"""The printed sides of markers: their blur, and corners where two sides meet.

A corner detector sees the corner of a black square pulled inwards by the blur, by a part of its
width. The sides are straight; where two of them cross is not moved.
"""

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array, sampled

_ALONG = np.linspace(0.12, 0.88, 16)  # places along a side, away from its ends
_STEPS = 25
_MOST_PX = 5.0
_OF_A_CELL = 0.8  # of the black rim, beyond which the code begins
_LEAST_PX = 1.2  # a narrower rim has no edge of its own
_LEAST_CONTRAST = 20.0  # grey levels
_CUT = 3.0  # sigmas, for points of a side that something covers
_FEWEST = 6  # points that make a line
_FARTHEST_PX = 3.0  # that a corner may move


def side_profiles(grey: NDArray, quads: Array, cells: int) -> tuple[Array, Array, Array, Array]:
    """Grey levels across the sides of markers.

    Args:
        grey: (h, w) uint8.
        quads: (m, 4, 2) float64, corners of the markers, pixels, clockwise from top left.
        cells: cells along a side, the black rim among them.

    Returns:
        profiles (m, 4, places, steps); where the steps lie (m, 4, steps), pixels outwards;
        the places (m, 4, places, 2), pixels; the outward unit normals (m, 4, 2). Side k leads
        from corner k to corner k + 1.
    """
    start, stop = quads, np.roll(quads, -1, axis=1)
    along = stop - start
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
    outward = np.stack([along[..., 1], -along[..., 0]], axis=2) / length[..., None]
    # The rim as it is seen across this side.
    middle = quads.mean(axis=1, keepdims=True)
    depth = 2 * np.abs(np.einsum("mkd,mkd->mk", start - middle, outward))
    half = np.minimum(_MOST_PX, _OF_A_CELL * depth / cells)
    steps = half[..., None] * np.linspace(-1, 1, _STEPS)
    places = start[:, :, None] + _ALONG[:, None] * along[:, :, None]
    at = places[..., None, :] + steps[:, :, None, :, None] * outward[:, :, None, None]
    return sampled(grey, at[..., 0], at[..., 1]), steps, places, outward


def edge_blur(grey: NDArray, quads: Array, cells: int) -> float:
    """How blurred the sides are, 1 sigma of the blur in pixels; NaN where none can be seen.

    An edge blurred by a Gaussian of width s has a largest slope of its contrast over
    s sqrt(2 pi). Of the two directions of the sides the worse one counts: that is what a moving
    camera smears.
    """
    if not len(quads):
        return float("nan")
    profiles, steps, _, _ = side_profiles(grey, quads, cells)
    slope = np.diff(profiles, axis=3).max(axis=3) / np.diff(steps, axis=2)[:, :, :1]
    contrast = profiles.max(axis=3) - profiles.min(axis=3)
    good = (contrast > _LEAST_CONTRAST) & (slope > 0)
    width = contrast / np.where(good, slope, np.nan) / np.sqrt(2 * np.pi)
    results = [width[:, k::2][good[:, k::2]] for k in (0, 1)]
    return max((float(np.median(w)) for w in results if len(w)), default=float("nan"))


def side_corners(grey: NDArray, quads: Array, cells: int) -> Array:
    """Corners of markers where lines fitted to their sides cross.

    Returns:
        (m, 4, 2) float64, pixels; NaN where a side cannot be fitted (covered, too small).
    """
    if not len(quads):
        return quads.copy()
    profiles, steps, places, outward = side_profiles(grey, quads, cells)
    # The edge is the middle of the slope from black to white.
    rise = np.maximum(np.diff(profiles, axis=3), 0)
    rise = np.where(rise > 0.1 * rise.max(axis=3, keepdims=True), rise, 0)
    total = rise.sum(axis=3)
    middles = (steps[:, :, 1:] + steps[:, :, :-1]) / 2
    offset = (rise * middles[:, :, None]).sum(axis=3) / np.maximum(total, 1e-9)
    ok = (total > _LEAST_CONTRAST) & (steps[:, :, -1:] > _LEAST_PX)
    # offset = a + b t along the side, by least squares, twice: then without what sticks out.
    t = _ALONG - 0.5
    for _ in range(2):
        w = ok.astype(float)
        n, s1, s2 = w.sum(2), (w * t).sum(2), (w * t * t).sum(2)
        y0, y1 = (w * offset).sum(2), (w * t * offset).sum(2)
        det = n * s2 - s1**2
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (s2 * y0 - s1 * y1) / det, (n * y1 - s1 * y0) / det
        rest = np.abs(offset - a[..., None] - b[..., None] * t)
        with np.errstate(invalid="ignore"):
            spread = 1.4826 * np.nanmedian(
                np.where(np.isnan(rest), 1e9, np.where(ok, rest, 0)), axis=2
            )
            ok &= rest <= np.maximum(_CUT * spread, 0.05)[..., None]
    a = np.where(ok.sum(axis=2) >= _FEWEST, a, np.nan)
    # Each line: normal . x = distance.
    first = places[:, :, 0] + (a + b * t[0])[..., None] * outward
    last = places[:, :, -1] + (a + b * t[-1])[..., None] * outward
    run = last - first
    normal = np.stack([run[..., 1], -run[..., 0]], axis=2)
    distance = np.einsum("mkd,mkd->mk", normal, first)
    before, far = np.roll(normal, 1, axis=1), np.roll(distance, 1, axis=1)
    det = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = np.stack(
            [
                (far * normal[..., 1] - distance * before[..., 1]) / det,
                (before[..., 0] * distance - normal[..., 0] * far) / det,
            ],
            axis=2,
        )
        moved = np.linalg.norm(corners - quads, axis=2)
        corners[~(moved < _FARTHEST_PX)] = np.nan
    return corners
