"""From what was heard of a run to its folder of results."""

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import trimesh
from numpy.typing import NDArray

from msg_adapters import encode_strip
from occ_recon_ros.bags.exposure import numbered
from occ_recon_ros.bags.views import Progress
from occ_recon_ros.evaluation.advice import HIDDEN, of_drops
from occ_recon_ros.evaluation.ends import ends_of
from occ_recon_ros.evaluation.evidence import CAMERAS, Evidence
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.findings import median_size_px
from occ_recon_ros.evaluation.left_out import SHOWS_NOTHING
from occ_recon_ros.evaluation.verdict import judge
from occ_recon_ros.imaging.joint import Volume
from occ_recon_ros.imaging.joint.judge import STRANGE
from occ_recon_ros.streams.alone import MANY
from occ_recon_ros.surface import exported, write_rims, write_whole
from occ_recon_ros.surface.bodies import stood_on
from occ_recon_ros.surface.body import body_views, closed_views, closing_settings
from occ_recon_ros.surface.closing import ClosedSurface
from occ_recon_ros.surface.covering import body_iou, filled_holes, uncovered

from .heard import Heard, Sent
from .numbers import measure_mesh, summarise
from .page import write_page
from .pictures import as_strip, write_pictures
from .solid import Solid
from .words import view_words

_STEPS = "that the table turned in equal steps and the camera stood still"
_LACKS = 0.04  # of the masks that came: a body of right ones lacks at most half of that
_NAMED = 12  # images
_FEW = 0.2  # of the images, which are left out by name: the others tell enough
_MOST_WEIGHED = 120  # views that the verdict looks at, spread evenly over all

Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Of points (n, 3), metres, to the true surface, (n,), metres."""


class StagedProgress(Protocol):
    """Told of each part of the work that begins, and how much of it is done, of how much."""

    def __call__(self, done: int, total: int) -> None: ...

    def stage(self, what: str) -> None: ...


@dataclass(frozen=True)
class Run:
    """A run of the nodes that is over, but for its results.

    Attributes:
        folder: of the results; mesh.ply is there.
        started: ``time.monotonic()`` when the run began.
        nodes: by name.
        heard: of them.
        sent: what went in.
        distance: where the true surface is known.
    """

    folder: Path
    started: float
    nodes: Mapping[str, Any]
    heard: Heard
    sent: Sent
    distance: Distance | None = None


def write_results(run: Run, source: Report, progress: StagedProgress) -> Report:
    """Write rims.ply, closed.ply, pictures, report.json and report.html beside the mesh.ply.

    Args:
        run: that made it.
        source: entries of the report that only the source of the frames can know.
        progress: told of each part.

    Returns:
        The report.
    """
    folder, rims = run.folder, run.heard.rims
    write_rims((rims[stamp] for stamp in sorted(rims)), folder / "rims.ply")
    mesh = trimesh.load_mesh(folder / "mesh.ply", process=False)
    report = source | summarise(run.heard, run.sent, run.nodes)
    report["mesh"] = measure_mesh(mesh, folder / "mesh.ply")
    progress.stage("closing the surface")
    report["closed"], body = _close(run, bool(report["turn"]["closed"]), progress)
    solids, surfaces = [Solid("strips", mesh)], ["mesh.ply"]
    if body is not None:
        solids.insert(0, Solid("closed surface", body.mesh))
        surfaces.append("closed.ply")
        # For whoever has the page open.
        mesher = run.nodes["mesher"]
        shown = replace(as_strip(body.mesh), frame_id=mesher.settings.object_frame)
        mesher.send("closed", encode_strip(shown))
    progress.stage("weighing the result")
    verdict = judge(_evidence(run, report, body))
    report["verdict"] = verdict.report()
    if run.distance is not None:
        far = run.distance
        solids = [replace(s, distance_m=far(np.asarray(s.mesh.vertices))) for s in solids]
    progress.stage("drawing pictures")
    edge = None if verdict.base is None else verdict.base.edge
    pictures = write_pictures(run.heard, solids, folder, progress, edge)
    report["files"] = [*surfaces, "rims.ply", *(p.name for p in pictures)]
    report["wall_time_s"] = time.monotonic() - run.started
    text = json.dumps(_finite(report), indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    cameras = (view.camera() for _, view in sorted(run.heard.views.items()))
    write_page(report, pictures, folder / "report.html", solids, next(cameras, None))
    return report


def _close(run: Run, whole: bool, progress: Progress) -> tuple[Report, ClosedSurface | None]:
    """Close the surface over all that was heard and write it.

    Args:
        run: as it was.
        whole: whether the turn is. Beneath the plane that the object stands on, the hull of a
            part of a turn leans to one side, not under the foot.
        progress: told how much of the work is done, of how much.

    Returns:
        What is to be said of it, with a ``reason`` where there is none, and the surface.
    """
    started, mesher = time.monotonic(), run.nodes["mesher"]
    volume = Volume.of(run.nodes["contour_tracker"].settings) if whole else None
    contours, rims = body_views(run.heard.contours, run.heard.rims)
    try:
        settings = closing_settings(mesher.settings.body_cells)
        closed = closed_views(contours, rims, mesher.colours, settings, progress)
    except ValueError as error:
        return {"reason": str(error)}, None
    mesh = closed.mesh
    if volume is not None and volume.kind == "plane":
        mesh.vertices = stood_on(np.asarray(mesh.vertices), volume.centre, volume.axis)
    path = run.folder / "closed.ply"
    write_whole(path, exported(mesh, path.suffix), overwrite=True)
    seconds = time.monotonic() - started
    stamps = [view.stamp_ns for view in contours]
    report = {
        "file": path.name,
        "views": len(contours),
        "views_left_out": [stamps.index(stamp) for stamp in closed.left_out],
        "views_mended": [stamps.index(stamp) for stamp in closed.mended],
        "views_contradict_each_other": closed.undecided,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "bodies": int(mesh.body_count),
        "genus": int(mesh.body_count - mesh.euler_number // 2),
        "volume_m3": float(mesh.volume),
        "area_m2": float(mesh.area),
        "outside_silhouettes_p99_px": max(0.0, float(np.percentile(closed.outside_px, 99))),
        "seconds": seconds,
    }
    return report, closed


def _evidence(run: Run, report: Report, body: ClosedSurface | None) -> Evidence:
    """What the verdict rests on."""
    heard = run.heard
    stamps = sorted(heard.contours)
    every = -(-len(stamps) // _MOST_WEIGHED) or 1
    contours = [heard.contours[stamp] for stamp in stamps[::every]]
    compared = tuple(stamps[::every])
    images = report["source"].get("images", ())
    called = {row["stamp_ns"]: numbered(k, images) for k, row in enumerate(images)}
    usual = next(iter(heard.sizes.values()), (0, 0))
    # Whoever made masks has said where the object ends.
    played = report["source"].get("topics", {}).values()
    masked = any(topic.startswith("/mask") for topic in played)
    segmented = report["source"].get("segmentation", {})
    used = masked and "not_used" not in segmented
    out = _left_out(segmented)
    few = len(out) if len(out) <= _FEW * run.sent.images else 0
    empty = report["drops"].get("contour_tracker", {}).get("no_object", 0) - len(out)
    volume = run.nodes["contour_tracker"].settings.volume_kind != "none"
    refinement = report["source"].get("refinement", {})
    hidden, few_hidden = _strange(report["source"], run.sent.images)
    rims = [heard.rims[stamp] for stamp in sorted(heard.rims)[::every]]
    return Evidence(
        contours=contours,
        sizes=[heard.sizes.get(c.stamp_ns, usual) for c in contours],
        images=run.sent.images - few,
        outlines=len(stamps),
        every=every,
        good_share=report["samples"]["fraction_good"],
        pose_error_px=run.nodes["reconstructor"].calibration_px,
        covered_deg=report["turn"]["covered_deg"],
        gap_between=_names_at(report["turn"]["gap_between_ns"], images),
        step_deg=report["turn"]["usual_step_deg"],
        neighbours_deg=report["turn"]["between_neighbours_deg"],
        follow=report["turn"]["views_follow_each_other"],
        not_closed=report["closed"].get("reason", ""),
        remarks=[*_lacking(heard, segmented, body), *_sentences(report, "warnings"), *hidden],
        notes=[*_placed_anew(report["source"]), *_sentences(report, "notes"), *few_hidden],
        checked=_checked(report["source"]),
        strips_share=report["mesh"]["area_m2"] / report["closed"].get("area_m2", np.nan),
        bounded=masked or volume,
        object_px=median_size_px(contours),
        empty_masks=max(0, empty) if used else 0,
        refined=bool(refinement.get("tried") or refinement.get("corrected")),
        left_px=refinement.get("after_px", math.nan),
        left_sigmas=refinement.get("after_in_sigmas", math.nan),
        ends=None if body is None else ends_of(np.asarray(body.mesh.vertices), rims),
        body_iou=np.zeros(0) if body is None else body_iou(body.mesh, contours),
        filled=np.zeros(0) if body is None else filled_holes(body.mesh, contours),
        called=[called[s] for s in compared] if all(s in called for s in compared) else (),
        given=used,
        together=bool(segmented.get("attempts")),
        under=segmented.get("sheet", {}).get("advice", ""),
        bare=_bare(report["source"]),
        lost=_lost(report["drops"], len(out) - few, run.sent.images - few - len(stamps)),
        agreement=body.agreement if body is not None and body.compared == compared else None,
    )


def _names_at(stamps: Sequence[int], images: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the images of these stamps are called; by their stamps where nobody tells of images."""
    known = {
        row["stamp_ns"]: row["name"] or view_words(k, {"images": images})
        for k, row in enumerate(images)
    }
    return [known.get(stamp, f"the image of {stamp * 1e-9:.3f} s") for stamp in stamps]


def _lacking(heard: Heard, segmented: Report, body: ClosedSurface | None) -> list[str]:
    """What masks that came tell of a body, most of whose outlines are of images without one."""
    stamps = [s for s in segmented.get("masked_ns", ()) if s in heard.contours]
    if body is None or not stamps:
        return []
    lacks = float(np.median(uncovered(body.mesh, [heard.contours[s] for s in stamps])))
    if lacks < _LACKS:
        return []
    return [
        f"the masks that came show {lacks:.1%} more than the body: parts of the object may be lost "
        "in the masks that were found for the other images"
    ]


def _lost(drops: Report, left_out: int, without: int) -> tuple[str, str] | None:
    """Why images gave no outline, as ``of_drops``: so many, of which some were left out for what
    they show. Those that do not count as images count as neither."""
    return of_drops({**drops.get("contour_tracker", {}), "left_out": left_out}, without)


def _left_out(segmented: Report) -> list[int]:
    """Numbers of the views that were left out for what they show, which is said of each."""
    bad = segmented.get("bad_views", {}).items()
    return [k for k, why in bad if "left out" in why and not why.startswith(SHOWS_NOTHING)]


def _strange(source: Report, images: int) -> tuple[list[str], list[str]]:
    """What is to be said of images that show something before the object, as a hand: a doubt, or,
    where these are few, a note."""
    out = _left_out(source.get("segmentation", {}))
    found = [k for k in _called_so(source, STRANGE) if k not in out]
    if not found:
        return [], []
    what = f"{STRANGE} in {len(found)} of {images} images: {_named(source, found)}"
    return ([what], []) if len(found) > MANY * images else ([], [f"{what}: {HIDDEN}"])


def _called_so(source: Report, words: str) -> list[int]:
    """Numbers of the views of which that is said."""
    bad = source.get("segmentation", {}).get("bad_views", {})
    return [k for k, why in bad.items() if why.startswith(words)]


def _named(source: Report, numbers: Sequence[int]) -> str:
    """The first of some images."""
    images = source.get("images", ())
    names = [images[k]["name"] if k < len(images) else str(k) for k in numbers[:_NAMED]]
    return ", ".join(names) + ", ..." * (len(numbers) > _NAMED)


def _bare(source: Report) -> str:
    """What to do about images that gave no outline, where that is known; else ""."""
    segmented = source.get("segmentation", {})
    if nothing := _called_so(source, SHOWS_NOTHING):
        names = _named(source, nothing)
        return f"leave out the images that show no object, or take them again: {names}"
    bare = segmented.get("without_masks", ())
    if bare and segmented["way"] in ("single", "given") and "agreement" not in segmented:
        return f"give masks for the other {len(bare)} images: {_named(source, bare)}"
    return ""


def _checked(source: Report) -> str:
    """What is to be looked at where poses or calibration may be wrong: images that were taken
    otherwise than the others first."""
    odd = source.get("image_quality", {}).get("checked", ())
    return ", ".join([*odd, _STEPS if "turn" in source else CAMERAS])


def _sentences(report: Report, key: str) -> list[str]:
    """Those by the steps before the first frame was played."""
    parts = [part for part in report["source"].values() if isinstance(part, dict)]
    return [sentence for part in parts for sentence in part.get(key, ())]


def _placed_anew(source: Report) -> list[str]:
    """What was done to views whose poses alone were wrong."""
    placed = source.get("refinement", {}).get("placed_anew", {})
    return [f"{view_words(k, source)} {row['words']}" for k, row in placed.items()]


def _finite(value: Any) -> Any:
    """JSON knows no NaN: null instead."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
