"""Whether snakes still hold the object, or segmentation must begin anew."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .curves import perimeter, signed_area
from .outline import Outline
from .snake import Snake

Array = NDArray[np.floating]

_HELD = 0.5
_AGREE_PX = 3.0
_WEAK = 0.4
_WHOLE = 0.9
_TRUSTED, _MOST = 0.97, 0.9
_SOFT = 2.0


def resegment(
    found: Sequence[Outline], tracked: Sequence[Outline], snakes: Sequence[Snake]
) -> str | None:
    """Why the loops must come from segmentation, None if the snakes hold.

    Args:
        found: outlines by segmentation of this image, none if it failed.
        tracked: outlines by the snakes.
        snakes: the snakes after this image.
    """
    held = _share([s.seen for s in snakes])
    if not found:
        return None if held >= _HELD else "the snakes lost the edge"
    sound = _soundness(found)
    if held < _HELD and sound > held:
        return "the snakes lost the edge"
    if _kinds(found) != _kinds(tracked) and sound >= _WHOLE * held:
        return f"{_words(_kinds(tracked))} became {_words(_kinds(found))}"
    if _agreement(found, tracked) < _HELD and sound >= _WHOLE * held:
        return "the object moved farther than the snakes reach"
    return None


def collapsed(points: Array, before: Array, min_loop_px: float) -> bool:
    """Whether a loop closed up: it turned inside out or became too short."""
    return signed_area(points) * signed_area(before) <= 0 or perimeter(points) < min_loop_px


def trusted(found: Sequence[Outline], tracked: Sequence[Outline]) -> bool:
    """Whether segmentation runs along one strong and sharp edge throughout, by way of most of
    what the snakes hold; then it is right, and more so than a snake where the object moved
    much or new parts came into sight."""
    return bool(found) and _soundness(found) > _TRUSTED and _agreement(found, tracked) > _MOST


def _soundness(outlines: Sequence[Outline]) -> float:
    """Share of the samples on an edge about as strong and as sharp as the others: the rims of
    shadows and highlights are softer than the object's."""
    contrast = np.concatenate([o.contrast[o.inside] for o in outlines])
    blur = np.concatenate([o.blur[o.inside] for o in outlines])
    if not len(contrast):
        return 0.0
    seen = np.concatenate([np.isfinite(o.sigma[o.inside]) for o in outlines])
    strong = contrast > _WEAK * np.median(contrast)
    return float(np.mean(seen & strong & (blur < _SOFT * np.median(blur))))


def _agreement(found: Sequence[Outline], tracked: Sequence[Outline]) -> float:
    """Share of the tracked samples that lie on a segmented loop (what segmentation adds to
    it, a shadow say, does not count)."""
    tree = cKDTree(np.concatenate([o.points for o in found]))
    distance = tree.query(np.concatenate([o.points for o in tracked]))[0]
    return float(np.mean(distance < _AGREE_PX))


def _kinds(outlines: Sequence[Outline]) -> tuple[int, int]:
    holes = sum(signed_area(o.points) > 0 for o in outlines)
    return len(outlines) - holes, holes


def _words(kinds: tuple[int, int]) -> str:
    return f"{kinds[0]} outer and {kinds[1]} inner loops"


def _share(flags: Sequence[NDArray[np.bool_]]) -> float:
    return float(np.mean(np.concatenate(flags)))
