"""How far poses and calibration are off: what frontier points and silhouettes say of it.

Two views must see their common frontier points in one epipolar plane; errors of their own
that the views make across it show at once. Errors that all views share (of the principal
point, of the axis) show where a point of one view is held against the silhouettes of the
views from the other side: many then fall outside by a like amount, as wrong matches do not.
"""

from collections import deque

import numpy as np

from .arrays import Array, robust_sigma
from .contours import Contours

_ERRORS = 200  # frontier points remembered
_ENOUGH = 10  # of them, before they tell of poses
_RIMS = 36  # rims remembered, and points of each
_POINTS = 64
_MANY = 0.15  # share of points outside that are not a few wrong matches
_ALIKE = 0.8  # their quartiles, at most so far apart, in medians
_MOST = 16.0  # px outside: more is no fault of a calibration
_TWO_VIEWS = np.sqrt(2)  # how far apart two views are that are each off by one
_MARGIN = 2.2  # twice, as silhouettes from the other side are off the other way; and some


class CalibrationWatch:
    """Collects what each rim says.

    Attributes:
        frontier_px: how far apart views see their common frontier points, 1 sigma; NaN before
            any.
        contour_px: the usual sigma of the contours, pixels; 0 before any.
    """

    def __init__(self) -> None:
        self.frontier_px, self.contour_px = float("nan"), 0.0
        self._frontier: deque[float] = deque(maxlen=_ERRORS)
        self._sigmas: deque[float] = deque(maxlen=_RIMS)
        self._excess: deque[Array] = deque(maxlen=_RIMS)
        self._outside = (0.0, 0.0)

    def add_frontier(self, errors_px: Array, view: Contours) -> None:
        """Take in how far apart a view and another see their frontier points, pixels."""
        self._frontier.extend(errors_px)
        sigma_px = view.usual_sigma / view.radians_per_pixel
        if np.isfinite(sigma_px):
            self._sigmas.append(sigma_px)
            self.contour_px = float(np.median(self._sigmas))
        if self._frontier:
            self.frontier_px = robust_sigma(np.asarray(self._frontier))

    def add_excess(self, excess_px: Array, usual_px: float) -> None:
        """Take in how far a rim's points lie outside the worst silhouette, pixels.

        Args:
            excess_px: (n,) negative inside.
            usual_px: what counts as outside.
        """
        known = excess_px[np.isfinite(excess_px)]
        self._excess.append(known[:: max(1, len(known) // _POINTS)])
        values = np.concatenate(self._excess)
        out = values[values > usual_px]
        share = len(out) / max(len(values), 1)
        self._outside = (0.0, 0.0)
        if share >= _MANY:
            low, middle, high = np.percentile(out, [25, 50, 75])
            if high - low <= _ALIKE * middle and middle < _MOST:
                self._outside = (share, float(middle))

    @property
    def pose_px(self) -> float:
        """By how much the pose of a view is off, 1 sigma in pixels across its contours: what
        the contours' own sigma does not explain of the frontier points; 0 before enough."""
        if len(self._frontier) < _ENOUGH:
            return 0.0
        square = (self.frontier_px / _TWO_VIEWS) ** 2
        own = self.contour_px**2
        return float(np.sqrt(square - own)) if square > 2 * own else 0.0

    @property
    def outside(self) -> tuple[float, float]:
        """The share of points that fall outside by a like amount, and that amount, pixels;
        zeros while it is not many or not alike."""
        return self._outside

    @property
    def size_px(self) -> float:
        """By how much poses or calibration seem to be off, pixels in the image."""
        return max(np.nan_to_num(self.frontier_px) / _TWO_VIEWS, self._outside[1] / 2)

    @property
    def tolerance_px(self) -> float:
        """How far outside a silhouette a right point may fall for that."""
        return _MARGIN * self.size_px
