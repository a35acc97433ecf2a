"""How often frames come, and when no more do."""

from collections import deque

import numpy as np

_QUIET_S = 1.0  # without a frame, or three times the usual pause: the table rests
_LATEST = 20  # frames that the pause is that of


class Pace:
    """The pace of a scan."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=_LATEST)

    def add(self, now: float) -> None:
        """A frame has come, at a time in seconds."""
        self._arrivals.append(now)

    def quiet(self, now: float) -> bool:
        """Whether no frame has come for longer than usual."""
        pause = np.median(np.diff(self._arrivals)) if len(self._arrivals) > 1 else 0.0
        return not self._arrivals or now - self._arrivals[-1] > max(_QUIET_S, 3 * float(pause))
