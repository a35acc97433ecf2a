"""The turn as a ring: where the camera has been, and how good each view was."""

from collections.abc import Sequence
from typing import Any

import numpy as np

_GOOD, _POOR = np.array([43.0, 138.0, 62.0]), np.array([201.0, 42.0, 42.0])


def ring_svg(frames: Sequence[dict[str, Any]], covered_deg: float) -> str:
    """A dot for each view at its angle, green where its samples are good, red where not.

    Args:
        frames: entries of ``per_frame`` with ``angle_deg``.
        covered_deg: is written in the middle.
    """
    dots = []
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
        f'<text text-anchor="middle" y="10" font-size="30">{covered_deg:.0f}°</text></svg>'
    )
