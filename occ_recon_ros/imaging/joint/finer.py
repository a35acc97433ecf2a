"""A mask of the size of the joint pass, found again in the whole image."""

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import colour_bins, histogram, probability
from .cuts import cut_image
from .evidence import as_known, before_known
from .regions import Mask, grown, shrunk, square
from .scenes import Scene

BODY = 6.0  # nats by which the body speaks, away from its outline: more than any colour
STIFFNESS = 4.0  # nats a pixel of outline where there is no edge

_BAND, _LEAST_BAND = 2.0, 1.5  # pixels of the small image about its outline, and of the whole
_AROUND = 0.3  # of the object's size, how far about it the backdrop's colours are learnt
_HERE = 0.5  # share of the colours of this image about the outline, against those of all views
_CLEAR = 2  # px from an outline that is about right, from which on a pixel is all of one side
_ABOUT = 2.5  # px, sigma of the neighbourhood whose colours are mixed on the outline
_ENOUGH = 0.02  # share of it that shows a side
_CONTRAST = 24.0  # grey levels, over all channels, from which on a mixture tells
# Share of the step across the outline from which on a pixel of it is the object's: less than a
# half, for beside its outline a round thing is darker than the core with which it is compared.
_COVERED = 0.45
# Before black it is far darker there and still lighter than any backdrop: with a half, balls that
# are lit from where the camera stands come out a pixel too small.
_DIM, _BLACK = 0.25, 10.0  # that share, and grey levels up to which a backdrop is black
_SURE = 5.0  # nats, most that colours may say


def finer(
    image: NDArray[np.uint8],
    coarse: Mask,
    saying: NDArray[np.float32],
    known: Scene | None = None,
) -> NDArray[np.uint8]:
    """The outline found again where a coarse mask has it, by colours on its two sides.

    Args:
        image: (h, w) or (h, w, 3) BGR.
        coarse: (h', w') the mask in a smaller copy of the image.
        saying: (h', w') nats by which all views' colours speak for the object.
        known: (h, w, 3) and (h, w) what the image shows where nothing hides the backdrop, and its
            spread, infinite where that is not known.

    Returns:
        (h, w) uint8, 255 = object.
    """
    height, width = image.shape[:2]
    out = np.zeros((height, width), np.uint8)
    times = width / coarse.shape[1]
    reach = max(_BAND * times, _LEAST_BAND)
    size = times * float(np.sqrt(np.count_nonzero(coarse)))
    around = max(_AROUND * size, 4 * reach)
    x, y, w, h = cv2.boundingRect(coarse.astype(np.uint8))
    if not w:
        return out
    low = np.maximum(np.floor(times * np.array([y, x]) - around), 0).astype(int)
    high = np.ceil(times * np.array([y + h, x + w]) + around).astype(int)
    part = slice(low[0], min(high[0], height)), slice(low[1], min(high[1], width))
    away = cv2.resize(signed_distance(coarse), (width, height))[part] * np.float32(times)
    nats = cv2.resize(saying, (width, height))[part]
    picture = image[part]
    bins = colour_bins(np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.7), np.uint8))
    inside = probability(histogram(bins[away > reach]))
    outside = probability(histogram(bins[(away < -reach) & (away > -around)]))
    here = np.clip(np.log(inside / outside), -_SURE, _SURE)[bins]
    if known is not None and image.ndim == 3:
        sure, density, told = as_known(picture, (known[0][part], known[1][part]))
        anything = 0.5 * (inside + outside)[bins]
        hidden, seen = before_known(inside[bins], anything, density)
        by_print = told * np.clip(np.log(hidden / seen), -_SURE, _SURE)
        here = np.where(sure, by_print, here)
    nats = (1 - _HERE) * nats + _HERE * here + BODY * np.tanh(away / reach)
    free = np.abs(away) < 1.5 * reach
    nats = np.where(free, nats, np.where(away > 0, BODY, -BODY))
    found = cut_image(nats.astype(np.float64), free, picture, STIFFNESS)
    out[part][partly_covered(found, picture)] = 255
    return out


def partly_covered(mask: Mask, image: NDArray[np.uint8]) -> Mask:
    """The mask whose outermost pixels are those of which the object covers a good part.

    A pixel on the edge mixes both colours: darker than most of a light object before black, but
    of no backdrop. By a model of colours alone the object would have it, and be a pixel too large.

    Args:
        mask: (h, w).
        image: (h, w) or (h, w, 3).
    """
    core = shrunk(mask, square(3), _CLEAR)
    away = ~grown(mask, square(3), _CLEAR)
    ring = np.flatnonzero(grown(mask, square(3)) & ~shrunk(mask, square(3)))
    colours = image.astype(np.float32).reshape(*mask.shape, -1)

    def near(region: NDArray) -> tuple[NDArray, NDArray]:
        """Mean colour of a region about each pixel of the ring, and how much of it there is."""
        weight = cv2.GaussianBlur(region.astype(np.float32), (0, 0), _ABOUT).ravel()[ring]
        blurred = cv2.GaussianBlur(colours * region[..., None], (0, 0), _ABOUT)
        blurred = blurred.reshape(mask.size, -1)[ring]
        return blurred / np.maximum(weight, 1e-6)[:, None], weight

    (inner, some), (outer, more) = near(core), near(away)
    across = inner - outer
    square_of = (across**2).sum(axis=1)
    pixels = colours.reshape(mask.size, -1)[ring]
    share = ((pixels - outer) * across).sum(axis=1) / np.maximum(square_of, 1e-6)
    tells = (np.minimum(some, more) > _ENOUGH) & (square_of > _CONTRAST**2)
    out = mask.ravel().copy()
    covered = np.where(outer.max(axis=1) < _BLACK, _DIM, _COVERED)
    out[ring[tells]] = (share > covered)[tells]
    return np.asarray(out.reshape(mask.shape))


def signed_distance(mask: Mask) -> NDArray[np.float32]:
    """(h, w) float32, px, positive inside."""
    here = mask.astype(np.uint8)
    if not here.any():
        return np.full(mask.shape, -1e3, np.float32)
    inside = cv2.distanceTransform(np.pad(here, 1, mode="edge"), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(inside - cv2.distanceTransform(1 - here, cv2.DIST_L2, 5), np.float32)
