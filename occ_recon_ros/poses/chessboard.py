"""Plain chessboards in an image: one whose size is known, or any."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

from .saddles import refine_saddles

Image = NDArray[np.uint8]

_REACH = 0.4  # squares around a corner without another one
_LEAST = (4, 4)  # inner corners: fewer are found in any pattern
_LOOKED_AT_PX = 1000  # long side in which what is not found at once is looked for
_CLOSER_PX = 2000  # then in this one
_LOOK_TRUE = 0.9  # share of the corners that look like the corner of four squares
_SQUARE_PX = 16  # side of the squares in which something is looked for
_EMPTY, _FULL = 0.4, 0.25  # of the contrast, in the middle of a square; share of the squares
_QUICK = cv2.CALIB_CB_NORMALIZE_IMAGE
_PATIENT = _QUICK | cv2.CALIB_CB_EXHAUSTIVE
_CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


def find_chessboard(grey: Image, corners: Array, columns: int, thorough: bool) -> Array:
    """The inner corners of a whole chessboard, to a fraction of a pixel.

    Args:
        grey: (h, w) uint8.
        corners: (n, 3) float64, where they are on the board, row by row, metres.
        columns: of them in a row.
        thorough: where OpenCV's newer detector (Duda and Frese, BMVC 2018) finds none at once,
            look again with more patience, and by the older one, which bears more bending by a
            lens. Takes up to ten times as long where there is none.

    Returns:
        (n, 2) float64 pixels in the order of ``corners``, so that the first square is black where
        the board has one such end; (0, 2) where there is none.
    """
    size = (columns, len(corners) // columns)
    found, uv = cv2.findChessboardCornersSB(grey, size, flags=_QUICK)
    if found:
        return refine_saddles(grey, _ordered(grey, uv, size), corners[:, :2], _REACH)[0]
    for uv in _sought(grey, size) if thorough else ():
        better, good = refine_saddles(grey, _ordered(grey, uv, size), corners[:, :2], _REACH)
        if good.mean() >= _LOOK_TRUE:
            return better
    return np.zeros((0, 2))


def _sought(grey: Image, size: tuple[int, int]) -> Iterator[NDArray]:
    """What may be the corners, (n, 1, 2) pixels, by one detector after the other."""
    for most in (_LOOKED_AT_PX, _CLOSER_PX):
        image, scale = made_small(grey, most)
        found, uv = cv2.findChessboardCorners(image, size, flags=_CLASSIC)
        if not found and most == _LOOKED_AT_PX:
            found, uv = cv2.findChessboardCornersSB(image, size, flags=_PATIENT)
        if found:
            yield (np.asarray(uv, np.float64) + 0.5) / scale - 0.5
        if scale == 1.0:
            return


def made_small(grey: Image, most: int) -> tuple[Image, float]:
    """An image (h, w) uint8 of at most so many pixels along its longer side, and its size over
    what it was."""
    scale = min(1.0, most / max(grey.shape))
    if scale == 1.0:
        return grey, scale
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), scale


def _ordered(grey: Image, uv: NDArray, size: tuple[int, int]) -> Array:
    """Corners (n, 1, 2) as found in the order of the board, (n, 2).

    OpenCV's order may begin at either end. The square left of and above the first inner corner
    is black, which that at the other end is not, if the board has one such end.
    """
    grid = np.asarray(uv, np.float64).reshape(size[1], size[0], 2)
    right, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    if right[0] * down[1] < right[1] * down[0]:  # must turn clockwise on the screen
        grid = grid[:, ::-1]
    inner = [grid[:2, :2], grid[::-1, ::-1][:2, :2]]
    light = []
    for cell in inner:
        # The square beside the first corner along the diagonal has the colour of the one before
        # it: diagonal squares are alike.
        u, v = np.rint(cell.reshape(-1, 2).mean(axis=0)).astype(int)
        light.append(float(grey[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].mean()))
    if sum(size) % 2 and light[1] < light[0]:
        grid = grid[::-1, ::-1]
    return grid.reshape(-1, 2)


def squares_in_view(image: Image, plain: bool = False) -> tuple[int, int] | None:
    """How many squares the chessboard in an image has, the longer side first; None: none is.

    Args:
        image: (h, w) uint8.
        plain: squares that hold something, as those of a ChArUco board do, are none.
    """
    small, _ = made_small(image, _LOOKED_AT_PX)
    how = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
    found, corners, cells = cv2.findChessboardCornersSBWithMeta(small, _LEAST, flags=how)
    if not found:
        return None
    if plain and _hold_something(small, np.asarray(corners).reshape(*np.shape(cells), 2)):
        return None
    rows, columns = sorted(np.shape(cells))
    return columns + 1, rows + 1


def _hold_something(grey: NDArray, corners: NDArray) -> bool:
    """Whether there is something in many squares between corners, (rows, columns, 2) px."""
    rows, columns = corners.shape[:2]
    y, x = np.mgrid[:rows, :columns]
    lattice = _SQUARE_PX * np.column_stack([x.ravel(), y.ravel()]).astype(np.float32)
    H, _ = cv2.findHomography(corners.reshape(-1, 2).astype(np.float32), lattice)
    if H is None:
        return False
    size = (_SQUARE_PX * (columns - 1), _SQUARE_PX * (rows - 1))
    flat = cv2.warpPerspective(grey, H, size).astype(np.float64)
    cells = flat.reshape(rows - 1, _SQUARE_PX, columns - 1, _SQUARE_PX).swapaxes(1, 2)
    rim = _SQUARE_PX // 4  # beside the edges of the square itself
    inner = cells[:, :, rim:-rim, rim:-rim]
    spread = inner.std(axis=(2, 3))
    return bool(np.mean(spread > _EMPTY * flat.std()) > _FULL)
