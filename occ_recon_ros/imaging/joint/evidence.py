"""What each pixel of each view says: object or backdrop, by colour models of all views."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import histogram, probability
from .each import each
from .light import excess_light
from .models import Ground, Models, by_place
from .regions import Mask, of_border, square
from .scenes import (
    USUAL,
    Array,
    Scene,
    dot,
    doubt_of_place,
    strongest,
)
from .small_view import SmallView, not_known

_OWN = 0.5  # share of a view's own backdrop in the model of its backdrop
_PLACE = 0.7  # share of what was seen at the same pixel in the other views
KNOWN = 0.95  # where it is known beforehand what the view shows
_OTHER = 0.5  # share of the object's colours that are not known to be its own
_MATCHES = 9.0  # squared sigmas, all channels alike
_TELLING = 12.0  # grey levels of doubt about what is known, from which on it tells little
_SHADOW, _DARKEST = 0.1, 0.4  # share of the backdrop in shadow, and the least light there
_IN_SHADOW = 0.8  # share of shadow in the model of the backdrop, where soft shadow seems to be seen
_STEADY = 8.0  # grey levels, most that a place changes which always looks the same
_TOLD = 16.0  # of a place that says more than the colours of the whole backdrop
_SHADED = 32.0  # of the ground, on which light and shadow wander as it turns
_DARK = 64.0  # grey levels, up to which a backdrop tells by being lighter alone
_LARGE = 0.01  # share of the picture
_ISLAND = 0.3  # of the largest part
_FLOOR = 2.5  # grey levels, least spread of the backdrop at a pixel
_FLOOR_EVEN = 1.0  # of the images without noise
_PLACE_EVEN = 0.97  # share of what was seen at the same pixel, where it is surely lighter now
_BIN = 360.0  # grey levels cubed that a bin of the histograms holds, about 10 x 6 x 6
_LIMIT = 5.0  # nats, most that one pixel may say


def likelihood(view: SmallView, models: Models, k: int, outside: Mask) -> NDArray[np.float32]:
    """(h, w) float32, nats by which a pixel's colour speaks for the object.

    Args:
        view: whose pixels.
        models: of all views.
        k: number of the view.
        outside: (h, w) its own backdrop as far as that is known.
    """
    p_out = probability(np.asarray(models.outside, np.float64))
    own = histogram(view.bins[outside & not_known(view)])
    if own.sum() > 50:
        p_out = (1 - _OWN) * p_out + _OWN * probability(own)
    background = p_out[view.bins]
    if models.shaded is not None:
        in_shade = np.where(models.shadows[k], _IN_SHADOW, 0.0)
        background = (1 - in_shade) * background + in_shade * models.shaded[view.bins]
    here, known = np.zeros(view.bins.shape), np.zeros(view.bins.shape, np.bool_)
    for median, spread in models.scenes[k]:
        square, sigma = differing(view, (median, spread))
        density = np.exp(-0.5 * np.minimum(square, 60.0)) * density_of(sigma)
        here = np.maximum(here, np.minimum(density, 1.0))
        if models.dimmed:
            dark = shadowed(view, median, sigma)
            here = np.maximum(here, np.minimum(_SHADOW * dark * density_of(sigma), 1.0))
        known |= spread < _TOLD
    share = np.where(known, _PLACE, 0.0)
    unexplained: Array = np.ones(known.shape)
    if models.even is not None:
        lighter = _lighter(view, models.even)
        here *= np.exp(-0.5 * np.maximum(lighter - USUAL, 0.0))
        share[lighter > USUAL] = _PLACE_EVEN
    if models.empty is not None:
        # No colour of the backdrop elsewhere explains what is lighter than this place of it.
        dark = strongest(models.empty[0]) < _DARK
        excess = np.where(dark, excess_light(view.even, models.empty, outside), 0.0)
        unexplained = np.exp(-0.5 * excess)
        here *= unexplained
        share = np.where(excess > 0, _PLACE_EVEN, share)
    if models.shaded is not None:
        share = np.where(models.shadows[k], 0.0, share)
    background = unexplained * ((1 - share) * background + share * here)
    foreground = models.inside[view.bins]
    told: Array = np.ones(known.shape)
    if view.known is not None:
        sure, density, told = as_known(view.image, view.known)
        anything = 0.5 * (foreground + p_out[view.bins])
        by_known = before_known(foreground, anything, density)
        foreground, background = np.where(sure, by_known, (foreground, background))
    foreground = (1 - models.alike) * foreground + models.alike * background
    out = told * (np.log(foreground + 1e-9) - np.log(background + 1e-9))
    out[~view.picture] = 0.0
    return np.asarray(np.clip(out, -_LIMIT, _LIMIT), np.float32)


def with_less_alike(nats: NDArray[np.float32], before: float, after: float) -> NDArray[np.float32]:
    """What ``likelihood`` says, were the share of the object that looks as the backdrop another.

    Where the body is to be found a dark place must not carve it; along its outline, where the
    body ends within a voxel or two, what looks as the backdrop is more likely the backdrop.

    Args:
        nats: (h, w) as found with a share ``before``.
        before, after: shares, 0 to 1.
    """
    if after >= before:
        return nats
    colours = np.maximum(np.exp(nats) - before, 0.0) / (1 - before)
    return np.clip(np.log((1 - after) * colours + after), -_LIMIT, _LIMIT).astype(np.float32)


def as_known(image: NDArray[np.uint8], known: Scene) -> tuple[Mask, Array, Array]:
    """(h, w) where it is known what is seen if nothing hides it; the probability of such a
    colour; and how much that tells, 0 to 1: along the edges of a print nobody can."""
    sure, square, sigma = _departing(image, known)
    density = np.exp(-0.5 * np.minimum(square, 60.0)) * density_of(sigma)
    told = np.where(sure, 1 / (1 + (sigma / _TELLING) ** 2), 1.0)
    return sure, np.minimum(density, 1.0), told


def before_known(inside: Array, anything: Array, density: Array) -> tuple[Array, Array]:
    """Probability (h, w) of what is seen if the object hides what is known, and if it does not.

    What departs from a print is of the object, in whatever colour: black before a white square too,
    though the print is black elsewhere and the object's colours may not be known yet.

    Args:
        inside: (h, w) probability of the colours among the object's.
        anything: (h, w) the same among those of object and backdrop.
        density: (h, w) as of ``as_known``.
    """
    return (1 - _OTHER) * inside + _OTHER * anything, (1 - KNOWN) * anything + KNOWN * density


def _departing(image: NDArray[np.uint8], known: Scene) -> tuple[Mask, Array, Array]:
    """(h, w) where it is known what is seen; by how many squared sigmas it differs, all channels
    alike; and sigma, grey levels."""
    median, spread = known
    sure = np.isfinite(spread)
    sigma = np.where(sure, np.maximum(spread, _FLOOR), np.float32(1e3))
    return sure, (((image - median) / sigma[..., None]) ** 2).mean(axis=2), sigma


def telling(view: SmallView) -> Mask:
    """(h, w) False where what is known of a view is too unsure to say what is seen."""
    if view.known is None:
        return np.ones(view.picture.shape, np.bool_)
    return np.asarray(~np.isfinite(view.known[1]) | (view.known[1] < _TELLING))


def density_of(sigma: Array) -> Array:
    """Probability of a bin in the middle of a normal distribution of three channels."""
    return np.asarray(_BIN / (2.5066 * sigma) ** 3)


def _lighter(view: SmallView, scene: Scene) -> Array:
    """(h, w) squared sigmas by which a place is lighter than the fixed camera's backdrop.

    Without noise, a little light on a dark object tells it from a backdrop as dark.
    """
    median, spread = scene
    sigma = np.maximum(np.hypot(spread, doubt_of_place(median)), _FLOOR_EVEN)
    more = np.maximum(view.even - median, 0.0) / sigma[..., None]
    return np.minimum(dot(more, more), 120.0)


def shadowed(view: SmallView, median: NDArray, sigma: Array) -> Array:
    """(h, w) how well a pixel is the scene with less light on it, 1: exactly."""
    image = view.image.astype(np.float32)
    gain = dot(image, median) / np.maximum(dot(median, median), 1.0)
    gain = np.clip(gain, _DARKEST, 1.0)
    away = image - gain[..., None] * median
    return np.asarray(np.exp(-0.5 * np.minimum(dot(away, away) / sigma**2, 60.0)))


def differing(view: SmallView, scene: Scene) -> tuple[Array, Array]:
    """Squared sigmas (h, w) by which a view differs from a scene, and the sigma (h, w).

    A pixel of doubt about where things are counts as doubt about the colour along edges.
    """
    median, spread = scene
    known = np.where(np.isfinite(spread), spread, np.float32(1e3))
    sigma = np.maximum(np.hypot(known, doubt_of_place(median)), _FLOOR)
    away = view.image - median
    return dot(away, away) / sigma**2, sigma


def looks_as_ground(view: SmallView, scene: Scene) -> Mask:
    """(h, w) where a view shows what lies on the ground there, as far as that is known."""
    return np.asarray((differing(view, scene)[0] < USUAL) & (scene[1] < _SHADED))


def explained(views: Sequence[SmallView], ground: Ground | None, still: bool = True) -> list[Mask]:
    """Of each view, (h, w) the pixels that look as usual: the fixed camera sees them so in most
    views (if ``still``), or the ground looks so. Before anything is known of the object."""
    everywhere = [view.picture for view in views]
    fixed = by_place([view.image for view in views], everywhere) if still else None
    on_ground = ground.scenes(views, everywhere) if ground is not None else None

    def looks(k: int, view: SmallView) -> Mask:
        usual = np.zeros(view.picture.shape, np.bool_)
        if fixed is not None:
            usual |= (differing(view, fixed)[0] < USUAL) & (fixed[1] < _STEADY)
            # The middle of an object that turns looks as usual too, but no way leads to it.
            usual = of_border(usual | ~view.picture) & view.picture
        if on_ground is not None:
            scene = on_ground[k]
            flat = looks_as_ground(view, scene)
            if view.known is not None:
                sure, square, sigma = _departing(view.image, view.known)
                flat = np.where(sure, (square < _MATCHES) & (sigma < _TELLING), flat)
            usual |= _large(flat)
        return usual

    return each(looks, range(len(views)), views)


def _large(mask: Mask) -> Mask:
    """The largest part, and those of which it is no multiple: what is hidden in the middle of
    the ground is an island."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, square(3))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if areas.max() < _LARGE * mask.size:
        return np.zeros_like(mask)
    return mask & np.isin(labels, np.flatnonzero(areas > _ISLAND * areas.max()))
