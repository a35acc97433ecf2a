"""The turn in words and as a ring: where the camera has been, and how good each view was."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from occ_recon_ros.evaluation.figures import Report

_GOOD, _POOR = np.array([43.0, 138.0, 62.0]), np.array([201.0, 42.0, 42.0])
_ONE_WAY = 0.9  # of the way between successive views that leads around, where they go around
_MORE_THAN_ONE = 1.05  # turns, from which on they are counted


def covered_words(report: Report) -> str:
    """How far the camera went around, never more than all around; and how often, on a table
    or in rings one after the other: views taken by hand, here and there, do not go around."""
    turn = report["turn"]
    covered = turn["covered_deg"]
    said = ["the turn is closed"] if turn["closed"] else []
    angles = [frame["angle_deg"] for frame in report["per_frame"]]
    gone = np.abs((np.diff(np.array(angles, float)) + 180) % 360 - 180).sum()
    if covered > 360 * _MORE_THAN_ONE and covered > _ONE_WAY * gone:
        said.append(f"gone around {covered / 360:.1f} times")
    return f"{min(covered, 360):.0f} degrees" + (f" ({', '.join(said)})" if said else "")


def ring_svg(frames: Sequence[dict[str, Any]], covered_deg: float) -> str:
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
        r, g, b = (share * _GOOD + (1 - share) * _POOR).round().astype(int)
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
