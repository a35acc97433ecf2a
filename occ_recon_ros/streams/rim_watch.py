"""What the rims of a scan say of the poses, of the calibration and of the outlines."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..geometry import Contours, Rim, RimReconstructor, Status
from ..geometry.coverage import angle_covered

_OFF_PX = 0.5  # of poses or calibration, said from there on
_FEW_FRAMES = 5  # of which a right scan may have no good point
_MANY_FRAMES = 9  # that came without a good point: said before somebody finishes the scan
_FAR = 4.0  # baselines; the first rim comes after two
_RIMS = 36  # the latest, which say how it goes now
_KEPT = 4000  # rims of the scan that are counted
_FEW_RIMS = 6  # have met too few others
_OUTSIDE = 0.15  # share of the samples: 0.001 where all is right, 0.13 with rough poses
_UNMATCHED = 0.5  # of the samples: 0.05 where all is right, 0.35 with rough poses
_AT_REST = 5  # frames that a camera stands still for, before it is said
_MOVED_PX = 2.0  # by which an outline changes that is not that of a table at rest
_CAUSES = (
    "the poses of some views, camera_info (zoom, focus, image size) or the outlines (light, masks "
    "of other images, more in the picture than the object) are wrong"
)


class RimWatch:
    """Counts what comes of the frames of a scan.

    Args:
        reconstructor: that makes the rims.
        baseline: between the views of a rim, radians.

    Attributes:
        frames: that were used.
        statuses: samples by the name of their status, also of rims that came again.
    """

    def __init__(self, reconstructor: RimReconstructor, baseline: float) -> None:
        self._reconstructor, self._baseline = reconstructor, baseline
        self.frames = 0
        self.statuses: Counter[str] = Counter()
        self._rims: dict[int, NDArray[np.int64]] = {}  # samples by status, by stamp
        self._extent: NDArray[np.float64] | None = None  # of the outline when the camera moved
        self._at_rest, self._changed = 0, False

    def add_frame(self, contours: Contours) -> None:
        """A frame was used."""
        self.frames += 1
        self._extent = _extent(contours)
        self._at_rest, self._changed = 0, False

    def add_unmoved(self, contours: Contours) -> None:
        """A frame was left out because the camera is where it was."""
        self._at_rest += 1
        if self._extent is not None:
            apart = float(np.abs(_extent(contours) - self._extent).max())
            self._changed |= apart > _MOVED_PX

    def add_rims(self, rims: Sequence[Rim]) -> None:
        """Rims were made; the last of a stamp counts."""
        for rim in rims:
            found = np.bincount(rim.status, minlength=len(Status))
            self.statuses.update({status.name.lower(): int(found[status]) for status in Status})
            self._rims.pop(rim.stamp_ns, None)
            self._rims[rim.stamp_ns] = found
        while len(self._rims) > _KEPT:
            del self._rims[next(iter(self._rims))]

    def share(self, status: Status) -> float:
        """Of the samples of the scan, or of its latest rims where it is more, that have a status;
        0 while there are few rims."""
        if len(self._rims) < _FEW_RIMS:
            return 0.0
        found = np.array(list(self._rims.values()))
        shares = [part[:, status].sum() / max(part.sum(), 1) for part in (found, found[-_RIMS:])]
        return float(max(shares))

    @property
    def _rims_are_due(self) -> bool:
        """Whether frames enough have come for some rims with good points."""
        if self.frames < _MANY_FRAMES:
            return False
        return angle_covered(self._reconstructor.centres) > _FAR * self._baseline

    def doubts(self, over: bool) -> Iterator[str]:
        """What is wrong, in sentences.

        Args:
            over: the scan is, so that the camera need not move any more.
        """
        if self._at_rest >= _AT_REST and (self.frames < 2 or self._changed) and not over:
            outline = ", though the outline changes" if self._changed else ""
            yield (
                f"the camera does not move: the latest poses are of one place{outline}: turn the "
                "table, or if it turns: camera_pose is not the camera's in the frame that turns "
                "with the object, or what measures the angle stands"
            )
        elif self._rims_are_due and not self.statuses["good"]:
            yield self.no_point()
        outside, unmatched = self.share(Status.OUTSIDE), self.share(Status.NO_CORRESPONDENT)
        words = []
        if outside > _OUTSIDE:
            words.append(f"{outside:.0%} of the samples fall outside the outlines of other views")
        if unmatched > _UNMATCHED:
            words.append(f"{unmatched:.0%} of the samples are not found in the views beside")
        off = self._off(words)
        if off:
            yield off
        elif words:
            yield f"{' and '.join(words)} and are given up: {_CAUSES}"

    def _off(self, further: Sequence[str]) -> str:
        """By how much poses or calibration are off, "" where they are not."""
        calibration = self._reconstructor.calibration
        if calibration.size_px <= _OFF_PX:
            return ""
        share, amount = calibration.outside
        seen = [f"views disagree on common points by {calibration.frontier_px:.1f} px"]
        if share:
            seen.append(f"{share:.0%} of the points fall outside silhouettes by {amount:.1f} px")
        return (
            f"camera poses or calibration are off by about {calibration.size_px:.1f} px "
            f"({', '.join([*seen, *further])}): calibrate anew, check camera_info and the "
            "turntable's axis, or the table turns the other way than the poses say, or outlines of "
            "single images are wrong (all are looked at together when the turn ends); points up to "
            f"{self._reconstructor.tolerance_px:.1f} px outside are kept meanwhile"
        )

    def no_point(self) -> str:
        """Why no rim of the scan has a good point, and what to do."""
        unmoved = self._reconstructor.unmoved
        if self.frames == 1 and unmoved > 1:
            return (
                f"no rim has a point: all {1 + unmoved} camera poses are the same: turn further, "
                "or if the table did turn, give the pose of the camera in the frame that turns "
                "with the object"
            )
        if self.frames < 3:
            return (
                f"no rim has a point: a rim needs three views, and {self.frames} came with an "
                "outline"
            )
        covered = np.rad2deg(angle_covered(self._reconstructor.centres))
        baseline = np.rad2deg(self._baseline)
        if covered < 2 * baseline:
            return (
                f"no rim has a point: the camera has moved by {covered:.1f} degrees in "
                f"{self.frames} frames, and a rim needs views {baseline:.1f} degrees to either "
                "side: turn further, or set baseline lower"
            )
        few = "they are few, take more of them; else " if self.frames < _FEW_FRAMES else ""
        return (
            f"no rim of {self.frames} frames has a good point: {few}check camera_info, the poses "
            "and the contours"
        )


def _extent(contours: Contours) -> NDArray[np.float64]:
    """(6,) where the outline is in the image, px: least, most and mean u and v."""
    uv = contours.uv
    return np.concatenate([uv.min(axis=0), uv.max(axis=0), uv.mean(axis=0)]).astype(np.float64)
