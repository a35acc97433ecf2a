"""What contour_tracker keeps on disk: no messages, but what the next image is held against."""

from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_recon_ros.imaging import ContourTracker

from .base import PipelineNode
from .checkpoint import Arrays, Checkpoint
from .settings import TrackerSettings

_STATES = 20  # that may be in the file although only the last counts


class TrackerMemory:
    """The empty rig, the snakes and the names of the loops, so that a tracker that is started
    again neither takes the object for the empty rig nor gives its loops other names.

    Attributes:
        checkpoint: the file, or none.
    """

    def __init__(self, node: PipelineNode[TrackerSettings]) -> None:
        self.checkpoint = Checkpoint(node, node.settings, PointCloud2, few=_STATES)
        self._learnt = 0

    def keep(self, tracker: ContourTracker, stamp_ns: int) -> None:
        """What an image has left behind for the next."""
        if not self.checkpoint.kept:
            return
        if tracker.learnt != self._learnt:
            self._learnt = tracker.learnt
            self.checkpoint.keep_state("empty rig", tracker.empty_rig())
        stamp = {"stamp": np.array(stamp_ns)}
        self.checkpoint.keep_state("tracker", stamp | tracker.state())
        self.checkpoint.compact()

    def recall(self, tracker: ContourTracker) -> int | None:
        """Let a new tracker go on; the stamp of the last image, None where there is nothing to
        go on with."""
        stamps: list[Any] = []

        def take(what: str, state: Arrays) -> None:
            tracker.restore(state)
            if what == "tracker":
                stamps.append(state["stamp"])

        for _ in self.checkpoint.recall(take):
            pass
        self._learnt = tracker.learnt
        return int(stamps[-1]) if stamps else None

    def clear(self) -> None:
        """A new scan begins."""
        self._learnt = 0
        self.checkpoint.clear()
