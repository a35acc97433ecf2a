"""report.html: one file with its pictures in it, which opens with no network."""

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.refinement import apart_words, what_moved
from occ_recon_ros.geometry import Camera

from .solid import Solid, error_limit_m, pack
from .words import covered_words, size_words, unit_doubt, view_words

_STATUS = (
    ("good", "#4c78a8", "good"),
    ("double", "#72b7b2", "double or frontier point"),
    ("ill_conditioned", "#eeca3b", "ill-conditioned"),
    ("no_correspondent", "#bab0ac", "no correspondent"),
    ("outside", "#e45756", "outside another silhouette"),
    ("motion_along_ray", "#b279a2", "motion along the ray"),
)
_CAPTIONS = {
    "views.png": "Above: images with the contours found. Below: the surface of the strips "
    "from the same views (red where its inside is seen), and under it the surface, closed where "
    "the turn is, drawn into the original images.",
    "errors.png": "How far the surface is from the true one: blue inside of it, red outside, "
    "white where both are one{limit}.",
    "contours.png": "The first of them whole. Ticks are outward normals; red is doubtful.",
}
_FOLDER = Path(__file__).parent
_JPEG_QUALITY = 88
_GOOD_RGB, _POOR_RGB = np.array([43.0, 138.0, 62.0]), np.array([201.0, 42.0, 42.0])
_UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))  # z up, seen along y


def write_page(
    report: Report,
    pictures: Sequence[Path],
    path: Path,
    solids: Sequence[Solid] = (),
    camera: Camera | None = None,
) -> None:
    """Write the report as a page.

    Args:
        report: as report.json holds it.
        pictures: PNG files.
        path: the file to write.
        solids: surfaces to be turned in the page, the best first.
        camera: the view that they are seen in at first.
    """
    title = f"occ-recon {report['command']}: {report['source'].get('name', '')}"
    parts = [
        f"<h1>{escape(title)}</h1>",
        _verdict(report["verdict"]),
        *_warnings(report),
        *_solid_part(solids, camera),
        "<h2>Result</h2>",
        _table(_key_figures(report)),
        "<h2>Input</h2>",
        _table(_input(report)),
        "<h2>Way around the object</h2>",
        _ring_svg(report["per_frame"], report["turn"]["covered_deg"]),
        f"<p>{escape(_turn_sentence(report))}</p>",
        '<h2 class="after">Pictures</h2>' if pictures else "",
        *(_figure(picture, _limit(solids)) for picture in pictures),
        '<h2 class="after">Samples of each frame by status</h2>',
        _status_bars(report["per_frame"]),
        "<p>A bar is a view, in the order of time, and as high as it has samples.</p>",
        "<h2>Time of computation by stage, ms</h2>",
        _stage_table(report),
        "<h2>Versions</h2>",
        _table((name, value) for name, value in report["versions"].items()),
        "<p>All numbers are in report.json.</p>",
    ]
    body = "\n".join(filter(None, parts))
    style = (_FOLDER / "page.css").read_text(encoding="utf-8")
    path.write_text(
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>\n{body}\n"
        "</body></html>\n",
        encoding="utf-8",
    )


def _verdict(verdict: Mapping[str, Any]) -> str:
    """What to think of the result and what to do."""
    word, reasons = verdict["word"], verdict["reasons"]
    if not reasons and word == "good":
        reasons = ["Outlines, poses and body were held against each other: nothing is amiss."]
    lines = [f"<p>{escape(reason)}</p>" for reason in reasons]
    advice = "".join(f"<li>{escape(text)}</li>" for text in verdict["advice"])
    lines += [f"<p>What to do:</p><ul>{advice}</ul>"] if advice else []
    lines += [f"<p>Note: {escape(note)}</p>" for note in verdict["notes"]]
    return f'<div class="verdict {word}"><b>{word}</b>{"".join(lines)}</div>'


def _solid_part(solids: Sequence[Solid], camera: Camera | None) -> Iterator[str]:
    if not solids:
        return
    turn = np.array(_UPRIGHT)
    if camera is not None:  # x right, y down, z forward -> x right, y up, z towards us
        turn = np.diag([1.0, -1.0, -1.0]) @ camera.R_camera_object
    data = {"solids": [pack(solid) for solid in solids], "turn": turn.tolist()}
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    script = (_FOLDER / "solid.js").read_text(encoding="utf-8")
    yield (
        '<figure><div id="solid-buttons"></div><canvas id="solid"></canvas>'
        '<figcaption id="solid-caption"></figcaption></figure>'
        f'<script id="solids" type="application/json">{text}</script><script>{script}</script>'
    )


def _input(report: Report) -> Iterator[tuple[str, str]]:
    """What came, and what of it was not used."""
    source, frames = report["source"], report["frames"]
    yield "Source", f"{source.get('name', '')} ({report['command']})"
    for name, value in source.get("turntable", {}).items():
        if name.startswith("qos_overrides"):
            continue
        yield f"turntable {name}", f"{value:.6g}" if isinstance(value, float) else str(value)
    messages = source.get("messages", {})
    for topic, name in source.get("topics", {}).items():
        renamed = f" as {name}" if name != topic else ""
        yield f"topic {topic}{renamed}", f"{messages.get(topic, 0)} messages"
    yield from _prepared(source)
    yield "Images", str(frames["images"])
    empty = frames["images"] - frames["contours"]
    yield "Images without contours", str(empty)
    yield "Contours without a rim", str(frames["contours"] - frames["rims"])
    for node, reasons in report["drops"].items():
        for reason, count in reasons.items():
            yield f"dropped by {node}", f"{count}: {reason}"
    if not any(report["drops"].values()):
        yield "Dropped", "nothing"


def _prepared(source: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What was done to masks and poses before the first frame was played."""
    masks, poses, turn = (source.get(name) for name in ("segmentation", "refinement", "turn"))
    if turn is not None:
        yield (
            "Unit",
            f"arbitrary: the camera taken to be {turn['assumed_distance_m']:g} m from the axis",
        )
        yield (
            "Axis",
            (
                f"from the outlines alone, seen from {turn['elevation_deg']:.1f} degrees above "
                f"(+- {turn['rotation_sigma_deg']:.1f}), focal length {turn['focal_px']:.0f} px "
                f"(+- {turn['focal_sigma_percent']:.1f} %)"
            ),
        )
    if masks is not None:
        by_views = "found in all views together"
        found = {"single": "found image by image"}.get(masks.get("way", ""), by_views)
        came = "/mask" in source.get("topics", {}).values()
        if "not_used" in masks:
            found += f", for {masks['not_used']}"
        yield "Masks", "as recorded" if came and "not_used" not in masks else found
        for view, why in masks.get("bad_views", {}).items():
            yield view_words(view, source), why
    if poses is not None and "before_px" in poses:
        apart = f"two views were {poses['before_px']:.2f} px apart (1 sigma)"
        if poses.get("corrected"):
            groups = [group for group in poses["corrected"] if group != "break"]
            what = ", ".join([*what_moved(poses), *groups])
            apart = f"{apart_words(poses)}: corrected {what}"
        yield "Poses and calibration", apart if poses.get("corrected") else f"as recorded; {apart}"


def _turn_sentence(report: Report) -> str:
    turn = report["turn"]
    closed = "" if turn["closed"] else "; the turn is not closed"
    return (
        f"{covered_words(report)}, {turn['mean_step_deg']:.2f} degrees a step in the mean{closed}. "
        "A dot is a view: green where its samples are good, red where no surface came of them."
    )


def _warnings(report: Report) -> list[str]:
    sentences = [report["source"].get("lost", "")]
    unanswered = report["frames"]["unanswered_stamps_ns"]
    sentences.append(f"nothing came of {len(unanswered)} images" if unanswered else "")
    return [f'<p class="bad">{escape(sentence)}</p>' for sentence in sentences if sentence]


def _key_figures(report: Report) -> Iterable[tuple[str, str]]:
    frames, mesh, samples = report["frames"], report["mesh"], report["samples"]
    yield "Images, contours, rims", f"{frames['images']}, {frames['contours']}, {frames['rims']}"
    yield "Turn", covered_words(report) + ("" if report["turn"]["closed"] else ", not closed")
    yield "Surface", f"{mesh['triangles']} triangles, {size_words(mesh['size_m'])}"
    if doubt := unit_doubt(mesh["size_m"]):
        yield "Unit", doubt
    body = report["closed"]
    if "reason" in body:
        yield "Closed surface", f"none: {body['reason']}"
    else:
        kind = "watertight" if body["watertight"] else "not watertight"
        yield (
            "Closed surface",
            f"{kind}, {body['triangles']} triangles, {1e6 * body['volume_m3']:.1f} ml, bodies "
            f"{body['bodies']}, genus {body['genus']}, made in {body['seconds']:.1f} s",
        )
    good = f"{100 * samples['fraction_good']:.1f} % of {samples['total']}"
    truth = report.get("truth")
    yield "Good samples", good
    if truth is not None:
        distance = truth["distance"]
        yield "Distance to the true surface, mean", f"{distance['mean_mm']:.4f} mm"
        yield "Distance to the true surface, 99th percentile", f"{distance['p99_mm']:.4f} mm"
        yield "Depth error, median", f"{truth['depth_error']['median_mm']:.3f} mm"
    whole = report["decode_to_strip_ms"]
    if whole["count"]:
        times = f"median {whole['median_ms']:.1f} ms, 95th percentile {whole['p95_ms']:.1f} ms"
        yield "A frame from decode to strip", times
    yield "All together", f"{report['wall_time_s']:.1f} s"


def _table(rows: Iterable[tuple[str, Any]]) -> str:
    lines = (
        f"<tr><td>{escape(name)}</td><td>{escape(str(value))}</td></tr>" for name, value in rows
    )
    return f"<table>{''.join(lines)}</table>"


def _limit(solids: Sequence[Solid]) -> str:
    """Where the colours of the errors end, in words."""
    if not solids or solids[0].distance_m is None:
        return ""
    return f"; full colour is {1e3 * error_limit_m(solids[0].distance_m):.3g} mm or more"


def _figure(picture: Path, limit: str) -> str:
    # As JPEG, to a quarter of the size; the PNG file lies beside the page.
    image = np.asarray(cv2.imread(str(picture), cv2.IMREAD_COLOR))
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    data = base64.b64encode(jpeg.tobytes()).decode()
    caption = escape(_CAPTIONS.get(picture.name, picture.name).format(limit=limit))
    return (
        f'<figure><img alt="{caption}" src="data:image/jpeg;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _ring_svg(frames: Sequence[dict[str, Any]], covered_deg: float) -> str:
    """A dot for each view at its angle, green where its samples are good, red where not.

    Args:
        frames: entries of ``per_frame`` with ``angle_deg``.
        covered_deg: is written in the middle, as all around at most.
    """
    dots, in_all = [], min(covered_deg, 360)
    for frame in frames:
        angle = frame.get("angle_deg")
        if angle is None:
            continue
        counts = frame["by_status"] or {}
        share = counts.get("good", 0) / max(frame["samples"], 1)
        r, g, b = (share * _GOOD_RGB + (1 - share) * _POOR_RGB).round().astype(int)
        x, y = 82 * np.sin(np.deg2rad(angle)), -82 * np.cos(np.deg2rad(angle))
        dots.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="rgb({r},{g},{b})">'
            f"<title>{angle:.1f} degrees: {100 * share:.0f} % good</title></circle>"
        )
    return (
        '<svg class="ring" viewBox="-100 -100 200 200" role="img">'
        '<circle r="82" fill="none" stroke="#ddd" stroke-width="2"/>'
        f"{''.join(dots)}"
        f'<text text-anchor="middle" y="10" font-size="30">{in_all:.0f}°</text></svg>'
    )


def _status_bars(frames: Sequence[dict[str, Any]]) -> str:
    """A stacked bar a frame."""
    tallest = max((frame["samples"] for frame in frames), default=1)
    step = 1000 / max(len(frames), 1)
    bars = []
    for i, frame in enumerate(frames):
        top = 200.0
        for name, colour, _ in _STATUS:
            height = 200 * (frame["by_status"] or {}).get(name, 0) / tallest
            top -= height
            if height:
                bars.append(
                    f'<rect x="{i * step:.2f}" y="{top:.2f}" width="{0.9 * step:.2f}" '
                    f'height="{height:.2f}" fill="{colour}"/>'
                )
    keys = (
        f'<span class="key"><i style="background:{colour}"></i>{escape(words)}</span>'
        for _, colour, words in _STATUS
    )
    svg = f'<svg viewBox="0 0 1000 200" role="img">{"".join(bars)}</svg>'
    return f"{svg}<p>{''.join(keys)}</p>"


def _stage_table(report: Report) -> str:
    rows = ["<tr><th>node</th><th>stage</th><th>times</th><th>median</th><th>p95</th></tr>"]
    stages = {
        (node, name): times
        for node, by_name in report["stages_ms"].items()
        for name, times in by_name.items()
    }
    stages["all", "decode to strip"] = report["decode_to_strip_ms"]
    for (node, name), times in stages.items():
        if times["count"]:
            rows.append(
                f"<tr><td>{escape(node)}</td><td>{escape(name)}</td>"
                f'<td class="n">{times["count"]}</td><td class="n">{times["median_ms"]:.2f}</td>'
                f'<td class="n">{times["p95_ms"]:.2f}</td></tr>'
            )
    return f"<table>{''.join(rows)}</table>"
