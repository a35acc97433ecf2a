"""From a running pipeline to a folder of results: what demo and replay share."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import trimesh
from std_srvs.srv import Trigger

from occ_recon_ros.surface import write_rims

from .closed import write_closed
from .drive import Sent
from .errors import UserError
from .given import Values, override
from .listener import Listener
from .page import write_page
from .pictures import write_pictures
from .pipeline import Pipeline
from .report import Report, measure_mesh, summarise

VIEWS = 4


def lossless(values: Values, node: str, kind: str, *topics: str) -> None:
    """Make topics of images reliable: in one process nothing needs to be lost."""
    for topic in topics:
        policies = f"qos_overrides.{topic}.{kind}"
        override(values, node, **{f"{policies}.reliability": "reliable", f"{policies}.depth": 100})


def finish(pipeline: Pipeline, listener: Listener) -> None:
    """Close the turn and save the mesh, by the services a user would call.

    Raises:
        UserError: no surface came of it; says what became of the images.
    """
    pipeline.settle()
    if not listener.samples:
        raise UserError(f"no contours were found in {listener.images} images{_why(pipeline)}")
    answer = pipeline.call(listener, Trigger, "reconstructor/finish")
    if not answer.success:
        raise UserError(f"the turn could not be closed: {answer.message}")
    pipeline.settle()
    answer = pipeline.call(listener, Trigger, "mesher/save")
    if not answer.success:
        frames = len(listener.samples)
        raise UserError(f"no surface came of {frames} frames: {answer.message}{_why(pipeline)}")


def write_results(
    folder: Path,
    command: str,
    source: Report,
    pipeline: Pipeline,
    listener: Listener,
    sent: Sent,
    extra: Report,
    started: float,
) -> Report:
    """Write rims.ply, closed.ply, pictures, report.json and report.html beside the mesh.ply."""
    rims = [listener.rims[stamp] for stamp in sorted(listener.rims)]
    write_rims(rims, folder / "rims.ply")
    mesh = trimesh.load_mesh(folder / "mesh.ply", process=False)
    report: Report = {"command": command, "source": source}
    report |= summarise(listener, sent, pipeline.nodes)
    report["mesh"] = measure_mesh(mesh, folder / "mesh.ply")
    report |= extra
    closed = None
    report["closed"] = {"reason": "the turn is not closed"}
    if report["turn"]["closed"]:
        report["closed"], closed = write_closed(
            listener, folder / "closed.ply", pipeline.nodes["mesher"].colours
        )
    pictures = write_pictures(listener, mesh, closed, folder)
    surfaces = ["mesh.ply"] if closed is None else ["mesh.ply", "closed.ply"]
    report["files"] = [*surfaces, "rims.ply", *(p.name for p in pictures)]
    report["wall_time_s"] = time.monotonic() - started
    text = json.dumps(_finite(report), indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    write_page(report, pictures, folder / "report.html")
    return report


def _finite(value: Any) -> Any:
    """JSON knows no NaN: null instead."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def headline(report: Report) -> list[str]:
    """The result in a few lines for the terminal."""
    frames, samples, mesh = report["frames"], report["samples"], report["mesh"]
    closed = " (the turn is closed)" if report["turn"]["closed"] else ""
    lines = [
        f"{frames['images']} images, {frames['contours']} contours, {frames['rims']} rims over "
        f"{report['turn']['covered_deg']:.0f} degrees{closed}, {mesh['triangles']} triangles",
        f"{100 * samples['fraction_good']:.1f} % of {samples['total']} samples are good; "
        f"{report['decode_to_strip_ms'].get('median_ms', 0):.1f} ms a frame from decode to strip",
    ]
    if "truth" in report:
        distance, targets = report["truth"]["distance"], report["truth"]["targets"]
        lines.append(
            f"distance to the true surface: mean {distance['mean_mm']:.4f} mm (target "
            f"{targets['distance_mean_mm']}), 99th percentile {distance['p99_mm']:.4f} mm (target "
            f"{targets['distance_p99_mm']})"
        )
    for node, reasons in report["drops"].items():
        lines += [f"{node} dropped {count}: {reason}" for reason, count in reasons.items()]
    if frames["unanswered_stamps_ns"]:
        lines.append(f"nothing came of {len(frames['unanswered_stamps_ns'])} images")
    return lines


def _why(pipeline: Pipeline) -> str:
    drops = [
        f"{count} {reason}"
        for node in pipeline.nodes.values()
        for reason, count in node.drops.most_common(3)
    ]
    return f" (dropped: {', '.join(drops)})" if drops else ""
