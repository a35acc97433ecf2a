"""Where an outline is not that of a smooth rim: corners, T-junctions, ends of a contact.

Blur and smoothing round off what turns within a few pixels. On a smooth outline the tangent
turns over 4 px by a third of what it turns over 12 px; the excess over that tells how abrupt a
bend is. A convex tip, however tight, is the rim of a smooth surface, found with an error that
grows with excess and blur. Where the outline turns into the object, one surface ends before another
(a T-junction) or two meet in a crease; a convex bend with all of its turn in the middle is
an edge of the object, or where it meets the table.
"""

import numpy as np
from numpy.typing import NDArray

from .curves import largest, shifted

Array = NDArray[np.floating]

_NEAR_PX, _FAR_PX = 2.0, 6.0
_CREASE_RAD = 0.4
_EDGE_RAD, _EDGE_SHARE = 0.6, 0.65
_MARKED_PX, _ROUNDED_PX = 1.0, 2.0
# Error of the edge, px for 1 px of blur: by the square of the excess at a tip, by the excess where
# it turns inwards.
_TIP_ERROR, _NOTCH_ERROR = 0.5, 0.7


def marked(points: Array, sigma: Array, blur: Array, spacing: float) -> Array:
    """The sigma of an outline that knows of its corners.

    Args:
        points: (n, 2) float64, px, evenly spaced, closed, object on the left as displayed.
        sigma: (n,) float64, px.
        blur: (n,) float64, of the edge, px.
        spacing: distance of the samples, px.

    Returns:
        (n,) float64, px: larger at tight bends, infinite at corners.
    """
    near, far = max(1, round(_NEAR_PX / spacing)), max(3, round(_FAR_PX / spacing))
    if len(points) <= 2 * far:
        return sigma
    over_near, over_far = _turns(points, near, far)
    excess = over_near - over_far * near / far
    # Beside an abrupt bend the excess is that of the bend's neighbour, of opposite sign.
    tip = np.maximum(np.minimum(excess, over_near), 0.0)
    notch = np.maximum(np.minimum(-excess, -over_near), 0.0)
    edge = (over_near > _EDGE_RAD) & (over_near > _EDGE_SHARE * over_far)
    rounded = blur * _spread(_TIP_ERROR * tip**2 + _NOTCH_ERROR * notch, _ROUNDED_PX, spacing)
    lost = _spread((notch > _CREASE_RAD) | edge, _MARKED_PX, spacing)
    return np.where(lost > 0, np.inf, np.hypot(sigma, rounded))


def _turns(points: Array, near: int, far: int) -> tuple[Array, Array]:
    """(n,) turn of the tangent, rad, positive where convex, over ``near`` and over ``far``
    samples to either side."""
    step = shifted(points, -1) - shifted(points, 1)
    before, after = shifted(step, 1), shifted(step, -1)
    bend = np.arctan2(
        before[:, 1] * after[:, 0] - before[:, 0] * after[:, 1], (before * after).sum(axis=1)
    )
    turned = np.cumsum(np.concatenate([bend[-far - 1 :], bend, bend[: far + 1]])) / 2
    middle = np.arange(len(points)) + far + 1
    return (
        turned[middle + near] - turned[middle - near],
        turned[middle + far] - turned[middle - far],
    )


def _spread(values: NDArray, reach_px: float, spacing: float) -> Array:
    """The largest of the values within a reach along the loop."""
    return largest(values, 2 * round(reach_px / spacing) + 1)
