"""Angles of a joint as they come: without the step at a full turn, and in doubt if in degrees."""

from collections import deque

import numpy as np

_TURN = 2 * np.pi
_WRAP = 0.75  # of a turn between two messages, from where on it is the end of the scale
_REMEMBERED = 200  # angles
_FEWEST = 10  # of them that differ, before their unit is judged
_FAST = 2.0  # rad/s: 20 turns a minute
_GRID = 0.25  # what steps of degrees are multiples of
_NEAR = 1e-4
_JUMPS = 5  # in a row


class JointWatch:
    """Follows one joint.

    Attributes:
        angle: the latest, radians, continuous over the end of the scale; None before any.
        turned: from the first on, radians.
    """

    def __init__(self) -> None:
        self.angle: float | None = None
        self.turned = 0.0
        self._last: tuple[int, float] | None = None  # stamp and angle as it came
        self._came: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        self._jumps = self._new = 0  # jumps in a row, and angles since the last look

    def add(self, stamp_ns: int, angle: float, max_speed: float) -> str:
        """Take in an angle, radians.

        Args:
            stamp_ns: its time.
            angle: as it came.
            max_speed: rad/s; what turns faster has jumped; 0: nothing has.

        Returns:
            How it has jumped, in words; "" for one that may be used.
        """
        last, self._last = self._last, (stamp_ns, angle)
        self._came.append((stamp_ns, angle))
        self._new += 1
        if last is None or self.angle is None:
            self.angle = angle
            return ""
        step = angle - last[1]
        if _WRAP * _TURN < abs(step) <= _TURN:
            step -= np.copysign(_TURN, step)
        self.angle += step
        seconds = (stamp_ns - last[0]) * 1e-9
        if seconds > 0 and 0 < max_speed < abs(step) / seconds:
            self._jumps += 1
            while len(self._came) > 1:  # what was before is of another scale
                self._came.popleft()
            return (
                f"from {np.rad2deg(last[1]):.1f} to {np.rad2deg(angle):.1f} degrees in "
                f"{seconds:.3f} s (max_speed)"
            )
        self._jumps = 0
        if seconds > 0:
            self.turned += step
        return ""

    def doubt(self) -> str:
        """What speaks for degrees in place of radians, "" where nothing does or nothing came since
        the last look."""
        new, self._new = self._new, 0
        if not new:
            return ""
        stamps, angles = np.array(self._came).T if self._came else np.zeros((2, 0))
        values = np.unique(angles)
        far = len(values) >= _FEWEST and float(np.ptp(values)) > _TURN
        seconds = float(np.ptp(stamps)) * 1e-9 if len(stamps) else 0.0
        if self._jumps >= _JUMPS:
            seen = "the joint jumps with each message"
        elif far and seconds > 0 and np.abs(np.diff(angles)).sum() / seconds > _FAST:
            rate = np.abs(np.diff(angles)).sum() / seconds * 60 / _TURN
            seen = f"the joint makes {rate:.0f} turns a minute"
        elif far and np.abs(values / _GRID - np.rint(values / _GRID)).max() < _NEAR:
            seen = f"the joint goes from {values[0]:g} to {values[-1]:g} in even steps"
        else:
            return ""
        return f"{seen}: are its angles degrees? joint_states must hold radians"
