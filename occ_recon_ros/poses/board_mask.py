"""Where a board is seen in an image, and the object that stands before it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging.segment import to_uint8

from .board import BoardSpec
from .board_print import brightness_levels, place_on, print_cells

Mask = NDArray[np.uint8]

_CELLS = 1024  # of the table of what is black, on its longer side
_PRINT_PX = 1.5  # blur of the print in the image, and what poses and paper may be off
_TOLERANCE = 0.25  # of the contrast of the print
_COLOURED = 0.25  # of it between two colours: print has none
_DARKEST_SHADOW = 0.2  # of the light
_MARGIN = 0.1  # of the board's longer side: white paper around the pattern
_LEAST_CONTRAST = 15.0  # grey levels; less is no print
_WINDOW = 1.0  # squares; in so much of the print there is black and white
_SURE = 0.9  # share of a window that is not as printed, within an object
_GAPS = 0.75  # squares, between two black ones before an object
_CUT_PX = 400  # the cut works on images no wider
_CUT_ROUNDS = 3


def board_seen(image: NDArray, camera: Camera, board: BoardSpec) -> tuple[Mask, Mask]:
    """Pixels that lie on the board's plane, and those of them that show the board.

    The print is drawn as the camera must see it and compared with the image, colour by colour,
    for black and white whose brightness changes evenly over the sheet.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8.
        camera: the view, its pose in the board's frame.
        board: the print.

    Returns:
        (h, w) uint8 each, 255 or 0: within the pattern; as printed there, or white beside it.
    """
    printed, place = print_cells(board, _CELLS), place_on(board, camera, _CELLS)
    x, y, inside = place.x, place.y, place.inside
    light = cv2.remap(printed, x, y, cv2.INTER_LINEAR, borderValue=1.0)
    light = cv2.GaussianBlur(light, (0, 0), _PRINT_PX)
    size = 2 * int(np.ceil(_PRINT_PX)) + 1
    low, high = (f(light, np.ones((size, size), np.uint8)) for f in (cv2.erode, cv2.dilate))
    margin, (rows, columns) = _MARGIN * _CELLS, printed.shape
    near = (x > -margin) & (y > -margin) & (x < columns + margin) & (y < rows + margin)
    nothing = np.zeros(inside.shape, np.uint8)
    relative = []
    for values in np.moveaxis(image.reshape(*image.shape[:2], -1).astype(np.float32), 2, 0):
        black, white = brightness_levels(values, light, place)
        contrast = white - black
        if not np.median(contrast[inside]) > _LEAST_CONTRAST:
            return _as_mask(inside), nothing
        relative.append((values - black) / np.maximum(contrast, _LEAST_CONTRAST))
    brightest, darkest = np.max(relative, axis=0), np.min(relative, axis=0)
    shows = near & (brightest < high + _TOLERANCE) & (brightest - darkest < _COLOURED)
    # A shadow darkens what is white, and all colours alike.
    shows &= darkest > _DARKEST_SHADOW * low - _TOLERANCE * (1 - low)
    # Of the paper around the pattern nobody knows how wide it is.
    shows &= inside | (darkest > 1 - _TOLERANCE)
    return _as_mask(inside), _as_mask(shows)


def object_mask(image: NDArray, camera: Camera, board: BoardSpec) -> Mask:
    """The object that stands on a board, 255; the board itself and its edges are background.

    What hides the print is object. Between that and the print that shows, and beyond the board,
    a cut by colours decides (Rother, Kolmogorov, Blake, "GrabCut", 2004,
    doi:10.1145/1015706.1015720). An object as white and black as the print is not told from it.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        camera: the view, its pose in the board's frame.
        board: the print.

    Returns:
        (h, w) uint8, 0 = background; without an object, or a board, all 0.
    """
    image = to_uint8(image)
    inside, shows = board_seen(image, camera, board)
    nothing = np.zeros(inside.shape, np.uint8)
    if not shows.any():
        return nothing
    # An object that is like black print differs from the white beside it, and the other way
    # round: what share of a square's surroundings is not as printed says where the object is.
    square_px = board.pitch_m * np.sqrt(cv2.countNonZero(inside) / np.prod(board.size_m))
    differs: NDArray = cv2.bitwise_and(inside, cv2.bitwise_not(shows))
    differs = cv2.morphologyEx(differs, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    share = _share(differs, inside, square_px)
    if share[differs > 0].max(initial=0) < _SURE:
        # Grey as light and shadow on paper: it is seen before what is black alone.
        differs = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, _disc(_GAPS * square_px))
        share = _share(differs, inside, square_px)
        beside = cv2.dilate(differs, _disc(_GAPS * square_px))
        shows = _as_mask((shows > 0) & (beside == 0))
    scale = min(1.0, _CUT_PX / max(image.shape[:2]))
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    hides, likely, seen = (
        cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
        for mask in (
            _as_mask((differs > 0) & (share > _SURE / 2)),
            _as_mask((differs > 0) & (share > _SURE)),
            _as_mask((shows > 0) & (share < _SURE / 2)),
        )
    )
    sure = cv2.erode(likely, np.ones((3, 3), np.uint8)) > 127
    if not sure.any():
        return nothing
    labels = np.full(size[::-1], cv2.GC_PR_BGD, np.uint8)
    labels[hides > 127] = cv2.GC_PR_FGD
    labels[sure] = cv2.GC_FGD
    labels[seen > 127] = cv2.GC_BGD
    labels[:1], labels[-1:], labels[:, :1], labels[:, -1:] = (cv2.GC_BGD,) * 4
    colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    colour = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    nowhere = (0, 0, 0, 0)  # the rectangle is not used
    cv2.setRNGSeed(0)  # the same image gives the same mask
    cv2.grabCut(colour, labels, nowhere, background, foreground, _CUT_ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = _largest(_as_mask((labels & 1) == 1))
    smooth = cv2.resize(found, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return _as_mask(smooth > 127)


def _share(differs: NDArray, inside: NDArray, square_px: float) -> NDArray:
    """Share of the print around each pixel that is not as printed."""
    window = (2 * round(_WINDOW * square_px / 2) + 1,) * 2
    there = np.maximum(cv2.boxFilter(inside.astype(np.float32), -1, window), 1.0)
    share: NDArray = cv2.boxFilter(differs.astype(np.float32), -1, window) / there
    return share


def _disc(radius: float) -> Mask:
    size = 2 * max(1, round(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8)


def _largest(found: Mask) -> Mask:
    """The largest piece, without specks in it or on it."""
    square = np.ones((3, 3), np.uint8)
    clean = cv2.morphologyEx(found, cv2.MORPH_OPEN, square)
    clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, square)
    count, pieces, facts, _ = cv2.connectedComponentsWithStats(clean)
    if count < 2:
        return np.zeros_like(found)
    return _as_mask(pieces == 1 + int(facts[1:, cv2.CC_STAT_AREA].argmax()))


def _as_mask(which: NDArray[np.bool_]) -> Mask:
    return which.astype(np.uint8) * np.uint8(255)
