"""Colours of object and backdrop, learnt from all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import evenly
from .colours import COUNT, histogram, probability
from .each import each
from .light import empty_scene, is_clean
from .regions import Mask
from .scenes import LEAST_SEEN, Array, Scene, typical
from .shadow import in_shadow, soft_shadow
from .small_view import SmallView, not_known

_SOME = 1000  # pixels from which a histogram says something
_USED_UP = 0.2  # share of the backdrop's colours that a mixture may lack
_UNSEEN = 0.02  # of a mixture that is kept whatever the backdrop


class Ground(Protocol):
    """What a plane under the object looks like."""

    def scenes(self, views: Sequence[SmallView], outside: Sequence[Mask]) -> list[Scene]:
        """The plane's picture in each view."""


@dataclass(frozen=True)
class Models:
    """Colours of object and backdrop.

    Attributes:
        inside: (COUNT,) probability of the object's colours over all views.
        outside: (COUNT,) counts of the backdrop's.
        scenes: of each view, pictures of the backdrop and their spread (h, w, 3) and (h, w)
            float32, grey levels, infinite where not known: what the fixed camera sees at each
            pixel, and what lies on the plane under the object.
        even: what the fixed camera sees in the images without noise.
        alike: share of the object's pixels that look as the backdrop behind them, as dark
            crevices before black.
        empty: as ``even``, and also where the object always hides it.
        shaded: (COUNT,) probability of colours of the backdrop in shadow, None: it shows none.
        dimmed: whether a place of the backdrop may be dimmed.
        shadows: of each view, (h, w) where it seems to show soft shadow.
    """

    inside: Array
    outside: Array
    scenes: list[list[Scene]]
    even: Scene | None = None
    alike: float = 0.0
    empty: Scene | None = None
    shaded: Array | None = None
    shadows: Sequence[Mask] = ()
    dimmed: bool = True


def learn(
    views: Sequence[SmallView],
    inside: Sequence[Mask],
    outside: Sequence[Mask],
    shown: Sequence[Mask] | None,
    ground: Ground | None,
    mixed_with: Sequence[Mask] | None = None,
    alike: float = 0.0,
    in_shade: bool = True,
) -> Models:
    """Models from the pixels of each view that are inside and those that are outside.

    Args:
        views: n of them.
        inside, outside: of each view, (h, w).
        shown: of each view, (h, w), where the backdrop is not hidden; None: not known.
        ground: the plane under the object.
        mixed_with: of each view, (h, w) the backdrop around the object, whose colours are
            taken out of those inside.
        alike: share of the object's pixels that are not among those inside, for they look as
            the backdrop.
        in_shade: whether the backdrop may be in shadow.
    """
    f, b = np.zeros(COUNT), np.zeros(COUNT)
    for view, o in zip(views, outside, strict=True):
        b += histogram(view.bins[o & not_known(view)])
    shaded = in_shadow(b) if in_shade else None
    if shaded is None:
        shadows = [np.zeros_like(o) for o in outside]
    else:

        def shadow_in(view: SmallView, o: Mask) -> Mask:
            return soft_shadow(view.even, view.bins, o & view.picture, shaded, view.enlarged)

        shadows = each(shadow_in, views, outside)
    for view, i, shadow in zip(views, inside, shadows, strict=True):
        f += histogram(view.bins[i & ~shadow])
    scenes: list[list[Scene]] = [[] for _ in views]
    fixed = by_place([view.image for view in views], shown) if shown else None
    on_ground = ground.scenes(views, shown) if ground is not None and shown else None
    for k in range(len(views)):
        scenes[k] += [fixed] if fixed is not None else []
        scenes[k] += [on_ground[k]] if on_ground is not None else []
    p_in: Array = probability(f)
    if mixed_with is not None:
        around = np.zeros(COUNT)
        for view, mask in zip(views, mixed_with, strict=True):
            around += histogram(view.bins[mask])
        for counts in (b, around):
            p_in = unmixed(p_in, probability(counts)) if counts.sum() > _SOME else p_in
    images = [view.even for view in views]
    even = by_place(images, shown) if shown else None
    empty = empty_scene(images, shown) if shown else None
    surely = [o & view.picture for o, view in zip(outside, views, strict=True)]
    if empty is not None and not is_clean(images, empty, surely):
        empty = None
    return Models(p_in, b, scenes, even, alike, empty, shaded, shadows, in_shade)


def unmixed(mixture: Array, backdrop: Array) -> Array:
    """What is left of a mixture of colours without as much backdrop as it can hold.

    The share of the backdrop is the one at which a fifth of its colours are used up.
    """
    order = np.argsort(mixture / backdrop)
    held = np.cumsum(backdrop[order])
    share = float((mixture / backdrop)[order][np.searchsorted(held, _USED_UP * held[-1])])
    rest = np.maximum(mixture - share * backdrop, 0.0) + _UNSEEN * mixture
    return np.asarray(rest / rest.sum())


def by_place(images: Sequence[NDArray[np.uint8]], outside: Sequence[Mask]) -> Scene | None:
    """Median and spread of the backdrop at each pixel over the views of one size."""
    if len({image.shape for image in images}) > 1 or len(images) < LEAST_SEEN:
        return None
    chosen = evenly(len(images), 32)
    stack = np.stack([images[k] for k in chosen])
    return typical(stack, np.stack([outside[k] for k in chosen]))
