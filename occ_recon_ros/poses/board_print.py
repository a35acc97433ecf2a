"""The print of a board in a view: where on the sheet each pixel lies, how bright it is there."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import robust_sigma

from .board import BoardSpec

_GRID_PX = 16  # the map from image to board is evaluated so often, linear between
_THOUSAND = np.float32(1000)  # cells, as the unit that planes are fitted in
_SAMPLES, _ROUNDS = 10_000, 10  # pixels, and rounds, that tell how bright black and white are
_GREY_LEVELS = 4.0  # no print is more even than this


@dataclass(frozen=True)
class Place:
    """Where the pixels of a view lie on the sheet.

    Attributes:
        x, y: (h, w) float32, cells to the right of and below the first cell's middle; far away
            where a pixel sees no plane.
        inside: (h, w) within the pattern.
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    inside: NDArray[np.bool_]


def place_on(board: BoardSpec, camera: Camera, cells: int) -> Place:
    """Where the pixels of a view, its pose in the board's frame, lie on the board, so many cells
    along its longer side."""
    width, height = (length * cells / max(board.size_m) for length in board.size_m)
    xy = _on_the_plane(camera) * np.float32(cells / max(board.size_m))
    x, y = xy[..., 0] + np.float32(width / 2 - 0.5), np.float32(height / 2 - 0.5) - xy[..., 1]
    return Place(x, y, (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1))


@cache
def print_cells(board: BoardSpec, cells: int) -> NDArray[np.float32]:
    """(rows, columns) the print from above, so many cells along its longer side: 0 black to 1
    white, each cell the mean of what it covers."""
    cell = max(board.size_m) / cells
    width, height = board.size_m
    table = np.ones((round(height / cell), round(width / cell)), np.float32)
    for left, top, right, bottom in board.black / cell:
        rows, down = _covered(top, bottom, table.shape[0])
        columns, across = _covered(left, right, table.shape[1])
        table[rows, columns] -= down[:, None] * across
    return np.clip(table, 0, 1)


@cache
def blank_cells(board: BoardSpec, cells: int) -> NDArray[np.uint8]:
    """(rows, columns) 1 where markers are not printed, and halfway to their neighbours."""
    cell = max(board.size_m) / cells
    table = np.zeros(print_cells(board, cells).shape, np.uint8)
    half = 0.5 * board.gap_m
    for corners in board.sheet_markers[np.isin(board.marker_ids, board.not_printed)]:
        left, top = np.maximum(np.rint((corners[0] - half) / cell).astype(int), 0)
        right, bottom = np.rint((corners[2] + half) / cell).astype(int)
        table[top:bottom, left:right] = 1
    return table


def brightness_levels(values: NDArray, light: NDArray, place: Place) -> tuple[NDArray, NDArray]:
    """How bright black and white are, everywhere: planes over the sheet, fitted to what is there
    by iterated weights (Geman and McClure) that the object has no part in.

    Args:
        values: (h, w) float32, grey levels of the image.
        light: (h, w) float32, the print in it, 0 black to 1 white.
        place: of its pixels.

    Returns:
        (h, w) float32 each, grey levels of black and of white.
    """
    v, u = np.nonzero(place.inside)
    some = slice(None, None, max(1, len(v) // _SAMPLES))
    v, u = v[some], u[some]
    seen, p = values[v, u], light[v, u]
    if not len(seen):
        return np.zeros_like(values), np.zeros_like(values)
    x, y = place.x[v, u] / _THOUSAND, place.y[v, u] / _THOUSAND
    plane = np.column_stack([np.ones(len(v)), x, y])
    A = np.concatenate([plane * (1 - p)[:, None], plane * p[:, None]], axis=1)
    rest = seen - np.where(p < 0.5, *np.quantile(seen, [0.05, 0.95]))
    for _ in range(_ROUNDS):
        scale = max(robust_sigma(rest), _GREY_LEVELS)
        weighted = A * (1 / (1 + (rest / scale) ** 2) ** 2)[:, None]
        found = np.linalg.lstsq(weighted.T @ A, weighted.T @ seen, rcond=None)[0]
        rest = seen - A @ found
    flat, across, down = found.reshape(2, 3).astype(np.float32).T
    across, down = across / _THOUSAND, down / _THOUSAND

    def plane_of(k: int) -> NDArray[np.float32]:
        return np.asarray(flat[k] + across[k] * place.x + down[k] * place.y)

    return plane_of(0), plane_of(1)


def _on_the_plane(camera: Camera) -> NDArray[np.float32]:
    """(h, w, 2) float32: where the ray of each pixel meets z = 0; far away where it does not."""
    columns, rows = (-(-length // _GRID_PX) + 1 for length in (camera.width, camera.height))
    v, u = _GRID_PX * np.mgrid[:rows, :columns].astype(np.float64)
    rays = camera.viewing_directions(np.column_stack([u.ravel(), v.ravel()]))
    # Homogeneous: x, y and the depth's inverse are linear in the image but for the distortion.
    C = camera.centre
    down = rays[:, 2:] / np.linalg.norm(rays, axis=1, keepdims=True)
    planar = C[2] * rays[:, :2] - C[:2] * down
    forward = rays @ camera.R_camera_object[2]
    grid = np.concatenate([planar, down], axis=1) / forward[:, None]
    grid = grid.reshape(rows, columns, 3).astype(np.float32)
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float32) / _GRID_PX
    dense = cv2.remap(grid, u, v, cv2.INTER_LINEAR)
    downward = dense[..., 2:] < -1e-6
    met = np.where(downward, -dense[..., :2] / np.where(downward, dense[..., 2:], 1), 1e6)
    return np.asarray(met, np.float32)


def _covered(first: float, last: float, count: int) -> tuple[slice, NDArray[np.float32]]:
    """The cells that an interval touches, and the share of each that it covers."""
    low, high = max(0, int(np.floor(first))), min(count, int(np.ceil(last)))
    at = np.arange(low, high)
    share = np.minimum(at + 1, last) - np.maximum(at, first)
    return slice(low, high), np.clip(share, 0, 1).astype(np.float32)
