"""report.html: one file with its pictures in it, which opens with no network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

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
    "from the same views (red where its inside is seen), and under it the closed surface.",
    "contours.png": "The first of them whole. Ticks are outward normals; red is doubtful.",
}
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 1100px; padding: 0 1em;
  color: #222; background: #fff }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em }
img { max-width: 100%; border: 1px solid #ddd } figcaption { color: #666; font-size: .9em }
figure { margin: 1em 0 } table { border-collapse: collapse }
td, th { padding: .2em .9em .2em 0; text-align: left; border-bottom: 1px solid #eee }
td.n { text-align: right; font-variant-numeric: tabular-nums }
.bad { color: #b00020; font-weight: 600 } .key { white-space: nowrap; margin-right: 1.2em }
.key i { display: inline-block; width: .8em; height: .8em; margin-right: .4em }
svg { width: 100%; height: auto }
"""


def write_page(report: dict[str, Any], pictures: Sequence[Path], path: Path) -> None:
    """Write the report as a page."""
    title = f"occ-recon {report['command']}: {report['source'].get('name', '')}"
    parts = [
        f"<h1>{escape(title)}</h1>",
        *_warnings(report),
        _table(_key_figures(report)),
        *(_figure(picture) for picture in pictures),
        "<h2>Samples of each frame by status</h2>",
        _status_bars(report["per_frame"]),
        "<h2>Time of computation by stage, ms</h2>",
        _stage_table(report),
        "<h2>Versions</h2>",
        _table((name, value) for name, value in report["versions"].items()),
        "<p>All numbers are in report.json.</p>",
    ]
    body = "\n".join(parts)
    path.write_text(
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
        f"</title><style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n",
        encoding="utf-8",
    )


def _warnings(report: dict[str, Any]) -> Iterable[str]:
    sentences = [report["source"].get("lost", "")]
    for node, reasons in report["drops"].items():
        sentences += [f"{node} dropped {count}: {reason}" for reason, count in reasons.items()]
    unanswered = report["frames"]["unanswered_stamps_ns"]
    sentences.append(f"nothing came of {len(unanswered)} images" if unanswered else "")
    return [f'<p class="bad">{escape(sentence)}</p>' for sentence in sentences if sentence]


def _key_figures(report: dict[str, Any]) -> Iterable[tuple[str, str]]:
    frames, mesh, samples = report["frames"], report["mesh"], report["samples"]
    yield "Images, contours, rims", f"{frames['images']}, {frames['contours']}, {frames['rims']}"
    closed = "closed" if report["turn"]["closed"] else "not closed"
    yield "Turn", f"{report['turn']['covered_deg']:.1f} degrees from first to last view, {closed}"
    size = " x ".join(f"{1e3 * side:.4g}" for side in mesh["size_m"])
    yield "Surface", f"{mesh['triangles']} triangles, {size} mm"
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
    if truth is None:
        yield "Good samples", good
    else:
        targets, distance = truth["targets"], truth["distance"]
        yield "Good samples", f"{good} (target: at least {100 * targets['fraction_good']:.0f} %)"
        yield (
            "Distance to the true surface, mean",
            f"{distance['mean_mm']:.4f} mm (target: at most {targets['distance_mean_mm']})",
        )
        yield (
            "Distance to the true surface, 99th percentile",
            f"{distance['p99_mm']:.4f} mm (target: at most {targets['distance_p99_mm']})",
        )
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


def _figure(picture: Path) -> str:
    data = base64.b64encode(picture.read_bytes()).decode()
    caption = escape(_CAPTIONS.get(picture.name, picture.name))
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
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


def _stage_table(report: dict[str, Any]) -> str:
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
