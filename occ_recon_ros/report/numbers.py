"""All numbers of a run, as report.json holds them."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from occ_recon_ros.evaluation.figures import Report, statistics
from occ_recon_ros.geometry import Status
from occ_recon_ros.geometry.coverage import (
    angle_covered,
    angles_around,
    follow_each_other,
    rings_go_around,
    step_over_gap,
    steps_between,
    widest_gap,
)

from .heard import Heard, Sent

_PACKAGES = (
    "occ_recon_ros",
    "ros-jazzy-rclpy",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "trimesh",
    "rosbags",
)
_NOT_OF_A_FRAME = ("draw", "mesh", "marker", "render")
"""Stages that are not on the way of each frame from its image to its strip."""
_STILL = 1e-4  # of the way across all cameras: one that moved less has not moved


def summarise(heard: Heard, sent: Sent, nodes: Mapping[str, Any]) -> Report:
    """What came in, what came out, and how long it took."""
    drops = {name: dict(node.drops) for name, node in nodes.items() if node.drops}
    return {
        "frames": {
            "images": sent.images,
            "contours": len(heard.samples),
            "rims": len(heard.rims),
            "unanswered_stamps_ns": sent.unanswered,
        },
        "samples": _samples(heard),
        "drops": drops,
        "turn": _turn(heard),
        "stages_ms": {name: _stages(node.stages) for name, node in nodes.items()},
        "decode_to_strip_ms": _decode_to_strip(nodes),
        "per_frame": _per_frame(heard),
        "versions": _versions(),
    }


def measure_mesh(mesh: trimesh.Trimesh, path: Path) -> Report:
    """Size of the surface as written."""
    low, high = mesh.bounds
    return {
        "file": path.name,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "area_m2": float(mesh.area),
        "bounds_m": [low.tolist(), high.tolist()],
        "size_m": (high - low).tolist(),
    }


def _by_name(counts: NDArray[np.int64]) -> dict[str, int]:
    """Number of samples of each status, by its name."""
    return {kind.name.lower(): int(counts[kind]) for kind in Status}


def _moving(heard: Heard) -> list[int]:
    """Stamps in order, but for frames without a rim that were taken where the one before was, as by
    a table at rest: there is nothing to be had from them."""
    stamps = sorted(heard.centres)
    reach = (
        np.linalg.norm(np.ptp([heard.centres[stamp] for stamp in stamps], axis=0)) if stamps else 0
    )
    out: list[int] = []
    for stamp in stamps:
        rest = (
            out and np.linalg.norm(heard.centres[stamp] - heard.centres[out[-1]]) < _STILL * reach
        )
        if stamp in heard.statuses or not rest:
            out.append(stamp)
    return out


def _samples(heard: Heard) -> Report:
    every, total = sum(heard.samples.values()), sum(heard.samples[s] for s in _moving(heard))
    counts = _by_name(sum(heard.statuses.values(), np.zeros(len(Status), np.int64)))
    return {
        "total": total,
        "of_a_table_at_rest": every - total,
        "by_status": counts,
        "without_rim": total - sum(counts.values()),
        "fraction_good": counts["good"] / total if total else 0.0,
    }


def _per_frame(heard: Heard) -> list[Report]:
    stamps = sorted(heard.samples)
    angles = angles_around([heard.centres[stamp] for stamp in stamps])
    degrees = np.rad2deg(angles - angles[0]) % 360 if len(angles) else [None] * len(stamps)
    out = []
    for stamp, angle in zip(stamps, degrees, strict=True):
        counts = heard.statuses.get(stamp)
        entry = {
            "stamp_ns": stamp,
            "angle_deg": None if angle is None else float(angle),
            "loops": heard.loops[stamp],
            "samples": heard.samples[stamp],
            "by_status": _by_name(counts) if counts is not None else None,
        }
        out.append(entry)
    return out


def _turn(heard: Heard) -> Report:
    """How far the camera went around, in what steps, and whether the rims go all the way."""
    stamps = _moving(heard)
    centres = [heard.centres[stamp] for stamp in stamps]
    covered = float(np.rad2deg(angle_covered(centres)))
    if covered < 360 and rings_go_around(centres):
        covered = 360.0
    if gap := float(np.rad2deg(widest_gap(centres))):
        covered = min(covered, 360 - gap)
    step, between_neighbours = np.rad2deg(steps_between(centres))
    ends = [heard.statuses.get(stamp) for stamp in (stamps[:1] + stamps[-1:])]
    has_ends = all(counts is not None and counts[Status.GOOD] > 0 for counts in ends)
    whole = covered > 359.999
    return {
        "covered_deg": covered,
        "gap_between_ns": [stamps[k] for k in step_over_gap(centres) or ()],
        "mean_step_deg": covered / max(len(stamps) - (not whole), 1),
        "usual_step_deg": float(step),
        "between_neighbours_deg": float(between_neighbours),
        "views_follow_each_other": follow_each_other(centres),
        "closed": has_ends and whole,
    }


def _stages(stages: Mapping[str, Any]) -> Report:
    return {name: statistics(np.array(seconds) * 1e3, "ms") for name, seconds in stages.items()}


def _decode_to_strip(nodes: Mapping[str, Any]) -> Report:
    """Time of computation that a frame takes in all nodes together.

    The n-th entries of all stages are added. Where a stage has more than one entry for
    some frames (rims that are sent again) this mixes neighbours, which leaves the median.
    """
    durations = [
        np.array(seconds)
        for node in nodes.values()
        for name, seconds in node.stages.items()
        if name not in _NOT_OF_A_FRAME and len(seconds)
    ]
    if not durations:
        return {"count": 0}
    frames = min(len(seconds) for seconds in durations)
    return statistics(1e3 * np.sum([seconds[:frames] for seconds in durations], axis=0), "ms")


def _versions() -> Report:
    found = {"python": platform.python_version(), "system": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # a system package of another name
            found[package] = "unknown"
    return found
