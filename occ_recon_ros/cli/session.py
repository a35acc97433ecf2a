"""From a running pipeline to a folder of results: what demo and replay share."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from std_srvs.srv import Trigger

from msg_adapters import encode_strip
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.verdict import Evidence, body_iou, judge
from occ_recon_ros.imaging.joint import Volume
from occ_recon_ros.report.heard import Heard, Sent
from occ_recon_ros.report.numbers import measure_mesh, summarise
from occ_recon_ros.report.page import write_page
from occ_recon_ros.report.pictures import as_strip, write_pictures
from occ_recon_ros.report.solid import Solid
from occ_recon_ros.surface import write_rims
from occ_recon_ros.surface.closing import ClosedSurface

from .arguments import Values, override
from .closed import write_closed
from .listener import Listener
from .pipeline import Pipeline
from .progress import ProgressBar

_MOST_NAMED = 6  # views that something was wrong with, on the terminal
_MOST_WEIGHED = 120  # views that the verdict looks at, spread evenly over all

Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Of points to the true surface."""


def lossless(values: Values, node: str, kind: str, *topics: str) -> None:
    """Make topics of images reliable: in one process nothing needs to be lost."""
    for topic in topics:
        policies = f"qos_overrides.{topic}.{kind}"
        override(values, node, **{f"{policies}.reliability": "reliable", f"{policies}.depth": 100})


def finish(pipeline: Pipeline, listener: Listener, progress: ProgressBar) -> None:
    """Close the turn and save the mesh, by the services a user would call.

    Raises:
        UserError: no surface came of it; says what became of the images.
    """
    pipeline.settle()
    if not listener.heard.samples:
        raise UserError(f"no contours were found in {listener.heard.images} images{_why(pipeline)}")
    pipeline.nodes["reconstructor"].on_finishing = progress
    answer = pipeline.call(listener, Trigger, "reconstructor/finish")
    if not answer.success:
        raise UserError(f"the turn could not be closed: {answer.message}")
    pipeline.settle()
    answer = pipeline.call(listener, Trigger, "mesher/save")
    if not answer.success:
        frames = len(listener.heard.samples)
        raise UserError(f"no surface came of {frames} frames: {answer.message}{_why(pipeline)}")


def write_results(
    folder: Path,
    report: Report,
    further: Report,
    pipeline: Pipeline,
    listener: Listener,
    sent: Sent,
    started: float,
    distance: Distance | None,
    progress: ProgressBar,
) -> Report:
    """Write rims.ply, closed.ply, pictures, report.json and report.html beside the mesh.ply.

    Args:
        folder: of the results.
        report: its first entries.
        further: entries that only the source of the frames can know.
        pipeline: the nodes that made mesh.ply.
        listener: has heard them.
        sent: what went in.
        started: time.monotonic() when the command began.
        distance: of points, (n, 3) metres, to the true surface, (n,) metres, where it is known.
        progress: told of each part.
    """
    rims = listener.heard.rims
    write_rims((rims[stamp] for stamp in sorted(rims)), folder / "rims.ply")
    mesh = trimesh.load_mesh(folder / "mesh.ply", process=False)
    report |= summarise(listener.heard, sent, pipeline.nodes)
    report["mesh"] = measure_mesh(mesh, folder / "mesh.ply")
    report |= further
    progress.stage("closing the surface")
    mesher = pipeline.nodes["mesher"]
    # Beneath the plane the hull of a part of a turn leans to one side, not under the foot.
    tracker = pipeline.nodes["contour_tracker"]
    volume = Volume.of(tracker.settings) if report["turn"]["closed"] else None
    report["closed"], body = write_closed(
        listener,
        folder / "closed.ply",
        mesher.settings.body_cells,
        mesher.colours,
        volume,
        progress,
    )
    closed = None if body is None else body.mesh
    if closed is not None:  # for whoever has the page open
        shown = replace(as_strip(closed), frame_id=mesher.settings.object_frame)
        mesher.send("closed", encode_strip(shown))
    progress.stage("weighing the result")
    verdict = judge(_evidence(listener.heard, sent, pipeline, report, body))
    report["verdict"] = verdict.report()
    solids = (
        [Solid("strips", mesh)]
        if closed is None
        else [Solid("closed surface", closed), Solid("strips", mesh)]
    )
    if distance is not None:
        solids = [replace(s, distance_m=distance(np.asarray(s.mesh.vertices))) for s in solids]
    progress.stage("drawing pictures")
    edge = None if verdict.base is None else verdict.base.edge
    pictures = write_pictures(
        listener.heard, mesh, closed, folder, solids[0].distance_m, progress, edge
    )
    surfaces = ["mesh.ply"] if closed is None else ["mesh.ply", "closed.ply"]
    report["files"] = [*surfaces, "rims.ply", *(p.name for p in pictures)]
    report["wall_time_s"] = time.monotonic() - started
    text = json.dumps(_finite(report), indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    cameras = (view.camera() for _, view in sorted(listener.heard.views.items()))
    write_page(report, pictures, folder / "report.html", solids, next(cameras, None))
    return report


def _evidence(
    heard: Heard, sent: Sent, pipeline: Pipeline, report: Report, body: ClosedSurface | None
) -> Evidence:
    """What the verdict rests on."""
    stamps = sorted(heard.contours)
    every = -(-len(stamps) // _MOST_WEIGHED) or 1
    contours = [heard.contours[stamp] for stamp in stamps[::every]]
    compared = tuple(stamps[::every])
    usual = next(iter(heard.sizes.values()), (0, 0))
    # Whoever made masks has said where the object ends.
    played = report["source"].get("topics", {}).values()
    masked = any(topic.startswith("/mask") for topic in played)
    volume = pipeline.nodes["contour_tracker"].settings.volume_kind != "none"
    return Evidence(
        contours=contours,
        sizes=[heard.sizes.get(c.stamp_ns, usual) for c in contours],
        images=sent.images,
        outlines=len(stamps),
        every=every,
        good_share=report["samples"]["fraction_good"],
        pose_error_px=pipeline.nodes["reconstructor"].calibration_px,
        covered_deg=report["turn"]["covered_deg"],
        not_closed=report["closed"].get("reason", ""),
        remarks=[
            warning
            for part in report["source"].values()
            if isinstance(part, dict)
            for warning in part.get("warnings", ())
        ],
        bounded=masked or volume,
        body_iou=np.zeros(0) if body is None else body_iou(body.mesh, contours),
        agreement=body.agreement if body is not None and body.compared == compared else None,
    )


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
        distance = report["truth"]["distance"]
        lines.append(
            f"distance to the true surface: mean {distance['mean_mm']:.4f} mm, "
            f"99th percentile {distance['p99_mm']:.4f} mm"
        )
    lines += report["source"].get("refinement", {}).get("warnings", ())
    bad = report["source"].get("segmentation", {}).get("bad_views", {})
    lines += [f"view {k}: {why}" for k, why in islice(bad.items(), _MOST_NAMED)]
    if len(bad) > _MOST_NAMED:
        lines.append(f"and {len(bad) - _MOST_NAMED} more views: report.json")
    verdict = report["verdict"]
    lines.append(": ".join([f"verdict: {verdict['word']}", *verdict["reasons"][:1]]))
    lines += [f"  also: {reason}" for reason in verdict["reasons"][1:]]
    lines += [f"  to do: {advice}" for advice in verdict["advice"]]
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
