"""Markers of a grid that board.yaml has and the sheet has not, such as a frame around an object.

A marker that no image shows is hidden by the object, or was never printed. Of one that was, the
object leaves parts of its print to be seen, at least beside it; where none was printed, bare paper
is seen where print should be black, and what is missing ends between two markers, not within one.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array, sampled
from occ_recon_ros.imaging.segment import to_uint8

from .board import BoardSpec

_FEWEST_VIEWS = 5  # that must look at a marker
_FEWEST_READ = 4  # markers in an image that say how bright black and white are there
_FEWEST_BLANK = 2  # one alone may be covered by chance
_LEAST_CONTRAST = 15.0  # grey levels between black and white
_DARK, _AS_WHITE = 0.35, 0.3  # of this contrast: black up to so much, white within so much of it
_SEEN_DARK, _SEEN_WHITE = 0.2, 0.3  # share of the views that must see a cell so: some are hidden
_SHOWS, _BARE = 0.1, 0.6  # share of the black cells that are seen black, white: print, paper
_EVENLY_DARK = 0.5  # of that, black among the white cells: what covers them is dark, no print
_MOSTLY_BLANK = 0.5  # share of the markers that are missing that must show paper
_WHOLE = 0.7  # share of the markers beside them that must be whole


@dataclass(frozen=True)
class MissingMarkers:
    """Markers of board.yaml that are seen in no image.

    Attributes:
        blank: numbers of those that are not printed.
        unread: numbers of all that show no print, those that are hidden among them.
    """

    blank: tuple[int, ...] = ()
    unread: tuple[int, ...] = ()


def missing_markers(
    board: BoardSpec, read: Collection[int], views: Iterable[tuple[NDArray, Camera, NDArray]]
) -> MissingMarkers:
    """Which markers of a grid are not there.

    Args:
        board: an aruco_grid; of other boards nothing is said.
        read: numbers of the markers that were read in any image.
        views: images, (h, w) or (h, w, 3) BGR, their cameras in the board's frame, and the numbers
            of the markers that were read in each.
    """
    never = ~np.isin(board.marker_ids, list(read)) & ~np.isin(board.marker_ids, board.not_printed)
    if board.kind != "aruco_grid" or np.count_nonzero(never) < _FEWEST_BLANK:
        return MissingMarkers()
    white = _white_cells(board)
    looked, darks, bares = np.zeros((3, *white.shape), np.intp)
    for image, camera, ids in views:
        within, relative = _brightness(board, white, image, camera, ids)
        looked += within
        darks += within & (relative.max(axis=2) < _DARK)
        bares += within & (np.abs(relative - 1).max(axis=2) < _AS_WHITE)
    enough = looked >= _FEWEST_VIEWS
    dark = enough & (darks > np.maximum(bares, _SEEN_DARK * looked))
    bare = enough & (bares > np.maximum(darks, _SEEN_WHITE * looked))
    black_seen, white_dark, paper = (
        _share(a, b) for a, b in ((dark, ~white), (dark, white), (bare, ~white))
    )
    shows = (black_seen >= _SHOWS) & (white_dark < _EVENLY_DARK * black_seen)
    unread, cut = never & ~shows & enough.all(axis=1), never & shows
    count = np.count_nonzero(unread)
    if count < _FEWEST_BLANK or _whole_beside(board, unread, cut) < _WHOLE:
        return MissingMarkers()
    names = tuple(board.marker_ids[unread | (cut & _amid(board, never))].tolist())
    blank, lit = (np.count_nonzero(unread & w) for w in (paper >= _BARE, white_dark < _BARE))
    if blank >= max(_FEWEST_BLANK, _MOSTLY_BLANK * count):
        return MissingMarkers(names, names)
    # Where it is all dark a dark object stands.
    return MissingMarkers((), names if lit >= _FEWEST_BLANK else ())


def in_words(numbers: Collection[int]) -> str:
    """Numbers in words: "6-8, 11"."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in runs)


def _white_cells(board: BoardSpec) -> NDArray[np.bool_]:
    """(m, cells * cells) of each marker, row by row, its black rim included: which are white."""
    cells = board.aruco_dictionary.markerSize + 2
    images = [
        cv2.aruco.generateImageMarker(board.aruco_dictionary, int(number), cells).ravel() > 0
        for number in board.marker_ids
    ]
    return np.asarray(images, np.bool_)


def _brightness(
    board: BoardSpec,
    white: NDArray[np.bool_],
    image: NDArray,
    camera: Camera,
    ids: NDArray,
) -> tuple[NDArray[np.bool_], Array]:
    """(m, k) whether the middle of each cell is in an image, and (m, k, channels) how bright it is
    there: 0 black to 1 white, by the markers that were read in this image."""
    count = round(np.sqrt(white.shape[1]))
    along = (np.arange(count) + 0.5) / count * board.marker_m
    cell = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    on_sheet = board.sheet_markers[:, :1] + cell
    uv = camera.project(board.from_sheet(on_sheet.reshape(-1, 2))).reshape(*white.shape, 2)
    size = np.array([camera.width, camera.height])
    within = np.asarray(((uv > 0) & (uv < size - 1)).all(axis=2))
    pixels = to_uint8(image)
    u, v = np.moveaxis(np.where(within[..., None], uv, 0.0), 2, 0)
    seen = sampled(pixels.reshape(*pixels.shape[:2], -1), u, v)
    known = within & np.isin(board.marker_ids, ids)[:, None]
    if np.count_nonzero(known.any(axis=1)) < _FEWEST_READ:
        return np.zeros_like(within), np.zeros_like(seen)
    # Planes over the sheet, of black and of white.
    plane = np.concatenate([np.ones((*white.shape, 1)), on_sheet / max(board.size_m)], axis=2)
    x_black, x_white = (
        np.linalg.lstsq(plane[known & which], seen[known & which], rcond=None)[0]
        for which in (~white, white)
    )
    black, contrast = plane @ x_black, plane @ (x_white - x_black)
    return within, (seen - black) / np.maximum(contrast, _LEAST_CONTRAST)


def _share(which: NDArray[np.bool_], among: NDArray[np.bool_]) -> Array:
    """(m,) share of the cells of each marker that are so, among some of them."""
    found: Array = (which & among).sum(axis=1) / np.maximum(among.sum(axis=1), 1)
    return found


def _whole_beside(board: BoardSpec, missing: NDArray[np.bool_], cut: NDArray[np.bool_]) -> float:
    """Share of the markers above, below and beside missing ones that the object does not cut.

    What stands on print hides its own outline of it, and so parts of most markers around.
    """
    around = (_beside(board, missing) > 0) & ~missing
    return float(1 - cut[around].mean()) if around.any() else 0.0


def _amid(board: BoardSpec, never: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(m,) markers beside which more are missing than are not: a part of the object looks like
    print there."""
    return np.asarray(_beside(board, never) > _beside(board, ~never))


def _beside(board: BoardSpec, which: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(m,) how many of the markers above, below and beside each are so."""
    grid = np.pad(which.reshape(board.rows, board.columns).astype(np.intp), 1)
    count = grid[:-2, 1:-1] + grid[2:, 1:-1] + grid[1:-1, :-2] + grid[1:-1, 2:]
    return np.asarray(count.ravel())
