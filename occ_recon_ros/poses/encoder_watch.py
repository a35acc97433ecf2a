"""Whether an encoder and what the camera sees of a board tell of the same turn."""

from collections import deque

import numpy as np

from occ_recon_ros.geometry.pose import CameraPose

from .axis import Turntable, wrapped

_REMEMBERED = 200
_FEWEST = 3
_LEAST_TURN = np.deg2rad(5)  # of either, before their senses or gears are compared
_RATIO_OFF = 0.02  # of the turn


class EncoderWatch:
    """Compares angles of a joint with poses of the camera that something else has found.

    Without such poses an encoder that slips or runs the other way cannot be told from one that
    does not: images of an unknown object do not say by how much it turned.

    Args:
        table: the calibrated axis.
    """

    def __init__(self, table: Turntable) -> None:
        self.table = table
        self._pairs: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)

    def add(self, angle: float, pose: CameraPose) -> float:
        """Take in a pair of one instant.

        Args:
            angle: of the joint, radians.
            pose: of the camera in the object frame, seen.

        Returns:
            The turn that is seen minus that of the joint, radians, -pi to pi.
        """
        seen = self.table.angle_of(pose)
        self._pairs.append((self.table.ratio * angle, seen))
        return float(wrapped(seen - self.table.ratio * angle))

    def diagnosis(self, tolerance: float) -> tuple[str, str] | None:
        """What is wrong with the encoder, a name and a sentence; None where nothing is.

        Args:
            tolerance: by how much the two may differ, radians.
        """
        if len(self._pairs) < _FEWEST:
            return None
        joint, seen = (np.unwrap(column) for column in np.array(self._pairs).T)
        by_joint, by_eye = joint - joint[0], seen - seen[0]
        off = wrapped(seen - joint)
        if np.abs(by_eye).max() > _LEAST_TURN and np.abs(by_joint).max() < 0.1 * _LEAST_TURN:
            return "encoder_stands", (
                f"the object turned by {_deg(np.abs(by_eye).max())}, the joint stands: is it the "
                "joint of this table?"
            )
        if min(np.abs(by_eye).max(), np.abs(by_joint).max()) > _LEAST_TURN:
            ratio = float(by_joint @ by_eye / (by_joint @ by_joint))
            fits = np.abs(by_eye - ratio * by_joint).max() < tolerance
            if fits and abs(ratio + 1) < _RATIO_OFF:
                return "encoder_reversed", (
                    "the joint runs the other way than the axis file says: change the sign of "
                    "'ratio' there, or calibrate again"
                )
            if fits and abs(ratio - 1) > _RATIO_OFF:
                return "encoder_ratio", (
                    f"the object turns {ratio:.3f} times as far as the axis file says: another "
                    "gear or unit; calibrate again"
                )
        change = off - off[0]
        steps = np.diff(change)
        slip = int(np.argmax(np.abs(steps)))
        if np.abs(change[-1]) > tolerance:
            return "encoder_slips", (
                f"joint and board came apart by {_deg(change[-1])} (by {_deg(steps[slip])} at a "
                f"joint angle of {_deg(joint[slip + 1])}): the table slips on its drive"
            )
        if np.median(np.abs(off)) > tolerance:
            return "encoder_zero", (
                f"the joint's zero is {_deg(np.median(off))} off from that of the axis file: "
                "home it, or calibrate again"
            )
        return None


def _deg(angle: float) -> str:
    return f"{np.rad2deg(angle):.1f} deg"
