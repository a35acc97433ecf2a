"""Over how many pixels an image changes across an outline: blur, against that of other images."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .joint.edges import colours_at, outline_normals
from .padding import picture_area
from .segment import to_uint8

_REACH = 0.015  # of the longer side of the image, to either side of the outline
_LEAST_PX = 6
_LOOKED_AT = 500  # pixels of an outline
_CLEAR = 15.0  # grey levels across it: of less noise makes the width
_WIDEST = 0.75  # quantile: a motion blurs what lies across it
_FEWEST = 20  # pixels


def edge_width(image: NDArray[Any], mask: NDArray[np.uint8]) -> float:
    """Width of the edges along the outline of a mask, px: what the grey levels differ by across it,
    for the most by which one pixel differs from the next; NaN where there is hardly an edge.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        mask: (h, w), coverage, 0 = background.
    """
    seen = to_uint8(image)
    grey = np.asarray(seen if seen.ndim == 2 else seen.mean(axis=2), np.uint8)
    reach = max(_LEAST_PX, round(_REACH * max(mask.shape)))
    picture = np.zeros(mask.shape, np.bool_)
    picture[picture_area(seen)] = True
    at, inwards = outline_normals(mask > 127, picture, reach)
    some = slice(None, None, max(1, len(at) // _LOOKED_AT))
    steps = range(-reach, reach + 1)
    across = np.stack([colours_at(grey, at[some], inwards[some], away) for away in steps], axis=-1)
    most = np.abs(np.diff(across, axis=-1)).max(axis=-1)
    differs = np.ptp(across, axis=-1)
    clear = differs > _CLEAR
    if np.count_nonzero(clear) < _FEWEST:
        return float("nan")
    return float(np.quantile(differs[clear] / most[clear], _WIDEST))
