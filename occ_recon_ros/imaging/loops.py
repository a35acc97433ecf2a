"""A binary mask to its closed outlines, holes included."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from .curves import normals, perimeter, resample, signed_area

Array = NDArray[np.floating]

_STAIR_SIGMA = 2.0
_SMALLEST_PART = 0.02


def mask_loops(
    mask: NDArray[np.uint8], min_loop_px: float, spacing_px: float, least_hole: float = 0.0
) -> list[Array]:
    """Outlines of the object in a mask, to about half a pixel, evenly sampled.

    Specks and holes shorter than ``min_loop_px`` and parts smaller than a fiftieth of the
    largest are left out.

    Args:
        mask: (h, w) uint8, 0 = background.
        min_loop_px: shortest loop kept, px.
        spacing_px: distance of the samples, px.
        least_hole: of the area of the part that it is in; smaller holes are left out.

    Returns:
        One (n, 2) float64 array a loop, pixels, outer loops first by size, walked with the
        object on the left as displayed.
    """
    x, y, width, height = cv2.boundingRect(mask)
    part = mask[y : y + height, x : x + width]
    chains, tree = cv2.findContours(part, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE, offset=(x, y))
    if tree is None:
        return []
    parents = tree.reshape(-1, 4)[:, 3]
    areas = np.array([cv2.contourArea(chain) for chain in chains])
    big = (parents >= 0) | _parts(chains, areas, parents < 0, mask.shape[:2])
    found = []
    for i in np.argsort(-areas, kind="stable"):
        hole = parents[i] >= 0
        if not big[i] or len(chains[i]) < 0.6 * min_loop_px:
            continue
        around = parents[i]
        if hole and (not big[around] or areas[i] < least_hole * areas[around]):
            continue
        points = _off_the_grid(chains[i].reshape(-1, 2).astype(np.float64), hole)
        if points is not None and perimeter(points) >= min_loop_px:
            found.append((bool(hole), resample(points, spacing_px)))
    return [p for hole, p in found if not hole] + [p for hole, p in found if hole]


def _parts(
    chains: Sequence[NDArray], areas: Array, outer: NDArray[np.bool_], shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Which chains are the outer loops of the object: the largest part, counting one that
    lies along the border for less, and the like that keep clear of the border."""
    edge = _shares_on_border(chains, shape)
    worth = np.where(outer, areas * (1 - edge) ** 2, 0.0)
    kept = outer & (edge == 0) & (areas >= _SMALLEST_PART * worth.max())
    kept[np.argmax(worth)] = worth.max() > 0
    return kept


def _shares_on_border(chains: Sequence[NDArray], shape: tuple[int, ...]) -> Array:
    x, y = np.concatenate([chain.reshape(-1, 2) for chain in chains]).T
    on = (x == 0) | (y == 0) | (x == shape[1] - 1) | (y == shape[0] - 1)
    lengths = np.array([len(chain) for chain in chains])
    return np.asarray(np.add.reduceat(on, np.cumsum(lengths) - lengths, dtype=np.intp) / lengths)


def _off_the_grid(chain: Array, hole: bool) -> Array | None:
    """The chain of object pixels, turned with the object on the left, smoothed and moved out
    to the border between object and background pixels."""
    if (signed_area(chain) > 0) != hole:
        chain = chain[::-1]
    points = gaussian_filter1d(chain, _STAIR_SIGMA, axis=0, mode="wrap")
    moved = points + 0.5 * normals(points, reach=2)
    return moved if abs(signed_area(moved)) > 4.0 else None
