"""Streaming reconstruction: contours in, rims out, one for each frame."""

from bisect import bisect_left
from collections.abc import Iterator

import numpy as np

from .arrays import Array
from .belief import Belief
from .calibration import CalibrationWatch
from .compute import compute_rim, revise_rim
from .context import Context
from .contours import Contours
from .estimators import MANY_FRAMES
from .rim import Rim, empty_rim
from .settings import RimSettings
from .silhouette import Silhouette, Silhouettes
from .window import ViewCircle

_WIDEST = 3.0  # baselines: the surface is no parabola over more
_BELIEVED_OUTSIDE = 2.0  # sigmas: of the two contours, for a point is moved by more of its own
_STILL = 1e-5  # rad: a camera that moved less has not moved


class RimReconstructor:
    """The paper's method over a sliding window of three frames.

    A frame waits until a later one at least ``baseline`` away has come; then its rim is
    computed with that frame and the nearest earlier one as far away. Frames that lack
    an earlier partner (the first) wait until ``finish``, when the turn may have closed.
    """

    def __init__(self, settings: RimSettings | None = None) -> None:
        self.settings = settings or RimSettings()
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._frames: list[Silhouette] = []
        self._asked = Silhouettes([])
        self._circle = ViewCircle()
        self._next = 0
        self._first_waiting = 0
        self._rims: dict[int, Rim] = {}  # by stamp
        self._beliefs: dict[int, Belief] = {}  # of their points
        self._tried: dict[int, set[frozenset[int]]] = {}  # pairs of partners, by stamps
        self._heard: dict[int, list[Rim]] = {}  # rims of partners that have had their say
        self.calibration = CalibrationWatch()
        self.unmoved = 0  # frames left out because the camera had not moved

    @property
    def pose_error_px(self) -> float:
        """How far apart partners see their common frontier points, 1 sigma in pixels.

        Robust (from the median) over the last frames; NaN before there are any. Much more
        than the contours' own sigma means that poses or calibration are off.
        """
        return self.calibration.frontier_px

    @property
    def tolerance_px(self) -> float:
        """Pixels that a point may lie outside a silhouette: those of the settings, or more
        where poses or calibration are seen to be off."""
        doubt = _BELIEVED_OUTSIDE * np.sqrt(2) * self.calibration.contour_px
        return max(self.settings.silhouette_tolerance, self.calibration.tolerance_px, doubt, 1e-6)

    def add(self, contours: Contours) -> list[Rim]:
        """Take in the next frame; return the rims that it completes, oldest first.

        A frame whose camera has not moved since the last is left out and counted
        (``unmoved``): it can teach nothing, and no rim is made for it.

        Raises:
            ValueError: the frame is not later than the last one.
            Exception: it cannot be worked on; the scan is as it was without it.
        """
        if self._frames and contours.stamp_ns <= self._frames[-1].contours.stamp_ns:
            raise ValueError("contours must come in the order of their stamps")
        if not len(contours):
            return []
        if self._frames and self._moved(contours) < _STILL:
            self.unmoved += 1
            return []
        self._frames.append(Silhouette(contours))
        self._circle.add(contours)
        self._forget()
        before = self._next, self._first_waiting
        try:
            return self._due()
        except Exception:
            # Else it would be met again with every frame to come.
            self._next, self._first_waiting = before
            self._circle.keep(range(len(self._frames) - 1))
            del self._frames[-1]
            raise

    def _due(self) -> list[Rim]:
        """The rims whose partners have come."""
        rims = []
        while self._next < len(self._frames):
            k, baseline = self._next, self.settings.baseline
            before = self._circle.earlier(k, baseline)
            after = self._circle.later(k, baseline)
            if before is None and k == self._first_waiting:
                self._next = self._first_waiting = k + 1
                continue
            if before is None or after is None:
                break
            if self._circle.same_side(k, before, after):
                before, after = self._circle.partners(k, baseline)
            rims.append(self._rim(k, before, after))
            self._next += 1
        return rims

    def finish(self) -> list[Rim]:
        """The rims still owed, and those that come again: all of ``finishing`` at once."""
        return [rim for rim in self.finishing() if rim is not None]

    def finishing(self) -> Iterator[Rim | None]:
        """The rims still owed, one by one: those of the last frames, then those of the first.

        Where the turn has closed, the partner is found across the seam; where it has
        not, both partners are taken on the one side that was seen. After them come again,
        under their own stamps, the rims of which a silhouette seen later shows points to be
        wrong (now status 4), or partners seen later give points that were not to be had.

        None stands for a frame whose rim is as it was. Each step takes about as long as one
        ``add``, so that whoever has other things to answer may do so between two rims. No frame
        may be added before the last has been taken.
        """
        waiting = [*range(self._next, len(self._frames)), *range(self._first_waiting)]
        self._next, self._first_waiting = len(self._frames), 0
        for k in waiting:
            rim = self._rim(k, *self._circle.partners(k, self.settings.baseline))
            yield self._revised(k) or rim
        for k in sorted(set(range(len(self._frames))) - set(waiting)):
            yield self._revised(k)

    @property
    def centres(self) -> Array:
        """(frames, 3) camera centres of the frames kept, in the order they came, metres."""
        return self._circle.centres.copy()

    def contours_of(self, stamp_ns: int) -> Contours | None:
        """The contours of a frame that is still kept."""
        stamps = [silhouette.contours.stamp_ns for silhouette in self._frames]
        k = bisect_left(stamps, stamp_ns)
        return self._frames[k].contours if stamp_ns in stamps[k : k + 1] else None

    def _forget(self) -> None:
        """Let every second frame go of too many between the first, which may join the last
        across the seam of the turn, and the last, which wait or are partners of those that
        do. A camera that only shakes for long makes even these too many."""
        count, most = len(self._frames), self.settings.frames_kept
        if count <= most:
            return
        before = self._circle.earlier(self._next, self.settings.baseline)
        first = min(2 * self._first_waiting + 2, most)
        last = count - min(2 * (count - (before or 0)), most)
        if last - first <= most:
            return
        kept = [*range(first), *range(first, last, 2), *range(last, count)]
        self._circle.keep(kept)
        self._frames = [self._frames[k] for k in kept]
        stamps = {frame.contours.stamp_ns for frame in self._frames}
        self._rims = {stamp: rim for stamp, rim in self._rims.items() if stamp in stamps}
        self._beliefs = {stamp: self._beliefs[stamp] for stamp in self._rims}
        self._tried = {stamp: self._tried[stamp] for stamp in self._rims}
        self._heard = {stamp: self._heard[stamp] for stamp in self._rims}
        self._next, self._first_waiting = np.searchsorted(
            kept, [self._next, self._first_waiting]
        ).tolist()

    def _moved(self, contours: Contours) -> float:
        last = self._frames[-1].contours.centre
        distance = np.linalg.norm(self._circle.object_point - last)
        return float(np.linalg.norm(contours.centre - last)) / max(float(distance), 1e-12)

    def _rim(self, k: int, before: int | None, after: int | None) -> Rim:
        """The rim of frame k from its partners."""
        view = self._frames[k].contours
        if before is None or after is None:
            return empty_rim(view)
        pairs = self._pairs(k, before, after)
        rim, evidence = compute_rim(
            view,
            self._frames[before].contours,
            self._frames[after].contours,
            self._others(k, self.settings.silhouette_checks),
            self._context(k, before, after, pairs),
        )
        self.calibration.add_frontier(evidence.frontier_px, view)
        self.calibration.add_excess(evidence.excess_px, self.settings.silhouette_tolerance)
        heard = self._rims.get(self._frames[before].contours.stamp_ns)
        self._heard[rim.stamp_ns] = [] if heard is None else [heard]
        self._rims[rim.stamp_ns], self._beliefs[rim.stamp_ns] = rim, evidence.belief
        self._tried[rim.stamp_ns] = {self._stamps(pair) for pair in [(before, after), *pairs]}
        return rim

    def _stamps(self, pair: tuple[int, int]) -> frozenset[int]:
        """Of two frames."""
        return frozenset(self._frames[k].contours.stamp_ns for k in pair)

    def _revised(self, k: int) -> Rim | None:
        """The rim of frame k if frames that came since show points to be wrong, or give
        points that were not to be had."""
        view = self._frames[k].contours
        rim = self._rims.get(view.stamp_ns)
        if rim is None:  # it had no partners
            return None
        before, after = self._circle.partners(k, self.settings.baseline)
        pairs: list[tuple[int, int]] = []
        seen = self._tried[view.stamp_ns]
        if before is not None and after is not None:
            # Those that were there when the rim was computed have said what they can.
            pairs = [(before, after), *self._pairs(k, before, after)]
            pairs = [pair for pair in pairs if self._stamps(pair) not in seen]
        new, excess_px = revise_rim(
            rim,
            self._beliefs[view.stamp_ns],
            view,
            self._others(k, 4 * self.settings.silhouette_checks),
            self._context(k, before, after, pairs),
        )
        # The worst of four times as many silhouettes is farther off, by chance alone.
        self.calibration.add_excess(excess_px, 2 * self.settings.silhouette_tolerance)
        if new is not None:
            self._rims[view.stamp_ns] = new
        return new

    def _context(
        self, k: int, before: int | None, after: int | None, pairs: list[tuple[int, int]]
    ) -> Context:
        """What is known besides when the rim of frame k is computed."""
        frames = [frame.contours for frame in self._frames]
        more: list[int] = []
        if self.settings.estimator in MANY_FRAMES and before is not None and after is not None:
            more = self._circle.within(k, before, after, self.settings.frames - 1)
        previous = k - 1 if k else self._closing_frame()
        return Context(
            settings=self.settings,
            pose_sigma=self.calibration.pose_px * frames[k].radians_per_pixel,
            tolerance_px=self.tolerance_px,
            pairs=[(frames[i], frames[j]) for i, j in pairs],
            neighbours=[frames[j] for j in (before, after) if j is not None and self._news(k, j)],
            more=[frames[j] for j in more],
            rims=self._rims,
            previous=None if previous is None else frames[previous],
        )

    def _news(self, k: int, j: int) -> bool:
        """Whether frame j has a rim that has not been held against that of frame k."""
        stamps = [self._frames[i].contours.stamp_ns for i in (k, j)]
        heard, rim = self._heard.get(stamps[0], []), self._rims.get(stamps[1])
        return rim is not None and all(rim is not other for other in heard)

    def _pairs(self, k: int, before: int, after: int) -> list[tuple[int, int]]:
        """Other pairs of partners, the best-conditioned first."""
        circle, baseline = self._circle, self.settings.baseline
        past = circle.beyond(k, before, baseline, _WIDEST * baseline)
        next_ = circle.beyond(k, after, baseline, _WIDEST * baseline)
        pairs = [(past, after), (before, next_), (past, next_), (past, before), (next_, after)]
        return [(i, j) for i, j in pairs if i is not None and j is not None and i != j]

    def _others(self, k: int, most: int) -> Silhouettes:
        """Silhouettes of other frames, at most so many, spread over all so far.

        Every frame whose number is a multiple of a power of two: while the scan goes on
        the same ones serve again, so that few need their grid.
        """
        stride = 1
        while 0 < most * stride < len(self._frames):
            stride *= 2
        asked = self._frames[::stride] if most else []
        if asked != self._asked.members:
            self._asked = Silhouettes(asked)
        return self._asked.without(self._frames[k])

    def _closing_frame(self) -> int | None:
        """The last frame, if the turn has closed so that it comes before the first."""
        last = len(self._frames) - 1
        before = self._circle.opposite(0, 1, 0.0) if last >= 3 else None
        return last if before == last else None
