"""A bag as a source of frames."""

from collections.abc import Callable, Sequence
from pathlib import Path

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.report.heard import Heard, Sent
from occ_recon_ros.report.result import Distance

from .arguments import Values, override
from .drive import Feed, Player, play_at_full_rate, play_in_time
from .listener import Listener
from .pipeline import NODES, Pipeline
from .reading import open_views
from .scan import ScanOptions, lossless

Step = Callable[[BagViews, Progress], Changes]
"""A first pass over the views of a bag, which may be read more than once. It finds masks, poses
or calibrations that are then played in place of those in the bag. One with a ``report`` has it
in the report of the scan, under its ``name``; ``warnings`` there are doubts, in words. One with
``configure`` is given the parameters of the tracker before."""


class BagSource:
    """A recorded sequence.

    Args:
        path: the bag.
        rate: "max", or how many times as fast as it was recorded.
        clock: the nodes live by the time of the bag, which is published on /clock.
        remaps: FROM:=TO, topics of the bag to be renamed.
        steps: done one after the other before the first frame is played; each sees the views
            as the ones before it have changed them.

    Raises:
        UserError: no such rate.
    """

    command = "replay"
    distance: Distance | None = None

    def __init__(
        self,
        path: Path,
        rate: str = "max",
        clock: bool = False,
        remaps: Sequence[str] = (),
        steps: Sequence[Step] = (),
    ) -> None:
        self._path, self._rate, self._clock, self._remaps = path, rate, clock, remaps
        self._speed = _speed(rate)
        self._steps = steps

    def prepare(self, values: Values, options: ScanOptions) -> int:
        """Open the bag, let the steps look at it, and take the object frame from its poses."""
        self._views = open_views(self._path, self._remaps, values, options.params)
        for step in self._steps:
            if hasattr(step, "configure"):
                step.configure(_tracker(values))
            progress = options.progress.part(_words(step))
            self._views.changes = self._views.changes.then(step(self._views, progress))
        self._playing = options.progress.part("replaying")
        # The nodes share one object frame: the one that is named, else that of the poses.
        frame = str(_tracker(values).get("object_frame", ""))
        if not frame and options.params is None:
            frame = self._views.object_frame()
        for node in NODES if frame else ():
            override(values, node, **{"object_frame": frame, **values.get(node, {})})
        for node in ("contour_tracker", "mesher"):
            lossless(values, node, "subscription", *self._views.played())
        if self._clock:
            for node in NODES:
                override(values, node, use_sim_time=True)
        return len(self._views)

    def play(self, nodes: Pipeline, listener: Listener, progress: Progress) -> Sent:
        """The messages as they were recorded, but for what the steps have changed."""
        player = Player(nodes, listener, self._views.played(), self._clock)
        feed = Feed(nodes, listener, self._playing, len(self._views))
        if self._speed is None:
            return play_at_full_rate(self._views.messages(), player, feed)
        return play_in_time(self._views.messages(), player, feed, self._speed)

    def write(self, path: Path, overwrite: bool = False) -> None:
        """Write what was played as a bag: with the masks, poses and calibrations of the steps.

        Raises:
            UserError: it cannot be written.
        """
        reports = {getattr(step, "name", ""): getattr(step, "report", {}) for step in self._steps}
        self._views.write(path, None, overwrite, reports.get("segmentation"))

    def described(self) -> Report:
        """What is in the bag, and what of it was played."""
        return {
            "name": self._path.name,
            "topics": self._views.topics,
            "messages": dict(self._views.bag.counts),
            "lost": self._views.bag.lost,
            "images": self._views.images(),
            "rate": self._rate,
            **{
                getattr(step, "name", ""): getattr(step, "report", {})
                for step in self._steps
                if hasattr(step, "report")
            },
        }

    def judge(self, heard: Heard) -> Report:
        """A recording does not know the truth."""
        return {}


def _tracker(values: Values) -> Values:
    return values.get("contour_tracker", {})


def _words(step: Step) -> str:
    """What a first pass is called where people read."""
    return str(getattr(step, "name", "a first pass")).replace("_", " ")


def _speed(rate: str) -> float | None:
    """None for "max"."""
    if rate == "max":
        return None
    try:
        speed = float(rate)
    except ValueError:
        speed = 0.0
    if not 0 < speed < 1e6:
        raise UserError(f"--rate {rate}: must be a number above 0, or max")
    return speed
