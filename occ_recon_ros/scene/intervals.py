"""Where a smooth function of one variable is not negative."""

from collections.abc import Callable

import numpy as np

from occ_recon_ros.geometry.arrays import Array

_PARTS, _ROUNDS = 32, 12  # of an interval at a time: 60 halvings


def positive_intervals(
    function: Callable[[Array], Array], grid: Array, periodic: bool
) -> list[tuple[float, float]] | None:
    """Intervals on which a function is positive, their ends found to rounding error.

    Args:
        function: takes and returns (n,) float64.
        grid: (m,) increasing arguments, dense enough to see every change of sign. With
            ``periodic`` its ends are the same place.
        periodic: intervals may wrap; then their upper end lies beyond the grid's.

    Returns:
        The (low, high) of each interval; None where a periodic function is positive
        all around. Intervals cut by the ends of a grid that is not periodic are left out.
    """
    positive = function(grid) > 0
    changes = np.flatnonzero(positive[1:] != positive[:-1])
    if not len(changes):
        return None if periodic and positive[0] else []
    low, high = grid[changes].copy(), grid[changes + 1].copy()
    rising = ~positive[changes]
    numbers = np.arange(len(changes))
    for _ in range(_ROUNDS):
        places = low[:, None] + np.arange(_PARTS + 1) * ((high - low) / _PARTS)[:, None]
        places[:, -1] = high
        before = (function(places[:, 1:-1].ravel()) > 0).reshape(-1, _PARTS - 1) != rising[:, None]
        # The first place behind the change; the last of all is.
        behind = 1 + np.argmin(np.column_stack([before, np.zeros_like(rising)]), axis=1)
        low, high = places[numbers, behind - 1], places[numbers, behind]
        if (np.nextafter(low, high) >= high).all():
            break
    # The side on which the function is positive, so that a square root of it exists.
    ends = np.where(rising, high, low)
    starts, stops = ends[rising], ends[~rising]
    if not rising[0]:
        wrapped = [stops[0] + grid[-1] - grid[0]] if periodic else []
        stops = np.append(stops[1:], wrapped)
    return [(float(a), float(b)) for a, b in zip(starts, stops, strict=False)]


def around(interval: tuple[float, float], theta: Array) -> tuple[Array, Array]:
    """Go there and back along an interval as theta makes one turn.

    Two branches +-sqrt(f) over an interval at whose ends f = 0 form one smooth closed
    curve in theta.

    Returns:
        (n,) position in the interval, (n,) sign of the branch.
    """
    low, high = interval
    position = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(theta)
    return np.clip(position, low, high), np.where(np.sin(theta) >= 0, 1.0, -1.0)
