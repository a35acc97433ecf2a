"""One scan from its first frame to its files: the state that everybody sees, in one place."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ..geometry.coverage import angle_covered, back_at_start, widest_gap

_MOST_CENTRES = 1000
_CONTRADICTING = 0.25  # of the samples that came since a scan was saved
_SEAM = 0.35  # rad that a table that goes on turning passes the start by: rims need neighbours


class ScanState(str, Enum):
    """Where a scan is."""

    WAITING = "waiting"
    SCANNING = "scanning"
    TURN_CLOSED = "turn_closed"
    FINISHING = "finishing"
    SAVED = "saved"
    FAILED = "failed"


OVER = (ScanState.TURN_CLOSED, ScanState.FINISHING, ScanState.SAVED)
"""States in which nothing more has to come."""


@dataclass(frozen=True)
class ScanReport:
    """A scan as it is published.

    Attributes:
        state: where it is.
        scan_id: its name, "" before its first frame.
        angle: radians that the camera has covered around the object, in all turns; a whole turn
            at most.
        frames: rims so far.
        good_share: of the samples, 0 to 1.
        reason: why it waits or has failed, or what was written; in words.
        doubt: what speaks against the body that was closed last, in words; "" for nothing.
    """

    state: ScanState = ScanState.WAITING
    scan_id: str = ""
    angle: float = 0.0
    frames: int = 0
    good_share: float = 0.0
    reason: str = "no frame has come yet"
    doubt: str = ""

    def sentence(self) -> str:
        """State and reason."""
        return ": ".join(filter(None, (self.state.value, self.reason)))

    def values(self) -> dict[str, str]:
        """All of it by the names under which it is published."""
        return {
            "state": self.state.value,
            "id": self.scan_id,
            "angle deg": f"{np.rad2deg(self.angle):.1f}",
            "frames": str(self.frames),
            "good share": f"{self.good_share:.4f}",
            "reason": self.reason,
            "doubt": self.doubt,
        }


class TurnWatch:
    """Sees from the camera centres when a turn has closed, or has ended with a hole in it.

    Attributes:
        angle: radians that the camera has covered around the object.
        ended: whether it is back where it began.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """A turn begins."""
        self._centres: list[NDArray[np.float64]] = []
        self._last = np.zeros(3)
        self._every, self._count = 1, 0
        self._after = 0.0
        self.angle = 0.0
        self.ended = False

    @property
    def closed(self) -> bool:
        """Whether the camera has been all around."""
        return self.angle >= 2 * np.pi

    @property
    def gap(self) -> float:
        """Widest angle around the object without a view, radians; 0 of a turn without a hole."""
        return widest_gap(self._centres)

    @property
    def passed(self) -> bool:
        """Whether the camera went on far enough beyond the start to finish without waiting."""
        return self._after > _SEAM

    def add(self, centre: NDArray[np.float64]) -> None:
        """Take in the next camera centre, (3,) metres, object frame."""
        if self.ended:
            middle = np.mean(self._centres, axis=0)
            radius = max(float(np.linalg.norm(self._last - middle)), 1e-12)
            self._after += float(np.linalg.norm(centre - self._last)) / radius
        self._last = centre
        self._count += 1
        if (self._count - 1) % self._every == 0:
            self._centres.append(centre)
        if len(self._centres) > _MOST_CENTRES:
            self._centres, self._every = self._centres[::2], 2 * self._every
        if self.closed:
            return
        self.angle = angle_covered(self._centres)
        self.ended = self.ended or self.closed or back_at_start(self._centres)


class Scan:
    """The scan that goes on: its state, name and figures.

    Args:
        changed: told of each new state.
        now: wall clock, for the name.
        taken: whether a name is in use already.
        wish: the name that it shall have, "" for one by the clock.

    Attributes:
        report: how it is.
        unsaved: whether something has come since it was saved.
        watch: sees the end of the turn.
        whole: sees how much of the object all turns have shown.
    """

    def __init__(
        self,
        changed: Callable[[], None],
        taken: Callable[[str], bool],
        wish: Callable[[], str] = str,
        now: Callable[[], datetime] = datetime.now,
    ) -> None:
        self._changed, self._taken, self._wish, self._now = changed, taken, wish, now
        self._begin()

    def clear(self) -> None:
        """Wait for the next scan."""
        self._begin()
        self._changed()

    def _begin(self) -> None:
        self.report = ScanReport()
        self.watch, self.whole = TurnWatch(), TurnWatch()
        self.unsaved = False
        self._samples = self._good = 0
        self._outside: dict[int, int] = {}  # samples that another view contradicts, by stamp
        self._saved: tuple[int, int] | None = None  # samples and those then
        self._written: tuple[int, int] | None = None  # the same, of what is being written
        self._cut = ""  # why it began in the middle of another

    def again(self) -> None:
        """All that has come is made anew, and comes again."""
        self.watch.restart()
        self.whole.restart()
        self._samples = self._good = 0
        self._outside, self._saved, self._written = {}, None, None
        self.report = replace(self.report, angle=0.0, frames=0, good_share=0.0, doubt="")
        self._changed()

    def resume(self, scan_id: str) -> None:
        """Go on with a scan of that name."""
        self.report = replace(self.report, scan_id=scan_id)

    @property
    def state(self) -> ScanState:
        """Where it is."""
        return self.report.state

    def named(self) -> str:
        """Its name; one that has none yet gets it now."""
        if not self.report.scan_id:
            base = f"scan_{self._now():%Y%m%d_%H%M%S}"
            names = (base if k == 1 else f"{base}_{k}" for k in range(1, 1_000_000))
            name = self._wish() or next(n for n in names if not self._taken(n))
            self.report = replace(self.report, scan_id=name)
        return self.report.scan_id

    def rename(self) -> None:
        """What is saved stays under its name; what goes on gets another."""
        names = (f"{self.report.scan_id}_{k}" for k in range(2, 1_000_000))
        name = next(n for n in names if not self._taken(n))
        self.report, self._saved = replace(self.report, scan_id=name, doubt=""), None

    def cut_short(self, before: ScanReport) -> None:
        """Stamps went back in the middle of the scan before, which has ended there."""
        self._cut = (
            f"stamps went back in the middle of {before.scan_id}, at {before.frames} rims: what "
            "comes since is another scan; all must come from one clock that does not jump"
        )
        self.report = replace(self.report, reason=self._cut)
        self._changed()

    def trouble(self) -> str:
        """What is wrong with the scan that goes on, in words; "" for nothing."""
        return self.contradiction() or self._cut

    def add_outside(self, stamp_ns: int, samples: int) -> None:
        """So many samples of the rim of a frame lie outside the silhouette of another view; what
        was last said of a frame counts."""
        self._outside[stamp_ns] = samples

    def contradiction(self) -> str:
        """How what has come since it was saved contradicts that, in words; "" if it does not."""
        if self._saved is None or self._samples == self._saved[0]:
            return ""
        samples, outside = self._saved
        share = (sum(self._outside.values()) - outside) / (self._samples - samples)
        if share < _CONTRADICTING:
            return ""
        return (
            "what came since the scan was saved contradicts it, and is saved beside it: another "
            "object? ~/reset of tracker, reconstructor and mesher begins the next scan"
        )

    def write(self) -> None:
        """What has come until now is what is saved next, however long that takes."""
        self._written = self._samples, sum(self._outside.values())

    def judged(self, doubt: str) -> None:
        """The body has been closed, and so much speaks against it."""
        self.report = replace(self.report, doubt=doubt)

    def add_frame(self, samples: int, good: int) -> None:
        """A rim has come: this many samples, of which this many are good."""
        self.named()
        self._samples, self._good = self._samples + samples, self._good + good
        self.unsaved = True
        self.report = replace(
            self.report,
            frames=self.report.frames + 1,
            good_share=self._good / max(self._samples, 1),
        )
        if self.state in (ScanState.WAITING, ScanState.FAILED, ScanState.SAVED):
            self.go(ScanState.SCANNING)
        if self.state == ScanState.SCANNING:
            self.report = replace(self.report, reason=self.trouble())
            self._look()

    def add_view(self, centre: NDArray[np.float64]) -> None:
        """A camera has seen an outline from its centre, (3,) metres, object frame."""
        self.named()
        self.watch.add(centre)
        self.whole.add(centre)
        self.report = replace(self.report, angle=min(self.whole.angle, 2 * np.pi))
        self._look()

    def _look(self) -> None:
        if self.watch.closed and self.state == ScanState.SCANNING:
            self.go(ScanState.TURN_CLOSED)

    @property
    def turn_ended(self) -> bool:
        """Whether the turn is closed, or has come around to its start with a hole in it."""
        scanning = self.state == ScanState.SCANNING
        return self.state == ScanState.TURN_CLOSED or (scanning and self.watch.ended)

    @property
    def to_close(self) -> bool:
        """Whether it has come to an end with views, and a body is due."""
        ended = self.turn_ended or self.state in (ScanState.FINISHING, ScanState.FAILED)
        return ended and self.report.frames > 0

    def no_strips(self) -> str:
        """Why its rims give no strips, in words."""
        if refuted := self.refuted():
            return f"no strips: {refuted}"
        further = ": turn further" if self.unseen() else ""
        return f"no strips: no rim has a neighbour to be joined to{further}"

    def refuted(self) -> str:
        """How much of its rims other views contradict, in words; "" where that is little."""
        outside = sum(self._outside.values()) / max(self._samples, 1)
        if outside < _CONTRADICTING:
            return ""
        return (
            f"{outside:.0%} of the samples fall outside the outlines of others, as where images do "
            "not show the object, or poses, zoom or camera_info are wrong"
        )

    def unseen(self) -> str:
        """What of the turn is missing, in words; "" for nothing."""
        missing = np.rad2deg(max(2 * np.pi - self.report.angle, self.whole.gap))
        return f"{missing:.0f} degrees were not seen" if 0.5 < missing < 360 else ""

    def go(self, state: ScanState, reason: str = "") -> None:
        """Enter a state, for a reason.

        A scan that is saved when its turn has ended begins a new one: what comes from now on is
        added to it. Before, the turn goes on.
        """
        if state == ScanState.SAVED:
            self._saved = self._written or (self._samples, sum(self._outside.values()))
            self.unsaved, self._written, self._cut = self._samples > self._saved[0], None, ""
            if self.watch.ended:
                self.watch.restart()
        self.report = replace(self.report, state=state, reason=reason)
        self._changed()
