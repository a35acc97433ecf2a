"""What terminal and page both say: the turn, sizes, what a size says of its unit, and views."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from occ_recon_ros.evaluation.figures import Report

_ONE_WAY = 0.9  # of the way between successive views that leads around, where they go around
_MORE_THAN_ONE = 1.05  # turns, from which on they are counted
_LARGE_M, _SMALL_M = 20.0, 5e-4  # between which things on turntables are, by far


def size_words(size_m: Sequence[float]) -> str:
    """Sides of a box in the unit that suits the longest: m, mm or um."""
    longest = max(size_m, default=0.0)
    unit, times = ("m", 1.0) if longest >= 1 else ("mm", 1e3) if longest >= 1e-3 else ("um", 1e6)
    return f"{' x '.join(f'{times * side:.4g}' for side in size_m)} {unit}"


def unit_doubt(size_m: Sequence[float]) -> str:
    """What to think of a body whose longest side is out of all measure; empty if it is not."""
    longest = max(size_m, default=0.0)
    if not longest or _SMALL_M < longest < _LARGE_M:
        return ""
    return (
        f"the body is {size_words([longest])} large: the poses may be in another unit (metres are "
        "taken; unit_in_metres of cameras.json)"
    )


def view_words(k: int, source: Mapping[str, Any]) -> str:
    """A view, from 0, and the name of its image where it is known.

    Args:
        k: its number.
        source: what report.json says of the source, or a step; ``images`` tell the names.
    """
    images = source.get("images", ())
    name = images[k]["name"] if k < len(images) else ""
    return f"view {k} ({name})" if name else f"view {k}"


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
