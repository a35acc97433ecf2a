"""How far a closed body goes on above and below what was seen of it.

Where all cameras look down, none looks along a flat top or a flat foot, and the cones of their
outlines bound neither: a roof stands on the one, a tail hangs under the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occ_recon_ros.geometry import Rim, Status
from occ_recon_ros.geometry.arrays import Array

_STRAY = 0.2  # percent of the points at either end that may be wrong
_FEWEST = 100  # good points
_SAID = 0.1  # of the height of the body: right ones, with legs or a flat foot, stay below 0.07
_PLANE = "contour_tracker.volume_kind=plane"
_DOUBTED = 0.5  # both ends together: less than half of the body was seen along its surface


@dataclass(frozen=True)
class Ends:
    """Of a body along the axis that its cameras stand around, from its highest and its lowest good
    rim points on.

    Attributes:
        above, below: metres, below 0 where the body ends before.
        height: metres, of the body.
    """

    above: float
    below: float
    height: float

    def said(self) -> str:
        """In words; "" where they are no longer than those of right bodies."""
        if max(self.above, self.below) <= _SAID * self.height:
            return ""
        above, below = (1e3 * max(end, 0.0) for end in (self.above, self.below))
        return (
            f"closed.ply goes on {above:.3g} mm above and {below:.3g} mm below all that views saw "
            "along its surface: no outline bounds a flat top or foot on which all look down"
        )

    def advice(self) -> str:
        """What would bound them."""
        if self.below <= _SAID * self.height:
            return "add views that are level with the top"
        return "add views that are level with it, or end it at a plane: " + _PLANE

    @property
    def doubtful(self) -> bool:
        """Whether they are more of the body than all between them."""
        return max(self.above, 0.0) + max(self.below, 0.0) > _DOUBTED * self.height


def ends_of(vertices: Array, rims: Sequence[Rim]) -> Ends | None:
    """The ends of a body.

    Args:
        vertices: (n, 3) float64, metres, object frame: of the closed body.
        rims: of all views.

    Returns:
        None where there are too few good points, or cameras on a line.
    """
    good = [rim.points[rim.status == Status.GOOD] for rim in rims]
    if len(rims) < 3 or sum(map(len, good)) < _FEWEST:
        return None
    centres = np.array([rim.centre for rim in rims])
    _, size, axes = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)
    if size[1] < 1e-3 * size[0]:
        return None
    # Up is where the cameras are.
    up = axes[2] * (1.0 if (centres.mean(axis=0) - vertices.mean(axis=0)) @ axes[2] >= 0 else -1.0)
    body, seen = vertices @ up, np.concatenate(good) @ up
    low, high = np.percentile(seen, [_STRAY, 100 - _STRAY])
    return Ends(float(body.max() - high), float(low - body.min()), float(np.ptp(body)))
