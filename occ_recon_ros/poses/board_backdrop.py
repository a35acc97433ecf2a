"""A printed board as a backdrop that is known: what each pixel shows where nothing hides it."""

import functools
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging.segment import to_uint8

from .board import BoardSpec
from .board_print import Place, blank_cells, brightness_levels, place_on, print_cells

_CELLS = 2048  # of the table of what is black, on its longer side
_BLURS_PX = (0.35, 0.6, 0.9, 1.3, 1.8, 2.6)  # tried, 1 sigma
_FINE_PX = 1200  # on the longer side; smaller images are drawn larger and made small
_LEAST_SPREAD, _MOST_SPREAD = 2.5, 25.0  # grey levels
_FLAT, _STEEP = 4.0, 30.0  # grey levels a pixel
_LEAST_SHIFT_PX, _MOST_SHIFT_PX = 0.05, 1.0  # of the edges of the print
_WINDOW = 0.7  # squares, around a pixel, in which print in a shadow is looked for
_ALIKE, _TELLING = 0.88, 25.0  # correlation with the print, and grey levels of its contrast, least
_DARKEST = 0.25  # share of the light in a shadow
_OF_SHADOW = 0.15  # of what it takes away, that it is not known better
_MARGINS = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06)  # of the print's longer side, of white paper
_AS_WHITE, _MOSTLY = 30.0, 0.75  # grey levels from white; share of a ring that is as white
_HALF = 0.5  # of the places without markers that must be white as paper; an object hides the rest
_MEAN = np.full((1, 3), 1 / 3, np.float32)  # of the channels
_EDGE_PX = 1  # reach of the black and white edges in which blur shows


class BoardBackdrop:
    """Draws a board as a camera must see it, in the light in which it lies.

    Args:
        board: the print, in the plane z = 0 of the object frame.

    Attributes:
        size: width and height of the print, metres.
    """

    def __init__(self, board: BoardSpec) -> None:
        self.size = board.size_m
        self._board = board

    def picture(
        self, image: NDArray, camera: Camera
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The print in an image, as if nothing hid it.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, its pose in the board's frame.

        Returns:
            (h, w, 3) float32 BGR, grey levels, and their spread (h, w) float32, infinite off
            the print or where the print cannot be told.
        """
        pixels = to_uint8(image)
        colour = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)
        place = place_on(self._board, camera, _CELLS)
        inside = place.inside
        picture = np.zeros(colour.shape, np.float32)
        spread = np.full(colour.shape[:2], np.inf, np.float32)
        if np.count_nonzero(inside) < 100:
            return picture, spread
        sharp, blur = self._light(place, colour)
        light = np.asarray(cv2.GaussianBlur(sharp, (0, 0), blur), np.float32)
        blank = self._blank(place)
        picture = _drawn(colour, light, replace(place, inside=inside & ~blank))
        foreign = blank & (not _mostly_white(colour, picture, blank))
        if blank.any() and not foreign.any():
            picture = _drawn(colour, light, place)
        left = self._shadow(colour, picture, inside)
        picture *= left[..., None]
        steep = gradient(picture)
        spread[inside] = self._spread(_off(colour, picture), steep, inside)[inside]
        paper = self._paper(place, colour, picture)
        shaded = _OF_SHADOW * (1 - left) * _most(picture)
        spread = np.hypot(spread, shaded).astype(np.float32)
        spread[paper] = spread[inside].min()
        # Along its border nobody knows how the sheet goes on.
        sheet = ((inside & ~foreign) | paper).astype(np.uint8)
        spread[cv2.erode(sheet, np.ones((5, 5), np.uint8)) == 0] = np.inf
        return picture, spread

    def _blank(self, place: Place) -> NDArray[np.bool_]:
        """(h, w) where markers are not printed."""
        if not self._board.not_printed:
            return np.zeros(place.inside.shape, np.bool_)
        table = blank_cells(self._board, _CELLS)
        blank = cv2.remap(table, place.x, place.y, cv2.INTER_NEAREST, borderValue=0)
        return np.asarray((blank > 0) & place.inside)

    def _paper(
        self, place: Place, colour: NDArray[np.uint8], picture: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """(h, w) white paper around the print, as far as most of it is seen."""
        (rows, columns), x, y = print_cells(self._board, _CELLS).shape, place.x, place.y
        away = np.maximum(np.abs(x - columns / 2) - columns / 2, np.abs(y - rows / 2) - rows / 2)
        white = _off(colour, picture) < _AS_WHITE
        found = np.zeros(white.shape, np.bool_)
        for width in _MARGINS:
            ring = (away > -1) & (away <= width * _CELLS) & ~found
            if not ring.any() or white[ring].mean() < _MOSTLY:
                break
            found |= ring
        return found

    def _shadow(
        self, colour: NDArray[np.uint8], picture: NDArray[np.float32], inside: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """(h, w) share of the light that is left in a shadow: there the print still shows, black
        and white alike darker, as it does not on an object of any colour."""
        grey, drawn = (cv2.transform(a.astype(np.float32), _MEAN) for a in (colour, picture))
        there = inside.astype(np.float32)
        square = np.sqrt(np.count_nonzero(inside) / np.prod(self.size)) * self._board.pitch_m
        window = (2 * round(_WINDOW * square / 2) + 1,) * 2
        n = np.maximum(cv2.boxFilter(there, -1, window), 1e-3)

        def mean(a: NDArray) -> NDArray:
            return np.asarray(cv2.boxFilter(a * there, -1, window) / n)

        across, along, both = mean(grey * grey), mean(drawn * drawn), mean(grey * drawn)
        i, p = mean(grey), mean(drawn)
        covariance, power = both - i * p, np.maximum(along - p * p, 1.0)
        alike = covariance / np.sqrt(power * np.maximum(across - i * i, 1.0))
        slope = covariance / power
        trust = (alike > _ALIKE) & (slope > _DARKEST) & (n > 0.5) & (power > _TELLING**2)
        weight = trust.astype(np.float32)
        size = (window[0], window[0])
        known = cv2.blur(weight, size)
        light = cv2.blur(weight * np.clip(slope, 0, 1), size) / np.maximum(known, 1e-3)
        # At the border of a shadow the better of the two.
        shaded = (known > 1e-2) & (np.abs(grey - light * drawn) < np.abs(grey - drawn))
        return np.where(shaded, light, 1.0).astype(np.float32)

    def _spread(self, off: NDArray, steep: NDArray, inside: NDArray[np.bool_]) -> NDArray:
        """(h, w) grey levels by which the print is not quite as drawn: everywhere, and along its
        edges, which are not quite where they are drawn."""
        flat, edge = inside & (steep < _FLAT), inside & (steep > _STEEP)
        noise = 1.4826 * float(np.median(off[flat])) if flat.any() else _MOST_SPREAD
        shift = 1.4826 * float(np.median(off[edge] / steep[edge])) if edge.any() else 0.0
        shift = min(max(shift, _LEAST_SHIFT_PX), _MOST_SHIFT_PX)
        return np.hypot(np.clip(noise, _LEAST_SPREAD, _MOST_SPREAD), shift * steep)

    def _light(self, place: Place, colour: NDArray[np.uint8]) -> tuple[NDArray[np.float32], float]:
        """The print before the lens blurs it, 0 black to 1 white, and the blur, px."""
        inside, (height, width) = place.inside, place.inside.shape
        fine = max(1, round(_FINE_PX / max(width, height)))
        columns, rows = (
            cv2.resize(at, (fine * width, fine * height), interpolation=cv2.INTER_LINEAR)
            for at in (place.x, place.y)
        )
        light = cv2.remap(
            print_cells(self._board, _CELLS), columns, rows, cv2.INTER_LINEAR, borderValue=1.0
        )
        light = cv2.resize(light, (width, height), interpolation=cv2.INTER_AREA)
        grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(np.float32)
        square = np.ones((2 * _EDGE_PX + 1,) * 2, np.uint8)
        edge = (cv2.dilate(light, square) - cv2.erode(light, square) > 0.5) & inside
        if np.count_nonzero(edge) < 100:
            return np.asarray(light, np.float32), _BLURS_PX[1]
        black, white = np.quantile(grey[inside], [0.1, 0.9])

        def misfit(blur: float) -> float:
            drawn = black + (white - black) * cv2.GaussianBlur(light, (0, 0), blur)[edge]
            return float(np.median(np.abs(grey[edge] - drawn)))

        return np.asarray(light, np.float32), min(_BLURS_PX, key=misfit)


def _drawn(
    colour: NDArray[np.uint8], light: NDArray[np.float32], place: Place
) -> NDArray[np.float32]:
    """(h, w, 3) the print, ``light`` 0 black to 1 white, as bright as it is seen inside."""
    channels = []
    for values in np.moveaxis(colour.astype(np.float32), 2, 0):
        black, white = brightness_levels(values, light, place)
        channels.append(black + light * (white - black))
    return np.stack(channels, axis=2)


def _mostly_white(
    colour: NDArray[np.uint8], picture: NDArray[np.float32], blank: NDArray[np.bool_]
) -> bool:
    """Whether blank places look as white as drawn: they may be cut out, or hold a picture."""
    off = _off(colour, picture)[blank]
    return bool(np.mean(off < _AS_WHITE) > _HALF) if len(off) else False


def _most(of: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) the largest of the channels of (h, w, 3)."""
    return np.asarray(functools.reduce(cv2.max, cv2.split(of)), np.float32)


def _off(colour: NDArray[np.uint8], picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) grey levels, in the worst channel, between what is seen and drawn, (h, w, 3)."""
    return _most(np.abs(colour - picture))


def gradient(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) grey levels a pixel by which (h, w, 3) changes, most."""
    du, dv = cv2.Sobel(picture, cv2.CV_32F, 1, 0), cv2.Sobel(picture, cv2.CV_32F, 0, 1)
    return np.asarray(np.sqrt(_most(du * du + dv * dv)) / 8)
