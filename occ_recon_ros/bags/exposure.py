"""Images that show nothing, where the others of their set do: the lamp was out, or in the lens."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_THINNED = 8  # every so many-th row and column tells as much
_ENDS = (1, 99)  # percentiles of the levels of an image: its darkest and its brightest
_BLACK, _WHITE = 0.1, 0.95  # of the full range: beyond these ends an image is all black or white
_UNLIKE = 0.25  # of what the others have between that end and theirs
_NAMED = 8


def ends_of(image: NDArray[Any]) -> tuple[float, float]:
    """How dark and how bright an image (h, w) or (h, w, 3) is where it is most, in shares of the
    full range of its numbers."""
    levels = image[::_THINNED, ::_THINNED] / np.iinfo(image.dtype).max
    dark, bright = np.percentile(levels if levels.ndim == 2 else levels.max(axis=2), _ENDS)
    return float(dark), float(bright)


def nothing_to_see(names: Sequence[str], ends: Sequence[tuple[float, float]]) -> list[str]:
    """Sentences on images that are nearly black or white all over, unlike the others.

    Args:
        names: n of them.
        ends: of each, as ``ends_of``.
    """
    found = black_or_white(ends)
    return [
        f"{len(rows)} of {len(names)} images are nearly {what} all over, unlike the "
        f"others: leave them out, or take them again: {listed([names[k] for k in rows])}"
        for what, rows in found.items()
        if rows
    ]


def black_or_white(ends: Sequence[tuple[float, float]]) -> dict[str, list[int]]:
    """Numbers of the images that are nearly ``black`` or ``white`` all over, unlike the others.

    Args:
        ends: of each, as ``ends_of``.
    """
    if not len(ends):
        return {}
    dark, bright = np.array(ends).T
    found = {
        "black": (bright < _BLACK) & (bright < _UNLIKE * np.median(bright)),
        "white": (dark > _WHITE) & (1 - dark < _UNLIKE * (1 - np.median(dark))),
    }
    return {what: np.flatnonzero(rows).tolist() for what, rows in found.items()}


def numbered(k: int, images: Sequence[Mapping[str, Any]]) -> str:
    """A view by its number, from 0, and the name of its image where that has one.

    Args:
        k: the number.
        images: rows with the ``name`` of each, "" where it has none; empty where nobody tells.
    """
    name = images[k]["name"] if k < len(images) else ""
    return f"{k} ({name})" if name else str(k)


def listed(names: Sequence[str]) -> str:
    """The first of names, in words."""
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
