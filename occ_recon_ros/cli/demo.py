"""The virtual turntable through the real nodes, judged by the true surface."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from rclpy.parameter import Parameter

from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.scene import OBJECTS

from .drive import Progress, run_turntable
from .errors import UserError
from .given import override, parse_settings, ros_arguments
from .listener import Listener
from .pipeline import pipeline, prepare_environment, private_domain
from .report import Report
from .results import results_folder
from .session import VIEWS, finish, lossless, write_results
from .truth import compare_with_truth

_NODE = "virtual_turntable"
_TURN = 6.283185307179586
_TOPICS = ("/image", "/camera_info")


def demo(
    scene_object: str,
    frames: int,
    noise_px: float,
    out: Path,
    params: Path | None,
    assignments: Sequence[str],
    overwrite: bool,
    log_level: str,
    progress: Progress,
) -> Report:
    """Scan an object of the virtual turntable in one full turn and write the results.

    Raises:
        UserError: bad arguments.
    """
    started = time.monotonic()
    if scene_object not in OBJECTS:
        raise UserError(f"--object {scene_object}: must be one of {', '.join(OBJECTS)}")
    if frames < 3:
        raise UserError(f"--frames {frames}: a rim needs its neighbours, give 3 or more")
    if not 0 <= noise_px <= 20:
        raise UserError(f"--noise {noise_px}: must be 0 to 20 pixels")
    values = parse_settings(assignments)
    arguments = ros_arguments(params, log_level)
    asked = values.pop(_NODE, {})
    turntable_values = {
        "object": scene_object,
        "frames": frames,
        "step": _TURN / frames,
        "noise_px": noise_px,
        **asked,
        "frame_rate": 0.0,
    }
    values[_NODE] = turntable_values
    lossless(values, _NODE, "publisher", *_TOPICS)
    lossless(values, "contour_tracker", "subscription", *_TOPICS)
    prepare_environment(local=True)
    with results_folder(out, "demo", overwrite) as folder:
        override(values, "mesher", output_path=str(folder / "mesh.ply"), overwrite=True)
        overrides = [Parameter(k, value=v) for k, v in values.pop(_NODE).items()]
        with pipeline(arguments, values, private_domain()) as nodes:
            kept = {frames * k // VIEWS for k in range(VIEWS)}
            keep = Listener(lambda n: n in kept, keep_contours=True, context=nodes.context)
            listener = nodes.add(keep)
            turntable = nodes.add(
                VirtualTurntableNode(context=nodes.context, parameter_overrides=overrides)
            )
            sent = run_turntable(turntable, nodes, listener, progress)
            finish(nodes, listener)
            extra = {"truth": compare_with_truth(listener, turntable.object)}
            source = {"name": turntable.settings.object, "turntable": turntable_values}
            return write_results(folder, "demo", source, nodes, listener, sent, extra, started)
