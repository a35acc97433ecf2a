"""The virtual turntable as a source of frames, judged by the true surface."""

from typing import Any

from rclpy.parameter import Parameter

from occ_recon_ros.bags.views import Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.truth import compare_with_truth
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.report.heard import Heard, Sent
from occ_recon_ros.report.result import Distance
from occ_recon_ros.scene import OBJECTS, make_object

from .arguments import Values
from .drive import Feed, run_turntable
from .listener import Listener
from .pipeline import Pipeline
from .scan import ScanOptions, lossless

_NODE = "virtual_turntable"
_TURN = 6.283185307179586
_TOPICS = ("/image", "/camera_info")


class TurntableSource:
    """One full turn of an object of the virtual turntable.

    Args:
        scene_object: its name.
        frames: views in the turn.
        noise_px: random displacement of the outline, 1 sigma.

    Raises:
        UserError: there is no such object, or a number out of range.
    """

    command = "demo"
    distance: Distance | None = None

    def __init__(self, scene_object: str, frames: int, noise_px: float) -> None:
        if scene_object not in OBJECTS:
            raise UserError(f"--object {scene_object}: must be one of {', '.join(OBJECTS)}")
        if frames < 3:
            raise UserError(f"--frames {frames}: a rim needs its neighbours, give 3 or more")
        if not 0 <= noise_px <= 20:
            raise UserError(f"--noise {noise_px}: must be 0 to 20 pixels")
        self._values: dict[str, Any] = {
            "object": scene_object,
            "frames": frames,
            "step": _TURN / frames,
            "noise_px": noise_px,
        }

    def prepare(self, values: Values, options: ScanOptions) -> int:
        """What ``--set`` says of the turntable outdoes its own options."""
        self._values |= {**values.pop(_NODE, {}), "frame_rate": 0.0}
        values[_NODE] = dict(self._values)
        lossless(values, _NODE, "publisher", *_TOPICS)
        lossless(values, "contour_tracker", "subscription", *_TOPICS)
        self._truth = make_object(self._values["object"])
        self.distance = self._truth.distance
        self._overrides = [Parameter(k, value=v) for k, v in values.pop(_NODE).items()]
        return int(self._values["frames"])

    def play(self, nodes: Pipeline, listener: Listener, progress: Progress) -> Sent:
        """One view after the other, each when something has come of the one before."""
        turntable = nodes.add(
            VirtualTurntableNode(context=nodes.context, parameter_overrides=self._overrides)
        )
        return run_turntable(turntable, Feed(nodes, listener, progress, len(turntable.cameras)))

    def described(self) -> Report:
        """The object and the parameters of the turntable."""
        return {"name": self._values["object"], "turntable": self._values}

    def judge(self, heard: Heard) -> Report:
        """The true surface is known."""
        return {"truth": compare_with_truth(heard.rims, heard.contours, self._truth)}
