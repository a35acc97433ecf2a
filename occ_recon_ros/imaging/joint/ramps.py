"""Whether an outline runs through a soft shadow: the ground seems darker within, and goes on to
darken over many pixels, where the edges of the figure are as sharp as the lens shows them."""

from collections.abc import Sequence

import numpy as np

from .edges import colours_at, outline_normals
from .plane import ring_normal
from .regions import Mask
from .small_view import SmallView
from .space import fixation

MUCH_IN_SHADOW = 0.05  # share of an outline; less, that of a grey foot in its own shadow has too

_NEAR, REACH = 1.5, 4.0  # px to either side: an edge is over within these, and a ramp goes on
_IN_FOCUS = 0.75  # quantile over all outlines, of how much of the change is over: that of an edge
_RAMP = 0.6  # of that, with less of which it is none
_LEAST = 0.15  # of the usual change: less is neither
_BELOW = 0.5  # cosine to straight below: farther round, an outline is not of what stands there
_STEP = 0.01  # of the distance, over which the way up is seen


def shadow_ramps(
    views: Sequence[SmallView], masks: Sequence[Mask], shadows: Sequence[Mask]
) -> tuple[list[Mask], float]:
    """Of each view, (h, w) the pixels below in its outline, along a ramp of the ground's colours,
    dimmed within; and the share of the usual outline that they are. None, where the cameras do not
    stand around anything.

    Edges do not doubt such an outline, for there is much contrast within some pixels; nor do
    colours, where the object is as grey as the shadow; nor other views, for it turns with it.

    Args:
        views: n of them.
        masks: of each view, (h, w).
        shadows: of each view, (h, w) where its colours are those of ground in shadow.
    """
    cameras = [view.camera for view in views]
    ramps = [np.zeros_like(mask) for mask in masks]
    axis, middle = ring_normal(cameras), fixation(cameras)
    if axis is None:
        return ramps, 0.0
    near, far, dimmed, along = [], [], [], []
    for view, mask, shadow in zip(views, masks, shadows, strict=True):
        about = outline_normals(mask, view.picture, REACH)
        shows = {k: colours_at(view.even, *about, k) for k in (-REACH, -_NEAR, _NEAR, REACH)}
        near.append(np.abs(shows[_NEAR] - shows[-_NEAR]).max(axis=1, initial=0.0))
        far.append(np.abs(shows[REACH] - shows[-REACH]).max(axis=1, initial=0.0))
        ground = colours_at(255 * shadow.astype(np.uint8), *about, _NEAR) > 127
        reach = _STEP * np.linalg.norm(view.camera.centre - middle)
        up = np.diff(view.camera.project(np.stack([middle, middle + reach * axis])), axis=0)[0]
        ground &= about[1] @ up > _BELOW * np.linalg.norm(up)
        dimmed.append(ground & (shows[REACH] <= shows[-REACH]).all(axis=1))
        along.append(about[0])
    whole = np.concatenate([*far, np.zeros(1)])
    over = np.concatenate([*near, np.zeros(1)]) / np.maximum(whole, 1.0)
    steep, least = _RAMP * float(np.quantile(over, _IN_FOCUS)), _LEAST * float(np.median(whole))
    shares = []
    for ramp, at, d, n, f in zip(ramps, along, dimmed, near, far, strict=True):
        here = d & (f > least) & (n < steep * f)
        ramp[at[here, 1], at[here, 0]] = True
        shares.append(float(np.mean(here)) if len(here) else 0.0)
    return ramps, float(np.median(shares))
