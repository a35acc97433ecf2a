"""The words and figures beside the picture, as HTML."""

from html import escape

import numpy as np

from .scan_view import ScanView

_SECTORS = 72
_COLOURS = {
    "scanning": "#2b8a3e",
    "turn closed": "#1864ab",
    "turn_closed": "#1864ab",
    "saved": "#1864ab",
    "failed": "#c92a2a",
    "paused": "#e67700",
}


def panel_html(view: ScanView, now_s: float) -> str:
    """State, coverage, rates, warnings and drops of a scan."""
    state = view.state(now_s)
    colour = _COLOURS.get(state.word, "#868e96")
    counts = view.counts
    good = f"{100 * counts['good'] / counts['samples']:.0f} %" if counts["samples"] else "-"
    rows = [
        ("frames", str(counts["frames"])),
        ("frames a second", f"{view.frame_rate(now_s):.1f}"),
        ("good samples", good),
    ]
    table = "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in rows)
    parts = [
        '<div id="scan-panel" style="padding:.4em .9em;font-size:.85em">',
        f'<b id="scan-state" style="color:{colour};font-size:1.25em">'
        f"{escape(state.word.replace('_', ' '))}</b>",
        f"<div>{escape(state.sentence)}</div>",
        f'<div style="display:flex;align-items:center">{ring_svg(view)}'
        f'<table style="margin-left:.8em">{table}</table></div>',
    ]
    parts += [
        f'<div style="color:#e67700">{escape(node)}: {escape(sentence)}</div>'
        for node, sentence in view.warnings(now_s)
    ]
    parts += [
        f"<div>{escape(node)} dropped {number}: {escape(reason)}</div>"
        for node, reason, number in view.drops()
    ]
    return "".join([*parts, "</div>"])


def ring_svg(view: ScanView) -> str:
    """The turn as a ring, filled where the camera has been, and the angle in its middle."""
    angles, covered = view.directions(), view.covered()
    step = 2 * np.pi / _SECTORS
    seen = np.zeros(_SECTORS, bool)
    if len(angles):
        turned = np.unwrap(angles)
        # Between two frames the table was turned too.
        n = len(turned)
        between = np.interp(np.linspace(0, n - 1, 8 * n), np.arange(n), turned)
        seen[(between // step).astype(int) % _SECTORS] = True
        seen |= covered >= 2 * np.pi - 1e-6
    sectors = []
    for k in range(_SECTORS):
        a, b = k * step + 0.01, (k + 1) * step - 0.01
        (x0, y0), (x1, y1) = ((np.sin(t), -np.cos(t)) for t in (a, b))
        sectors.append(
            f'<path d="M{40 * x0:.1f} {40 * y0:.1f}A40 40 0 0 1 {40 * x1:.1f} {40 * y1:.1f}" '
            f'stroke="{"#2b8a3e" if seen[k] else "#ced4da"}"/>'
        )
    return (
        '<svg viewBox="-48 -48 96 96" width="110" height="110" role="img">'
        f'<g fill="none" stroke-width="9">{"".join(sectors)}</g>'
        f'<text text-anchor="middle" y="6" font-size="17" fill="currentColor">'
        f"{np.rad2deg(covered):.0f}°</text></svg>"
    )
