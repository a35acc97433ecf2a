"""What goes into a rim besides contours and silhouettes, and what it says of the poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from .arrays import Array
from .belief import Belief
from .contours import Contours
from .rim import Rim
from .settings import RimSettings


@dataclass(frozen=True)
class Context:
    """What is known besides three contours and silhouettes when a rim is computed.

    Attributes:
        settings: the estimator and its limits.
        pose_sigma: 1 sigma of a view's pose, rad across its contours.
        tolerance_px: how far outside a silhouette a point may fall.
        pairs: other pairs of partners, for samples that the first two do not give.
        neighbours: partners whose rims may contradict this one when it is revised.
        more: further partners, for estimators that use many frames.
        rims: rims of partners that are known already, by stamp.
        previous: the frame whose rim the rows are linked to.
    """

    settings: RimSettings = field(default_factory=RimSettings)
    pose_sigma: float = 0.0
    tolerance_px: float = RimSettings.silhouette_tolerance
    pairs: Sequence[tuple[Contours, Contours]] = ()
    neighbours: Sequence[Contours] = ()
    more: Sequence[Contours] = ()
    rims: Mapping[int, Rim] = field(default_factory=dict)
    previous: Contours | None = None


@dataclass(frozen=True)
class PoseEvidence:
    """What a rim says of the poses.

    Attributes:
        frontier_px: (f,) how far apart two views see their common frontier points, px.
        excess_px: (m,) how far its points lie outside the worst silhouette, px.
        belief: of its points, by errors of the contours alone.
    """

    frontier_px: Array
    excess_px: Array
    belief: Belief
